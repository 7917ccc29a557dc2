"""Kafka -> ROS while something dies: the bridge, a subscriber, one bridge of two, the broker.

The first proofs are in tests/integration/test_kills.py. A subscriber takes no more than the test
lets it (`Leave`), or the records go on until the test ends them (`Stream`): what happens in
mid-stream does so on a machine however slow.
"""

import itertools
import os
import re
import signal
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.bridges.numbers_to_ros import (
    ROS_TOPIC,
    SAMPLES,
    SLOW,
    numbered,
    numbers,
    one_dies_and_the_next_gets_the_rest,
    steps_back,
    wait_for_all,
    wait_for_lines,
    wait_until_lost,
)
from support.bridges.routes import lines, to_ros, totals
from support.kafka.paced import Stream
from support.processes.harness import Bench, Process, eventually, wait_until_it_reads
from support.processes.lifetimes import Leave

from ros2_kafka_bridge.testing.local_kafka import LocalKafka


def wait_for_commit_beyond(bench: Bench, topic: str, offset: int, bridge: Process) -> int:
    """Wait until more is committed; returns how much."""
    eventually(lambda: bench.committed(bench.group, topic) > offset, 60, bridge.output)
    return bench.committed(bench.group, topic)


FULL = 'waiting (the history is full: a subscriber does not take (/'


def test_guarantees_1_and_8_a_bridge_that_is_killed_twice_repeats_only_uncommitted_records(
    bench: Bench, topic: str, arrived: Path, leave: Leave
) -> None:
    count = 3500
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    bench.produce(topic, numbered(count))
    committed = [0]
    with bench.subscriber(ROS_TOPIC, arrived, *SLOW, *leave.options, samples=SAMPLES):
        for kill_at in (1200, 2200):
            leave.up_to(kill_at + 500)
            with bench.bridge(config) as bridge:
                wait_for_lines(arrived, kill_at, bridge)
                committed.append(wait_for_commit_beyond(bench, topic, committed[-1], bridge))
                bridge.kill()
        leave.up_to(3 * count)
        with bench.drained(config) as bridge:
            wait_for_all(arrived, count, bridge)
    found = numbers(arrived)
    assert found[0] == 0
    begun = [after for _, after in steps_back(found)]
    assert len(begun) <= 2
    assert all(after >= before for after, before in zip(begun, committed[1:], strict=False))
    assert totals(bridge)['confirmed'] <= count - committed[-1]
    assert bench.committed(bench.group, topic) == count


def test_guarantee_8_a_bridge_that_is_killed_at_rest_repeats_nothing(
    bench: Bench, topic: str, arrived: Path
) -> None:
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    bench.produce(topic, numbered(100))
    with bench.subscriber(ROS_TOPIC, arrived, samples=SAMPLES):
        with bench.bridge(config) as bridge:
            wait_for_lines(arrived, 100, bridge)
            eventually(lambda: bench.committed(bench.group, topic) == 100, 60)
            bridge.kill()
        bench.produce(topic, [b'100'])
        with bench.drained(config) as bridge:
            wait_for_lines(arrived, 101, bridge)
    assert numbers(arrived) == list(range(101))


def test_guarantee_1_a_killed_subscriber_of_the_default_lease_loses_what_its_cache_held(
    bench: Bench, topic: str, leave: Leave
) -> None:
    """Here that cache holds 50; a KEEP_ALL subscriber without a limit of its own has 5000."""
    bridge = one_dies_and_the_next_gets_the_rest(bench, topic, leave, FULL)
    assert totals(bridge)['published again'] >= 500 - SAMPLES


def test_guarantee_4_the_bridge_waits_for_a_subscriber_that_stops_for_10_s(
    bench: Bench, topic: str, arrived: Path, leave: Leave
) -> None:
    """Nothing is lost or doubled, and the order is kept."""
    count = 4000
    config = bench.config([to_ros(topic, ROS_TOPIC)], kafka=bench.patient_kafka)
    bench.produce(topic, numbered(count))
    options = (*SLOW, *leave.options)
    with (
        bench.subscriber(ROS_TOPIC, arrived, *options, samples=SAMPLES, lease_s=60) as subscriber,
        bench.drained(config) as bridge,
    ):
        leave.up_to(2000)
        wait_for_lines(arrived, 1000, bridge)
        subscriber.send(signal.SIGSTOP)
        # It says so once in 10 s.
        bridge.wait_for(FULL, count=bridge.output().count(FULL) + 2)
        committed = bench.committed(bench.group, topic)
        at_most = len(lines(arrived)) + SAMPLES + 1
        assert 0 < committed <= at_most
        leave.up_to(count)
        subscriber.send(signal.SIGCONT)
        wait_for_all(arrived, count, bridge)
    assert numbers(arrived) == list(range(count))
    assert totals(bridge).get('published again', 0) == 0


def test_guarantee_7_sigterm_in_mid_stream_and_a_new_start_lose_and_repeat_nothing(
    bench: Bench, topic: str, arrived: Path, leave: Leave
) -> None:
    count = 4000
    config = bench.config([to_ros(topic, ROS_TOPIC)], kafka=bench.patient_kafka)
    bench.produce(topic, numbered(count))
    with bench.subscriber(ROS_TOPIC, arrived, *SLOW, *leave.options, samples=SAMPLES):
        with bench.run(config) as bridge:
            leave.up_to(1500)
            wait_for_lines(arrived, 1500, bridge)
            bridge.send(signal.SIGTERM)
            bridge.wait_for('stopping: draining')
            leave.up_to(count)
            assert bridge.wait() == 0
        drained = totals(bridge)
        assert drained['given up'] == 0
        assert 1500 < drained['confirmed'] < count, 'it was to be stopped in mid-stream'
        assert bench.committed(bench.group, topic) == drained['confirmed']
        with bench.run(config) as bridge:
            wait_for_all(arrived, count, bridge)
            assert bridge.end() == 0
        assert totals(bridge)['confirmed'] == count - drained['confirmed']
    assert numbers(arrived) == list(range(count))


@pytest.mark.parametrize('signals', [1, 2])
def test_guarantee_7_what_a_drain_gives_up_is_said_and_read_again(
    bench: Bench, topic: str, arrived: Path, leave: Leave, signals: int
) -> None:
    """With one signal after `drain_s`; with a second one at once, whatever `drain_s` says."""
    count = 2000
    drain_s = 1 if signals == 1 else 300
    route = to_ros(topic, ROS_TOPIC, drain_s=drain_s)
    config = bench.config([route], kafka=bench.patient_kafka)
    bench.produce(topic, numbered(count))
    with bench.subscriber(ROS_TOPIC, arrived, *SLOW, *leave.options, samples=SAMPLES):
        with bench.bridge(config) as bridge:
            leave.up_to(1000)
            wait_for_lines(arrived, 1000, bridge)
            bridge.send(signal.SIGTERM)
            bridge.wait_for('stopping: draining')
            if signals == 2:
                bridge.send(signal.SIGTERM)
            assert bridge.wait() == 0
        assert 'gave up waiting for' in bridge.output()
        assert totals(bridge)['returned'] > 0
        committed = bench.committed(bench.group, topic)
        leave.up_to(2 * count)
        with bench.drained(config) as bridge:
            wait_for_all(arrived, count, bridge)
    found = numbers(arrived)
    assert found[0] == 0
    # What the held subscriber still gets of the first bridge may come again, and only that.
    assert [after for _, after in steps_back(found)] in ([], [committed])


# Two bridges in one group

PARTITIONS = 4
EACH = 800
RATE = 200.0  # of a partition


def words(partition: int, counted: Iterable[int]) -> Iterator[bytes]:
    return (b'%d %d' % (partition, number) for number in counted)


def by_partition(file: Path) -> dict[int, list[int]]:
    found = defaultdict(list)
    for line in lines(file):
        partition, number = line.split()
        found[int(partition)].append(int(number))
    return found


def wait_for_everywhere(file: Path, count: int, *bridges: Process) -> None:
    eventually(
        lambda: len(set(lines(file))) == count,
        60,
        lambda: '\n'.join([f'{len(set(lines(file)))}', *(b.output() for b in bridges)]),
    )


def test_guarantee_3_a_killed_bridge_of_two_hands_over_in_order_and_repeats_only_its_window(
    bench: Bench, topic_name: str, arrived: Path, leave: Leave
) -> None:
    # Less than one of the two reads: at the kill none is through.
    taken, window = EACH, 100
    route = to_ros(topic_name, ROS_TOPIC, max_in_flight=window)
    short = {**bench.patient_kafka, 'session.timeout.ms': 12_000}
    bench.create_topic(topic_name, partitions=PARTITIONS)
    with (
        bench.subscriber(ROS_TOPIC, arrived, *SLOW, *leave.options, samples=SAMPLES),
        bench.bridge(bench.config([route], kafka=bench.patient_kafka)) as survivor,
    ):
        survivor.wait_for(f'reads {topic_name}[0, 1, 2, 3]')
        with bench.bridge(bench.config([route], kafka=short)) as dying:
            wait_until_it_reads(dying, topic_name)
            for partition in range(PARTITIONS):
                bench.produce(topic_name, words(partition, range(EACH)), partition=partition)
            leave.up_to(taken)
            wait_for_lines(arrived, taken, survivor, dying)
            dying.kill()
        reads = re.compile(rf'reads {re.escape(topic_name)}\[\d')
        eventually(lambda: len(reads.findall(survivor.output())) == 2, 60, survivor.output)
        # The subscriber is held: nothing of what the survivor has just got is confirmed.
        committed = [bench.committed(bench.group, topic_name, p) for p in range(PARTITIONS)]
        leave.up_to(2 * PARTITIONS * EACH)
        wait_for_everywhere(arrived, PARTITIONS * EACH, survivor, dying)
        assert survivor.end() == 0
        # DDS has acknowledged the repeats; the subscriber may be writing them still.
        eventually(lambda: all(n[-1] == EACH - 1 for n in by_partition(arrived).values()), 30)
    assert totals(survivor)['confirmed'] > 2 * EACH
    repeated = {}
    for partition, found in by_partition(arrived).items():
        assert found[0] == 0
        if back := steps_back(found):
            repeated[partition] = [after for _, after in back]
    assert repeated == {partition: [committed[partition]] for partition in repeated}
    assert len(repeated) <= PARTITIONS // 2, 'what the survivor read itself is not repeated'


def test_guarantee_3_bridges_that_join_and_leave_in_mid_stream_lose_and_repeat_nothing(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """A hand-over waits until what is in flight is confirmed and committed, 5 s at most."""
    config = bench.config([to_ros(topic_name, ROS_TOPIC)], kafka=bench.patient_kafka)
    bench.create_topic(topic_name, partitions=PARTITIONS)
    streams = [
        Stream(bench, topic_name, words(partition, itertools.count()), RATE, partition)
        for partition in range(PARTITIONS)
    ]
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.bridge(config) as leaving,
        ExitStack() as stack,
    ):
        for stream in streams:
            stack.enter_context(stream)
        wait_for_lines(arrived, 100, leaving)
        with bench.drained(config) as joining:
            wait_until_it_reads(joining, topic_name)
            wait_for_lines(arrived, len(lines(arrived)) + 300, leaving, joining)
            assert leaving.end() == 0
            for stream in streams:
                stream.wait_beyond(stream.sent)
                stream.end()
            count = sum(stream.sent for stream in streams)
            wait_for_everywhere(arrived, count, leaving, joining)
    assert f'hands over {topic_name}[' in leaving.output()
    confirmed = totals(leaving)['confirmed'], totals(joining)['confirmed']
    assert sum(confirmed) == count
    assert min(confirmed) > 0
    expected = {partition: list(range(stream.sent)) for partition, stream in enumerate(streams)}
    assert dict(by_partition(arrived)) == expected


# The broker


def test_guarantee_1_all_arrive_once_through_a_restart_of_the_broker(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, arrived: Path
) -> None:
    """How long it takes until they flow again: `python -m benchmarks.faults`."""
    bench, values = own_bench, (b'%d' % number for number in itertools.count())
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    bench.create_topic(topic_name, partitions=2)
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.bridge(config) as bridge,
        Stream(bench, topic_name, values, rate=RATE) as stream,
    ):
        wait_for_lines(arrived, 300, bridge)
        with stream.held():
            own_kafka.stop()
        bridge.wait_for('Kafka is away')
        wait_until_lost(bridge, topic_name)
        own_kafka.start()
        bridge.wait_for('Kafka is back')
        stream.end()
        count = stream.sent
        wait_for_all(arrived, count, bridge)
        # And the partition that had nothing before.
        bench.produce(topic_name, numbered(10), partition=1)
        wait_for_lines(arrived, count + 10, bridge)
        assert bridge.end() == 0
    assert numbers(arrived) == [*range(count), *range(10)]
    assert totals(bridge)['confirmed'] == count + 10
    assert 'ERROR' not in bridge.output()
    assert bench.committed(bench.group, topic_name) == count


def test_a_stop_of_a_bridge_that_kafka_has_not_heard_of_says_that_records_are_repeated(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    own_bench.produce(own_topic, numbered(20_000))
    # Slow, so that some are published and not committed whenever Kafka stands still.
    route = to_ros(own_topic, ROS_TOPIC, max_rate=100, min_subscribers=0)
    with own_bench.bridge(own_bench.config([route])) as bridge:
        eventually(lambda: own_bench.committed(own_bench.group, own_topic) > 0, 60, bridge.output)
        os.kill(own_kafka.pid, signal.SIGSTOP)
        try:
            bridge.wait_for(f'lost {own_topic}[0]', 60)
            assert bridge.end(40) == 0, bridge.output()
        finally:
            os.kill(own_kafka.pid, signal.SIGCONT)
    assert 'the last offsets are not committed: some records are repeated' in bridge.output()
