"""Routes that one bridge at a time runs: who does, and how it goes to another when all is well.

What happens when something dies is in tests/faults/test_take_over.py.
"""

import contextlib
import logging
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition
from support.bridges.routes import to_kafka, totals, values
from support.processes.harness import Bench, eventually, headers

from ros2_kafka_bridge.dedup import without_repeats
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.testing.local_kafka import free_port

LOG = logging.LoggerAdapter(logging.getLogger('test.exclusive'), {})
EXAMPLE = Path(__file__).parents[2] / 'examples' / 'unique_orders.py'
LATCHED = ('--durability', 'transient_local', '--readers', '0')

Locks = Callable[[], GroupLock]


@pytest.fixture
def name(unique: Callable[[str], str]) -> str:
    """The name of the bridges of a test: those of one name take turns."""
    return unique('pair')


@pytest.fixture
def locks(bench: Bench, name: str) -> Iterator[Locks]:
    """Makes locks of bridges of that name, each open until the end."""
    with ExitStack() as stack:

        def make() -> GroupLock:
            kafka = {'bootstrap.servers': bench.bootstrap_servers}
            lock = stack.enter_context(GroupLock(kafka, name, 'orders', LOG))
            lock.open()
            return lock

        yield make


def wait(condition: Callable[[], bool], *polled: GroupLock) -> None:
    """Wait until it holds, while the locks are polled as their routes do."""

    def holds() -> bool:
        for lock in polled:
            lock.poll(0.05)
        return condition()

    eventually(holds, 60)


def test_a_lock_is_held_by_one_and_goes_to_another_only_when_that_leaves(locks: Locks) -> None:
    first = locks()
    wait(lambda: first.held, first)
    assert not first.has_standby()
    second, third = locks(), locks()
    wait(lambda: second.joined and third.joined, first, second, third)
    assert (first.held, second.held, third.held) == (True, False, False)
    assert first.has_standby()
    first.close()
    first.poll(0.0)
    assert not first.held
    wait(lambda: second.held or third.held, second, third)
    assert second.held != third.held


def test_a_lock_whose_client_gives_up_has_another_and_is_held_by_one(locks: Locks) -> None:
    """As where an earlier request comes late: Kafka takes it for another member of the name."""
    first = locks()
    wait(lambda: first.held, first)
    second = locks()
    wait(lambda: second.joined, first, second)
    client = first._client
    with contextlib.closing(Consumer(first._properties)) as late:
        late.subscribe([first.topic])

        def is_replaced() -> bool:
            late.poll(0.05)
            assert first.held, 'it holds on meanwhile'
            return first._client is not client

        wait(is_replaced, first, second)
    wait(lambda: first.joined, first, second)
    until_s = time.monotonic() + 10  # more than a session
    wait(lambda: time.monotonic() > until_s, first, second)
    assert (first.held, second.held) == (True, False)
    first.close()
    wait(lambda: second.held, second)


def test_a_lock_that_is_told_nothing_has_another_client_and_its_place_back(
    locks: Locks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a client has lost its place, is connected, and does not get it back."""
    monkeypatch.setattr('ros2_kafka_bridge.kafka.statistics._INTERVAL_MS', 100)
    monkeypatch.setattr('ros2_kafka_bridge.kafka.lock._UNTOLD_S', 1.0)
    first = locks()
    wait(lambda: first.held, first)
    second = locks()
    wait(lambda: second.joined, first, second)
    client, name = first._client, first._properties['group.instance.id']

    def is_replaced() -> bool:
        assert first.held, 'it holds on meanwhile'
        if first._client is not client:
            return True
        first.joined = False  # in each round: that the second one has come may be told late
        return False

    wait(is_replaced, first, second)
    wait(lambda: first.joined, first, second)
    until_s = time.monotonic() + 8  # more than a session
    wait(lambda: time.monotonic() > until_s, first, second)
    assert (first.held, second.held) == (True, False)
    assert first._properties['group.instance.id'] == name, 'by which it has its place at once'


def test_a_lock_whose_name_is_shut_out_twice_takes_another(locks: Locks) -> None:
    first = locks()
    wait(lambda: first.held, first)
    names = {first._properties['group.instance.id']}
    for _ in range(2):
        client = first._client
        with contextlib.closing(Consumer(first._properties)) as late:
            late.subscribe([first.topic])

            def is_replaced(late: Consumer = late, client: object = client) -> bool:
                late.poll(0.05)
                return first._client is not client

            wait(is_replaced, first)
        wait(lambda: first.joined, first)
        names.add(first._properties['group.instance.id'])
    assert len(names) == 2
    wait(lambda: first.held, first)


def test_a_lock_is_no_failure_of_its_route_where_a_client_cannot_be_made(
    locks: Locks, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As while a certificate is replaced, with half of it there."""
    first = locks()
    wait(lambda: first.held, first)
    client = first._client

    def refuse(*_: object, **__: object) -> Consumer:
        raise KafkaException(KafkaError(KafkaError._INVALID_ARG, 'no such certificate'))

    name = first._properties['group.instance.id']
    with monkeypatch.context() as patched:
        patched.setattr('ros2_kafka_bridge.kafka.group_client.Consumer', refuse)
        assert first._client is not None
        first._client.is_shut_out = True
        wait(lambda: caplog.text.count('cannot join them now') > 2, first)
        assert first.held
        assert first._client is client
    wait(lambda: first._client is not client and first.joined, first)
    assert first.held
    assert first._properties['group.instance.id'] == name, 'it was shut out once'


def test_a_lock_needs_a_topic_of_one_partition_and_says_how_to_make_it(
    bench: Bench, name: str
) -> None:
    bench.create_topic(f'{name}.lock', partitions=3)
    lock = GroupLock({'bootstrap.servers': bench.bootstrap_servers}, name, 'orders', LOG)
    command = f'--create --topic {name}.lock --partitions 1'
    with pytest.raises(RouteError, match=f'has 3 partitions.*{command}'):
        lock.open()
    lock.close()


def test_a_lock_says_that_kafka_is_away(name: str) -> None:
    lock = GroupLock({'bootstrap.servers': f'127.0.0.1:{free_port()}'}, name, 'orders', LOG)
    with pytest.raises(TransportError, match=f'topic {name}.lock: .*Connection refused'):
        lock.open()


def test_check_tells_what_a_lock_is_missing(bench: Bench, name: str) -> None:
    config = bench.config([to_kafka('/orders', name, exclusive=True)], name=name)

    def found() -> str:
        _, output, _ = bench.command('check', '--connect', str(config), timeout_s=90)
        return ' '.join(output.split())

    assert f'lock topic {name}.lock is not there: it is created at the start' in found()
    bench.create_topic(f'{name}.lock', partitions=2)
    assert f'lock topic {name}.lock has 2 partitions, and must have one' in found()


# Whole bridges


def test_one_of_two_bridges_runs_the_route_and_a_stop_hands_it_over_without_a_loss(
    bench: Bench, topic: str, name: str
) -> None:
    """From a TRANSIENT_LOCAL publisher; what comes twice is left out by publisher and number."""
    count = 3000
    config = bench.config([to_kafka('/orders', topic, exclusive=True)], name=name)
    options = (*LATCHED, '--count', str(count), '--rate', '400')
    with bench.bridge(config) as first:
        first.wait_for('takes over: this bridge runs the route', 60)
        with bench.drained(config) as second, bench.publisher('/orders', *options):
            second.wait_for('stands by: another bridge runs this route', 60)
            eventually(lambda: bench.reaches(topic, 300), 60)
            assert 'subscribes to' not in second.output()
            assert first.end() == 0
            second.wait_for('takes over', 60)
            records = bench.records(topic, count)
    assert 'hands over' not in second.output()
    assert totals(first, 'to_kafka')['confirmed'] > 0
    assert totals(second, 'to_kafka')['skipped'] > 0
    once = list(without_repeats(records))
    assert values(once) == [b'%d' % number for number in range(count)]
    assert [int(headers(record)['ros.seq']) for record in once] == list(range(1, count + 1))


def test_a_stop_hands_over_without_a_loss_also_from_a_volatile_publisher(
    bench: Bench, topic: str, name: str
) -> None:
    """The stopping bridge reads on until the other does."""
    count = 3000
    config = bench.config([to_kafka('/orders', topic, exclusive=True)], name=name)
    with bench.bridge(config) as first:
        first.wait_for('takes over: this bridge runs the route', 60)
        with (
            bench.drained(config) as second,
            bench.publisher('/orders', '--count', str(count), '--rate', '400'),
        ):
            second.wait_for('stands by: another bridge runs this route', 60)
            eventually(lambda: bench.reaches(topic, 300), 60)
            assert first.end() == 0
            second.wait_for('takes over', 60)
            eventually(lambda: last_seq(bench, topic) == count, 60)
            records = bench.records(topic, bench.end_offset(topic))
    once = list(without_repeats(records))
    sent = [b'%d' % number for number in range(count)]
    assert values(once) == sent, first.output() + second.output()


def last_seq(bench: Bench, topic: str) -> int:
    """The number of the last message that has come."""
    end = bench.end_offset(topic)
    config = {'bootstrap.servers': bench.bootstrap_servers, 'group.id': 'nobody'}
    with contextlib.closing(Consumer(config)) as consumer:
        consumer.assign([TopicPartition(topic, 0, end - 1)])
        record = consumer.poll(10)
        return int(headers(record)['ros.seq']) if record is not None else 0


def test_a_bridge_that_stands_by_says_so_and_ends_at_once(bench: Bench, name: str) -> None:
    config = bench.config([to_kafka('/orders', name, exclusive=True)], name=name)
    with bench.drained(config) as first:
        first.wait_for('takes over', 60)
        with bench.bridge(config) as second:
            second.wait_for('waiting (stands by: another bridge runs this route)', 60)
            assert second.end(timeout_s=10) == 0
        assert totals(second, 'to_kafka')['taken'] == 0
        assert 'hands over' not in first.output()


# The reader's side


def test_the_example_prints_each_order_once_also_over_its_own_restart(
    bench: Bench, topic: str
) -> None:
    state = bench.place / 'orders.seen'
    options = ('--kafka', bench.bootstrap_servers, '--topic', topic, '--state', str(state))

    def printed(*orders: int) -> str:
        for order in orders:
            told = [('ros.gid', b'01' * 16), ('ros.seq', b'%d' % order)]
            bench.produce(topic, [b'order %d' % order], headers=told)
        done = subprocess.run(
            [sys.executable, EXAMPLE, *options, '--idle', '3'],
            capture_output=True,
            text=True,
            timeout=90,
            check=True,
        )
        assert done.stderr == 'missing from 01010101010101010101010101010101: [range(3, 4)]\n'
        return done.stdout

    assert printed(1, 2, 1, 2, 4, 4) == 'order 1\norder 2\norder 4\n'
    assert printed(2, 4, 5, 1) == 'order 5\n'
