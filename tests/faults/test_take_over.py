"""One bridge of several runs a route from ROS: another takes over when that one dies.

What two bridges write of one publisher while one takes over is told apart by publisher and
number, as any reader can do with `ros2_kafka_bridge.without_repeats`. Kafka -> ROS shares its
partitions instead: tests/faults/test_kafka_to_ros_kills.py.
"""

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from support.bridges.numbers_to_kafka import LATCHED
from support.bridges.numbers_to_ros import SAMPLES, steps_back
from support.bridges.routes import lines, to_kafka, to_ros, totals
from support.bridges.taking_turns import (
    HANDS,
    RATE,
    STANDS_BY,
    TAKES,
    assert_each_once_in_order,
    exclusive,
    now_s,
    runs,
    said_at_s,
    tell,
    wait_for_all,
    wait_for_order,
)
from support.processes.harness import Bench, eventually, headers, wait_until_it_reads
from support.processes.lifetimes import Leave
from support.spools.files import newest_on_disk

from ros2_kafka_bridge.dedup import Deduplicator
from ros2_kafka_bridge.spool.store import file_of
from ros2_kafka_bridge.testing.local_kafka import LocalKafka


@pytest.fixture
def name(unique: Callable[[str], str]) -> str:
    """The name of the bridges of a test: those of one name take turns."""
    return unique('pair')


@pytest.mark.kills_kafka
def test_guarantee_8_what_a_killed_bridge_has_on_disk_comes_when_it_stands_by_again(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str, name: str
) -> None:
    count = 3000
    spool = {'path': '${SPOOL}', 'mode': 'when_away'}
    route = to_kafka('/orders', own_topic, exclusive=True, spool=spool)
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
        wait_for_order(own_bench, own_topic, 300, first)
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
        records = wait_for_all(own_bench, own_topic, count, second, again)
        assert runs(second)
        assert not runs(again)
        assert again.end() == second.end() == 0
    assert totals(again, 'to_kafka')['confirmed'] >= count - 300, 'from its disk'
    assert_each_once_in_order(records, count)


def test_guarantee_8_a_bridge_that_lives_hands_over_without_a_loss_also_its_spool(
    bench: Bench, topic_name: str, name: str
) -> None:
    """Two bridges of one machine; the first stands still for longer than its session.

    What its readers have taken from VOLATILE publishers is nowhere else: it reads on until the
    other one does, and sends what it holds, however long that takes (`drain_s` is for a stop).
    """
    kinds, leave = ('latched', 'plain', 'spooled'), Leave(bench.place)
    topics = {kind: f'{topic_name}.{kind}' for kind in kinds}
    own: dict[str, Any] = {'exclusive': True, 'drain_s': 0.05}
    spool = {'spool': {'path': str(bench.place / 'spool'), 'mode': 'always'}}
    routes = []
    for kind, topic in topics.items():
        bench.create_topic(topic)
        more = spool if kind == 'spooled' else {}
        routes.append(to_kafka(f'/{kind}', topic, kind, **own, **more))
    config = bench.config(routes, name=name)
    count = 3000
    options = (*leave.options, '--count', str(count), '--rate', str(RATE))
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60, count=3)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60, count=3)
        for kind in kinds:
            lasting = LATCHED if kind == 'latched' else ()
            stack.enter_context(bench.publisher(f'/{kind}', *options, *lasting))
        leave.up_to(300)
        for topic in topics.values():
            wait_for_order(bench, topic, 300, first)
        leave.set_off(1500)
        stopped_s = now_s()
        first.send(signal.SIGSTOP)
        second.wait_for(TAKES, 60, count=3)
        tell('SIGSTOP to the take-over', said_at_s(second, TAKES) - stopped_s)
        second.wait_for('spooled: its turn has come, but process', 60)
        goes_on_s = now_s()
        leave.up_to(2500)
        first.send(signal.SIGCONT)
        first.wait_for(HANDS, 60, count=3)
        tell('SIGCONT to its hand-over', said_at_s(first, HANDS) - goes_on_s)
        leave.up_to(count)
        found = {kind: wait_for_all(bench, topics[kind], count, first, second) for kind in kinds}
        first.wait_for(STANDS_BY, 60, count=3)
        assert second.end() == 0
        first.wait_for(TAKES, 60, count=6)
        assert first.end() == 0
    assert ': failed: ' not in first.output() + second.output()  # those of the routes
    assert HANDS not in second.output()
    for kind in ('latched', 'spooled'):
        assert_each_once_in_order(found[kind], count)
    dedup = Deduplicator()
    numbers = {int(headers(record)['ros.seq']) for record in dedup.without_repeats(found['plain'])}
    assert numbers == set(range(1, count + 1)), 'what the first one held comes late'
    assert [totals(first, kind)['given up'] for kind in kinds] == [0, 0, 0]


@pytest.mark.kills_kafka
def test_guarantee_8_after_a_restart_of_the_broker_exactly_one_bridge_runs_the_route(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, name: str
) -> None:
    """It is the same one, though Kafka was away for longer than a session."""
    bench, count, leave = own_bench, 3000, Leave(own_bench.place)
    config = exclusive(bench, name, topic_name)
    options = (*LATCHED, *leave.options, '--count', str(count), '--rate', str(RATE))
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60)
        stack.enter_context(bench.publisher('/orders', *options))
        leave.up_to(300)
        wait_for_order(bench, topic_name, 300, first)
        leave.set_off(2000)
        bench.close()
        own_kafka.kill()
        first.wait_for('waiting (Kafka is away', count=2)  # one every 10 s, a session has 6
        own_kafka.start()
        before = bench.end_offset(topic_name)
        leave.up_to(count)
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
    bench: Bench, arrived: Path, topic_name: str, tmp_path: Path
) -> None:
    """Kafka -> ROS needs no lock: the group shares the partitions."""
    partitions, each, leave = 4, 500, Leave(tmp_path)
    bench.create_topic(topic_name, partitions=partitions)
    config = bench.config([to_ros(topic_name, '/numbers')])

    def numbers() -> list[list[int]]:
        pairs = [tuple(map(int, line.split())) for line in lines(arrived)]
        return [[n for q, n in pairs if q == p] for p in range(partitions)]

    with (
        bench.subscriber('/numbers', arrived, *leave.options, samples=SAMPLES),
        bench.drained(config) as survivor,
    ):
        survivor.wait_for(f'reads {topic_name}[0, 1, 2, 3]', 60)
        with bench.bridge(config) as dying:
            wait_until_it_reads(dying, topic_name)
            for partition in range(partitions):
                values = [b'%d %d' % (partition, number) for number in range(each)]
                bench.produce(topic_name, values, partition=partition)
            leave.up_to(each)
            eventually(lambda: len(lines(arrived)) == each, 60, dying.output)
            killed_s = now_s()
            dying.kill()
        leave.up_to(2 * partitions * each)
        eventually(lambda: all(found[-1:] == [each - 1] for found in numbers()), 90)
        tell('SIGKILL until every partition is read to its end', now_s() - killed_s)
    for found in numbers():
        assert found[0] == 0
        steps_back(found)
