"""One bridge of several runs a route from ROS: another takes over when that one dies.

What two bridges write of one publisher while one takes over is told apart by publisher and
number, as any reader can do with `ros2_kafka_bridge.without_repeats`. Kafka -> ROS shares its
partitions instead: tests/faults/test_kafka_to_ros_kills.py.
"""

import itertools
import signal
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Producer
from harness import (
    Bench,
    eventually,
    headers,
    lines,
    to_kafka,
    to_ros,
    totals,
    wait_until_it_reads,
)
from leave import Leave
from numbers_to_kafka import LATCHED, how_many
from spools import newest_on_disk
from taking_turns import (
    HANDS,
    RATE,
    STANDS_BY,
    TAKES,
    assert_each_once_in_order,
    end,
    exclusive,
    now_s,
    runs,
    said_at_s,
    streaming,
    tell,
    wait_for_all,
    wait_for_order,
)

from ros2_kafka_bridge.dedup import Deduplicator
from ros2_kafka_bridge.spool.store import file_of
from ros2_kafka_bridge.testing.local_kafka import LocalKafka


@pytest.fixture
def name(unique: Callable[[str], str]) -> str:
    """The name of the bridges of a test: those of one name take turns."""
    return unique('pair')


def test_guarantee_8_of_two_that_stand_by_one_takes_over_from_a_killed_bridge(
    bench: Bench, topic_name: str, name: str
) -> None:
    config = exclusive(bench, name, topic_name)
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60)
        stream = stack.enter_context(streaming(bench))
        wait_for_order(bench, topic_name, 500, first)
        third = stack.enter_context(bench.bridge(config))
        third.wait_for(STANDS_BY, 60)
        assert runs(first), 'one that joins changes nothing'
        killed_s = now_s()
        first.kill()
        eventually(lambda: runs(second) or runs(third), 60)
        other = second if runs(second) else third
        tell('SIGKILL to the take-over', said_at_s(other, TAKES) - killed_s)
        # Not before: what the first had sent may still have been written after its end.
        before = bench.end_offset(topic_name)
        wait_for_order(bench, topic_name, before + 1, other)
        tell('SIGKILL to the first record of the other', now_s() - killed_s)
        count = end(bench, stream)
        records = wait_for_all(bench, topic_name, count, second, third)
        assert [runs(second), runs(third)].count(True) == 1
        assert second.end() == third.end() == 0
    assert_each_once_in_order(records, count)


def test_guarantee_8_what_a_killed_bridge_has_on_disk_comes_when_it_stands_by_again(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, name: str
) -> None:
    count = 3000
    own_bench.create_topic(topic_name)
    spool = {'path': '${SPOOL}', 'mode': 'when_away'}
    route = to_kafka('/orders', topic_name, exclusive=True, spool=spool)
    config = own_bench.config([route], name=name)
    places = [str(own_bench.place / host) for host in ('first', 'second')]
    with ExitStack() as stack:
        first = stack.enter_context(own_bench.bridge(config, SPOOL=places[0]))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(own_bench.bridge(config, SPOOL=places[1]))
        second.wait_for(STANDS_BY, 60)
        leave = Leave(own_bench.place)
        leave.up_to(300)
        options = (*leave.options, '--count', str(count), '--rate', str(RATE))
        publisher = stack.enter_context(own_bench.publisher('/orders', *options))
        wait_for_order(own_bench, topic_name, 300, first)
        own_kafka.kill()
        leave.up_to(count)
        publisher.wait_for('published', 60)
        disk = file_of(Path(places[0]), name, 'to_kafka')
        eventually(lambda: newest_on_disk(disk) == count, 60, first.output)
        first.kill()
        own_kafka.start()
        second.wait_for(TAKES, 60)
        again = stack.enter_context(own_bench.bridge(config, SPOOL=places[0]))
        again.wait_for(STANDS_BY, 60)
        records = wait_for_all(own_bench, topic_name, count, second, again)
        assert runs(second)
        assert not runs(again)
        assert again.end() == second.end() == 0
    assert totals(again, 'to_kafka')['confirmed'] >= count - 300, 'from its disk'
    assert_each_once_in_order(records, count)


def test_guarantee_8_a_bridge_that_was_stopped_learns_that_another_runs_its_route(
    bench: Bench, topic_name: str, name: str
) -> None:
    """What it held when it was stopped goes to Kafka once it goes on: late, and not lost."""
    config = exclusive(bench, name, topic_name)
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60)
        stream = stack.enter_context(streaming(bench))
        wait_for_order(bench, topic_name, 500, first)
        stopped_s = now_s()
        first.send(signal.SIGSTOP)
        second.wait_for(TAKES, 60)
        tell('SIGSTOP to the take-over', said_at_s(second, TAKES) - stopped_s)
        before = bench.end_offset(topic_name)
        wait_for_order(bench, topic_name, before + 500, second)
        goes_on_s = now_s()
        first.send(signal.SIGCONT)
        first.wait_for(HANDS, 60)
        tell('SIGCONT to its hand-over', said_at_s(first, HANDS) - goes_on_s)
        first.wait_for(STANDS_BY, 60)
        assert runs(second)
        assert not runs(first)
        count = end(bench, stream)
        records = wait_for_all(bench, topic_name, count, first, second)
        assert second.end() == 0
        first.wait_for(TAKES, 60, count=2)
        assert first.end() == 0
    assert_each_once_in_order(records, count)
    assert totals(first, 'to_kafka')['given up'] == 0


def test_guarantee_8_a_bridge_that_lives_hands_over_without_a_loss_also_its_spool(
    bench: Bench, topic_name: str, name: str
) -> None:
    """Two bridges of one machine; the first stands still for longer than its session.

    What its readers have taken from VOLATILE publishers is nowhere else: it reads on until the
    other one does, and sends what it holds, however long that takes (`drain_s` is for a stop).
    """
    spooled = f'{topic_name}.spooled'
    for topic in (topic_name, spooled):
        bench.create_topic(topic)
    own: dict[str, Any] = {'exclusive': True, 'drain_s': 0.05}
    spool = {'path': str(bench.place / 'spool'), 'mode': 'always'}
    routes = [
        to_kafka('/orders', topic_name, 'plain', **own),
        to_kafka('/spooled', spooled, 'spooled', **own, spool=spool),
    ]
    config = bench.config(routes, name=name)
    options = ('--until', str(bench.place / 'enough'), '--rate', str(RATE), '--readers', '1')
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60, count=2)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60, count=2)
        streams = [
            stack.enter_context(bench.publisher(t, *options)) for t in ('/orders', '/spooled')
        ]
        for topic in (topic_name, spooled):
            wait_for_order(bench, topic, 300, first)
        first.send(signal.SIGSTOP)
        second.wait_for(TAKES, 60, count=2)
        second.wait_for('spooled: its turn has come, but process', 60)
        before = bench.end_offset(topic_name)
        wait_for_order(bench, topic_name, before + 100, second)
        goes_on_s = now_s()
        first.send(signal.SIGCONT)
        first.wait_for(HANDS, 60, count=2)
        tell('SIGCONT to its hand-over, VOLATILE', said_at_s(first, HANDS) - goes_on_s)
        before = bench.end_offset(spooled)
        wait_for_order(bench, spooled, before + 100, second)
        (bench.place / 'enough').touch()
        counts = [how_many(stream) for stream in streams]
        found = [
            wait_for_all(bench, topic, count, first, second)
            for topic, count in zip((topic_name, spooled), counts, strict=True)
        ]
        assert second.end() == first.end() == 0
    assert ': failed: ' not in first.output() + second.output()  # those of the routes
    assert_each_once_in_order(found[1], counts[1])
    dedup = Deduplicator()
    numbers = {int(headers(record)['ros.seq']) for record in dedup.without_repeats(found[0])}
    assert numbers == set(range(1, counts[0] + 1)), 'what the first one held comes late'
    assert totals(first, 'plain')['given up'] == 0


def test_guarantee_8_after_a_restart_of_the_broker_exactly_one_bridge_runs_the_route(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, name: str
) -> None:
    """It is the same one, though Kafka was away for longer than a session."""
    bench, count = own_bench, 5000
    config = exclusive(bench, name, topic_name)
    options = (*LATCHED, '--count', str(count), '--rate', str(RATE))
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60)
        stack.enter_context(bench.publisher('/orders', *options))
        wait_for_order(bench, topic_name, 300, first)
        before = bench.end_offset(topic_name)
        own_kafka.kill()
        time.sleep(8)
        own_kafka.start()
        back_s = now_s()
        wait_for_order(bench, topic_name, before + 1, first, second)
        tell('return of the broker to the first record', now_s() - back_s)
        second.wait_for(STANDS_BY, 60, count=2)
        records = wait_for_all(bench, topic_name, count, first, second)
        assert runs(first)
        assert second.end() == 0
        assert first.end() == 0
    assert TAKES not in second.output()
    assert_each_once_in_order(records, count)


def test_guarantee_8_the_partitions_of_a_killed_bridge_are_read_by_the_other(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    """Kafka -> ROS needs no lock: the group shares the partitions."""
    partitions, each = 4, 1500
    bench.create_topic(topic_name, partitions=partitions)
    arrived = tmp_path / 'arrived'
    config = bench.config([to_ros(topic_name, '/numbers')])

    def numbers() -> list[list[int]]:
        pairs = [tuple(map(int, line.split())) for line in lines(arrived)]
        return [[n for q, n in pairs if q == p] for p in range(partitions)]

    def produce() -> None:
        """For 15 s."""
        with Producer({'bootstrap.servers': bench.bootstrap_servers}) as producer:
            for number, partition in itertools.product(range(each), range(partitions)):
                value = b'%d %d' % (partition, number)
                producer.produce(topic_name, value, partition=partition)
                if partition == 0:
                    time.sleep(0.01)
            producer.flush(60)

    with bench.subscriber('/numbers', arrived), bench.bridge(config) as survivor:
        survivor.wait_for(f'reads {topic_name}[0, 1, 2, 3]', 60)
        with bench.bridge(config) as dying:
            wait_until_it_reads(dying, topic_name)
            thread = threading.Thread(target=produce)
            thread.start()
            eventually(lambda: all(len(found) > 10 for found in numbers()), 60)
            killed_s = now_s()
            dying.kill()
        before = [found[-1] for found in numbers()]
        eventually(lambda: all(max(n) > b for n, b in zip(numbers(), before, strict=True)), 60)
        tell('SIGKILL until every partition is read again', now_s() - killed_s)
        eventually(lambda: all(found[-1] == each - 1 for found in numbers()), 90)
        thread.join()
        assert survivor.end() == 0
    for found in numbers():
        assert found[0] == 0
        assert [(a, b) for a, b in itertools.pairwise(found) if b > a + 1] == [], 'a loss'
