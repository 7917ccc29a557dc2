"""A cluster of three real brokers loses its leader, twice, while numbers cross it both ways.

The second one dies when the first is back and in sync, so that one of three is away at a time.
"""

from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path

import pytest
from support.bridges.numbers_to_ros import SAMPLES
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave

from rig.local_cluster import LocalCluster

DOWN = '/down'  # Kafka -> ROS
UP = '/up'  # ROS -> Kafka
RATE = 100.0
EACH = 1000


@pytest.fixture
def cluster() -> Iterator[LocalCluster]:
    """Three brokers for one test."""
    with LocalCluster() as nodes:
        yield nodes


def test_guarantees_1_2_3_a_leader_killed_in_mid_stream_loses_and_doubles_nothing(
    cluster: LocalCluster, tmp_path: Path, ros_domain: int, unique: Callable[[str], str]
) -> None:
    down, up, arrived = unique('down'), unique('up'), tmp_path / 'arrived'
    bench = Bench(tmp_path, cluster.bootstrap_servers, ros_domain)
    cluster.create_topic(down)
    cluster.create_topic(up)
    config = bench.config([to_ros(down, DOWN), to_kafka(UP, up)])
    taken = Leave(tmp_path, 'taken')
    with (
        bench.subscriber(DOWN, arrived, *taken.options, samples=SAMPLES),
        bench.drained(config) as bridge,
    ):
        bridge.wait_for(f'reads {down}[0]', timeout_s=90)

        def wait_for(down_line: bytes, up_count: int) -> None:
            line = down_line.decode()
            eventually(lambda: line in lines(arrived), 90, bridge.output)
            eventually(lambda: bench.reaches(up, up_count), 90, bridge.output)

        for stream, led in enumerate((down, up)):
            lost, leave = cluster.leader(led), Leave(tmp_path, f'leave-{stream}')
            with published(bench, stream, leave):
                # Nobody gets further than half of it before the leader is dead.
                taken.up_to(len(lines(arrived)) + EACH // 2)
                leave.up_to(50)
                bench.produce(down, numbers(stream))
                wait_for(numbers(stream)[50], stream * EACH + 50)
                leave.set_off(EACH // 2)
                cluster.kill(lost)
                taken.up_to(10 * EACH)
                leave.up_to(EACH)
                wait_for(numbers(stream)[-1], (stream + 1) * EACH)
            cluster.start(lost)
            for name in (down, up, '__consumer_offsets'):
                cluster.wait_until_in_sync(name)
    expected = [value.decode() for stream in range(2) for value in numbers(stream)]
    # The coordinator of the group may have died with the leader: then the group gives the bridge
    # up after 6 s, and what was not committed is read again.
    given_up = 'Kafka has not heard of this bridge' in bridge.output()
    found = lines(arrived)
    assert list(dict.fromkeys(found)) == expected
    assert given_up or found == expected
    records = bench.records(up, len(expected))
    assert values(records) == [line.encode() for line in expected]
    told = [(headers(record)['ros.gid'], int(headers(record)['ros.seq'])) for record in records]
    for _, publishers in groupby(told, key=lambda one: one[0]):
        assert [seq for _, seq in publishers] == list(range(1, EACH + 1))
    assert totals(bridge, 'to_kafka')['confirmed'] == len(expected)
    counted = totals(bridge)
    # What was published, and not confirmed when the group gave the bridge up, counts as returned.
    assert counted['confirmed'] <= len(found) <= counted['confirmed'] + counted.get('returned', 0)
    assert given_up or counted['confirmed'] == len(found)
    assert counted.get('published again', 0) == 0
    assert bench.committed(bench.group, down) == len(expected)


def numbers(stream: int) -> list[bytes]:
    return [b'%d %d' % (stream, number) for number in range(EACH)]


def published(bench: Bench, stream: int, leave: Leave) -> Process:
    """Publish the numbers of a stream at a rate."""
    options = ('--count', str(EACH), '--rate', str(RATE), '--prefix', f'{stream} ')
    return bench.publisher(UP, *options, *leave.options)
