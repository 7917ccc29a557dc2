"""The demonstration as a user runs it: what it prints, what it leaves, its exit status."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from support.bridges.demos import all_equal, children_in, counted, demo, numbers
from support.bridges.routes import values
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.demo import traffic
from ros2_kafka_bridge.demo.run import STOPPED_AT_ONCE, DemoOptions, run
from ros2_kafka_bridge.demo.topics import Topics
from ros2_kafka_bridge.demo.traffic import PROBE, Receiver
from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port
from ros2_kafka_bridge.testing.orders import Order, decode, encode


@pytest.fixture
def place(tmp_path: Path, ros_domain: int) -> Path:
    """A place for the demonstration's files; its ROS domain is the test's own."""
    del ros_domain
    return tmp_path


@pytest.fixture(scope='module')
def keeping_kafka() -> Iterator[LocalKafka]:
    """A Kafka that deletes no topic."""
    with LocalKafka(properties={'delete.topic.enable': 'false'}) as node:
        yield node


@pytest.fixture
def keeping_bench(tmp_path: Path, keeping_kafka: LocalKafka, ros_domain: int) -> Bench:
    """A bench on that Kafka."""
    return Bench(tmp_path, keeping_kafka.bootstrap_servers, ros_domain)


def order_ids(bench: Bench, topic: str) -> list[int]:
    """The orders that a topic holds, without the one that does not count."""
    ends = [bench.end_offset(topic, partition) for partition in partitions(bench, topic)]
    found = values(bench.records(topic, sum(ends)))
    return [order_id for value in found if (order_id := decode(value).order_id) != PROBE]


def test_a_real_broker_is_used_and_left_as_it_was(bench: Bench, place: Path) -> None:
    before = leftovers(bench)
    options = ('--bootstrap-servers', bench.bootstrap_servers, '--rate', '300', '--seconds', '2')
    with demo(place, *options) as process:
        assert process.wait(60) == 0, process.output()
    assert f'a second, Kafka at {bench.bootstrap_servers}' in process.output()
    assert all_equal(counted(process))
    assert_nothing_is_left(bench, before)


def test_what_is_told_is_what_the_topics_hold(keeping_bench: Bench, place: Path) -> None:
    """Read from the topics by another: this broker keeps them, which the demonstration says."""
    servers = keeping_bench.bootstrap_servers
    with demo(
        place, '--bootstrap-servers', servers, '--rate', '1000', '--seconds', '2'
    ) as process:
        assert process.wait(90) == 1
    assert process.output().count('.orders is left: ') == 1
    [sent] = [topic for topic in topics(keeping_bench) if topic.endswith('.orders')]
    produced = order_ids(keeping_bench, sent)
    consumed = set(order_ids(keeping_bench, sent.removesuffix('orders') + 'returned'))
    told = numbers(counted(process))
    assert sorted(produced) == list(range(told['produced'])) == list(range(2000))
    assert len(consumed) == told['consumed']
    assert len(set(produced) - consumed) == told['lost']


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_sending_and_all_that_was_sent_is_counted(
    bench: Bench, place: Path, number: signal.Signals
) -> None:
    before = leftovers(bench)
    with demo(place, '--bootstrap-servers', bench.bootstrap_servers, '--seconds', '60') as process:
        process.wait_for('this bridge: sending', 60)
        process.send(number)
        assert process.wait(60) == 0, process.output()
    assert all_equal(counted(process))
    assert 'Traceback' not in process.output()
    assert_nothing_is_left(bench, before)


def test_a_second_signal_ends_at_once_and_leaves_no_topic(bench: Bench, place: Path) -> None:
    before = topics_of_demos(bench)
    with demo(place, '--bootstrap-servers', bench.bootstrap_servers, '--seconds', '60') as process:
        process.wait_for('this bridge: sending', 60)
        os.kill(children_in(place)[0], signal.SIGSTOP)  # it would never drain
        process.send(signal.SIGINT)
        process.wait_for('this bridge: ', count=process.output().count('this bridge: ') + 2)
        process.send(signal.SIGINT)
        assert process.wait(60) == 130
    assert process.output().splitlines()[-1] == 'ended at once'
    assert 'Traceback' not in process.output()
    assert_nothing_is_left(bench, before, topics_of_demos)
    assert [*place.iterdir()] == [process.log]


def test_a_bridge_that_is_killed_is_told_with_its_log_and_what_is_lost(
    bench: Bench, place: Path
) -> None:
    before = leftovers(bench)
    with demo(place, '--bootstrap-servers', bench.bootstrap_servers, '--seconds', '60') as process:
        # Some lines, one a second: by then the bridge has told its own counters, once a second.
        process.wait_for('this bridge: sending', 60, count=4)
        [bridge] = children_in(place)
        # A bridge that stands still for two lines has orders before it, so that some are lost.
        os.kill(bridge, signal.SIGSTOP)
        process.wait_for('this bridge: sending', 60, count=6)
        process.send(signal.SIGSTOP)  # it would delete what is read here
        os.kill(bridge, signal.SIGKILL)
        [config] = place.glob('*/bridge.yaml')
        returned = f'{json.loads(config.read_text())["name"]}.returned'
        consumed = set(order_ids(bench, returned))
        process.send(signal.SIGCONT)
        assert process.wait(60) == 1
    shown = process.output()
    assert 'the bridge ended by SIGKILL' in shown
    kept = re.search(r'the logs are kept in (\S+)', shown)
    assert kept is not None
    assert 'bridge demo-' in (Path(kept[1]) / 'bridge.log').read_text()
    told = numbers(counted(process))
    assert told['consumed'] == len(consumed) > 0
    lost = told['produced'] - len(consumed)
    assert told['lost'] == lost > 0
    assert f'the bridge has lost {lost:,} orders' in shown
    assert_nothing_is_left(bench, before)


def test_what_the_embedded_broker_deleted_before_it_was_read_is_no_fault_of_the_bridge(
    place: Path,
) -> None:
    """It keeps about nine seconds of these orders; the bridge is held up for longer."""
    with demo(place, '--rate', '1000', '--seconds', '18') as process:
        process.wait_for('this bridge: sending', 60)
        [bridge] = children_in(place)
        os.kill(bridge, signal.SIGSTOP)
        # Lines come a little more than a second apart: one of them may pass a thousand by.
        shown = process.output
        eventually(lambda: re.search(r'produced 1[5-8],', shown()) is not None, 60, shown)
        os.kill(bridge, signal.SIGCONT)
        assert process.wait(90) == 1
    told = numbers(counted(process))
    assert told['lost'] > 0
    assert f'the broker deleted {told["lost"]:,} orders before they were read' in process.output()
    assert 'the bridge has lost' not in process.output()


def test_an_interruption_while_the_topics_are_made_leaves_none(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = leftovers(bench)
    create = Topics.create

    def interrupted(made: Topics, names: Sequence[str]) -> None:
        create(made, names)
        raise KeyboardInterrupt

    monkeypatch.setattr(Topics, 'create', interrupted)
    assert run(DemoOptions(bootstrap_servers=bench.bootstrap_servers)) == STOPPED_AT_ONCE
    assert_nothing_is_left(bench, before)


def test_a_topic_that_a_broker_hears_of_late_is_read_all_the_same(
    bench: Bench, topic_name: str
) -> None:
    with Receiver({'bootstrap.servers': bench.bootstrap_servers}, topic_name) as receiver:
        time.sleep(1)  # it asks in vain; were it slower, it would not have to ask again
        bench.create_topic(topic_name)
        bench.produce(topic_name, [encode(Order(PROBE, 0, ()))])
        eventually(receiver.probed.is_set, 60, lambda: receiver.failure or 'nothing came')


def test_a_topic_that_never_comes_is_a_failure_that_names_it(
    bench: Bench, topic_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traffic, 'PARTITIONS_S', 0.5)
    with Receiver({'bootstrap.servers': bench.bootstrap_servers}, topic_name) as receiver:
        eventually(lambda: not receiver.reads, 60)
    assert receiver.failure.startswith(f'reading {topic_name}: ')


def test_a_demonstration_that_is_killed_takes_its_bridge_with_it(place: Path) -> None:
    with demo(place, '--seconds', '60') as process:
        process.wait_for('this bridge: sending', 60)
        process.kill()
        eventually(lambda: not children_in(place), 60, lambda: 'the bridge is left')


def test_a_broker_that_is_not_there_is_one_sentence(place: Path) -> None:
    address = f'127.0.0.1:{free_port()}'
    with demo(place, '--bootstrap-servers', address) as process:
        assert process.wait(60) == 2
    [sentence] = process.output().splitlines()
    assert sentence.startswith(f'no broker answers at {address} (')
    assert '): is --bootstrap-servers right, does the broker run? ' in sentence
    assert sentence.endswith('The demo has no TLS and no login')


def test_an_option_that_cannot_be_is_one_sentence(place: Path) -> None:
    with demo(place, '--rate', '0') as process:
        assert process.wait() == 2
    [sentence] = process.output().splitlines()
    assert sentence.startswith('--rate 0: expected more than 0')


def test_in_a_terminal_there_is_one_table_that_stays(place: Path) -> None:
    file = place / 'typescript'
    command = f'{sys.executable} -m ros2_kafka_bridge demo --seconds 2'
    done = subprocess.run(
        ['script', '-qec', command, str(file)],
        env={**os.environ, 'COLUMNS': '80', 'LINES': '40', 'TERM': 'xterm', 'NO_COLOR': '1'},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    shown = file.read_text()
    assert '\x1b[?25h' in shown, 'the cursor is back'
    assert not re.search(r'\x1b\[[0-9;]*3[0-7]m', shown), 'NO_COLOR counts'
    last = shown.rpartition('\x1b[2K')[2]
    assert 'produced' in last
    assert '600' in last
    assert last.index('came back') < last.index('bridge: Producer 600')


def leftovers(bench: Bench) -> set[str]:
    """Topics and groups of demonstrations at the broker; other tests may leave some."""
    admin = bench.admin()  # kept: its futures fail when it goes
    groups = [group.group_id for group in admin.list_consumer_groups().result().valid]
    return {*topics_of_demos(bench), *(name for name in groups if name.startswith('demo-'))}


def topics_of_demos(bench: Bench) -> set[str]:
    """The same without the groups."""
    return {name for name in topics(bench) if name.startswith('demo-')}


def assert_nothing_is_left(
    bench: Bench, before: set[str], look: Callable[[Bench], set[str]] = leftovers
) -> None:
    """See that nothing is there that was not before, once those of other workers have ended."""
    eventually(lambda: look(bench) <= before, 60, lambda: f'left: {look(bench) - before}')


def partitions(bench: Bench, topic: str) -> list[int]:
    """The numbers of the partitions of a topic."""
    return [*bench.admin().list_topics(topic, timeout=10).topics[topic].partitions]


def topics(bench: Bench) -> list[str]:
    """All topics at the broker."""
    return [*bench.admin().list_topics(timeout=10).topics]
