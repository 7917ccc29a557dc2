"""How much memory a route takes whose messages are large, and what is said of that."""

import os
import re
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from support.processes.harness import Bench, Process, eventually
from support.ros.cameras import IMAGE, camera, from_camera
from support.ros.robots import installed, robot

from benchmarks.vitals import Vitals, vitals, watched
from rig.patience import patient
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

MIB = 1 << 20
GIVEN_BACK_S = 1.5  # each second, and a machine may be slow
KEPT = 'DDS keeps 67 messages (max_cache_bytes) of up to 1,000,000 bytes'


def anon_bytes(process: Process) -> int:
    return 1024 * vitals(process.pid).anon_kib


def most_bytes(bridge: Process) -> int:
    """How much memory the route takes at most, as the bridge says."""
    return 1_000_000 * int(re.findall(r'at most (\d+) MB of memory', bridge.output())[0])


@pytest.mark.parametrize(
    ('depth', 'when_full'),
    [('10', 'wait'), ('0', 'wait'), ('10', 'drop_oldest')],
    ids=['KEEP_LAST', 'KEEP_ALL', 'drop_oldest'],
)
def test_a_camera_takes_no_more_memory_than_is_told_while_kafka_is_away_and_when_it_is_back(
    own_bench: Bench, own_topic: str, own_kafka: LocalKafka, depth: str, when_full: str
) -> None:
    small = {'source': {'type': IMAGE}, 'max_cache_bytes': 16 * MIB}
    route = from_camera(own_topic, when_full=when_full, **small)
    with own_bench.drained(own_bench.config([route])) as bridge:
        bridge.wait_for('subscribes to /camera')
        before_bytes = anon_bytes(bridge)
        with camera(own_bench, '--depth', depth):
            eventually(lambda: own_bench.end_offset(own_topic) > 5, 60, bridge.output)
            with watched(lambda: bridge.pid, 0.05) as seen:
                os.kill(own_kafka.pid, signal.SIGSTOP)
                try:
                    is_full = 40 * MIB  # the cache, the window and what the producer has
                    eventually(lambda: anon_bytes(bridge) - before_bytes > is_full, 60)
                    bridge.wait_for('waiting', 60)
                    time.sleep(patient(2 * GIVEN_BACK_S))
                finally:
                    os.kill(own_kafka.pid, signal.SIGCONT)
                held = own_bench.end_offset(own_topic)
                eventually(lambda: own_bench.end_offset(own_topic) > held + 200, 60)
        assert most_that_lasted(seen) - before_bytes <= most_bytes(bridge)
        is_rest = 30 * MIB  # of the cache, which DDS keeps
        eventually(lambda: anon_bytes(bridge) - before_bytes < is_rest, 60, bridge.output)


def most_that_lasted(seen: Sequence[Vitals]) -> int:
    """What was there at most, in bytes, without what is freed and about to be given back."""
    begins = [it for it in seen if it.at_s + GIVEN_BACK_S <= seen[-1].at_s]
    return 1024 * max(min(lasting(seen, begin.at_s)) for begin in begins)


def lasting(seen: Sequence[Vitals], begin_s: float) -> list[int]:
    return [it.anon_kib for it in seen if 0 <= it.at_s - begin_s <= GIVEN_BACK_S]


def test_a_type_that_the_file_does_not_name_is_looked_up_before_the_bridge_joins_the_graph(
    bench: Bench, topic: str
) -> None:
    config = bench.config([from_camera(topic)])
    with camera(bench, '--readers', '0'), bench.drained(config) as bridge:
        bridge.wait_for(KEPT)


def test_a_type_that_a_robot_alone_has_is_looked_up_there(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    made = installed(tmp_path, 'acme_cameras', {'Picture': 'uint8[] data\n'})
    config = bench.config([from_camera(topic)])
    picture = bytes.fromhex('000100000200000001020000')
    with (
        robot(bench, 'acme_cameras/msg/Picture', made, publishes={'/camera': [picture]}),
        bench.drained(config) as bridge,
    ):
        bridge.wait_for(KEPT)
        bench.records(topic, 1)


def test_where_nobody_was_there_the_log_says_what_is_kept_and_the_cure(
    bench: Bench, topic: str
) -> None:
    with bench.drained(bench.config([from_camera(topic)])) as bridge:
        bridge.wait_for('DDS keeps as many as of small ones')
        bridge.wait_for('waits for a publisher of /camera')
        with camera(bench):
            bridge.wait_for('at most 2,044 MB of memory: DDS keeps 2,000 messages')
            bridge.wait_for('67 would fit into max_cache_bytes')
            bridge.wait_for('set from.type, or start it again')
            bench.records(topic, 1)


def test_a_number_in_the_file_counts_whatever_the_type_is(bench: Bench, topic: str) -> None:
    config = bench.config([from_camera(topic, source={'type': IMAGE, 'max_samples': 300})])
    with bench.drained(config) as bridge:
        bridge.wait_for('subscribes to /camera')
    assert 'max_cache_bytes' not in bridge.output()
    status, said, _ = bench.command('check', str(config))
    assert (status, 'at most 344 MB of memory' in said) == (0, True), said


def test_what_another_route_of_the_topic_needs_is_kept_and_said_so(
    bench: Bench, topic: str
) -> None:
    more = {'ros': '/camera', 'type': IMAGE, 'max_samples': 300}
    routes = [
        from_camera(topic, source={'type': IMAGE}),
        {**from_camera(topic), 'name': 'other', 'from': more},
    ]
    with bench.drained(bench.config(routes)) as bridge:
        bridge.wait_for('other: subscribes to /camera')
        bridge.wait_for('camera: subscribes to /camera')
    assert 'was not known' not in bridge.output()
    _, said, _ = bench.command('check', '--connect', str(bench.config(routes)))
    kept = 'DDS keeps 300 messages (more than this route needs) of up to 1,000,000 bytes'
    assert kept in ' '.join(said.split()), said


def test_check_says_the_same_as_the_bridge(bench: Bench, topic: str) -> None:
    config = bench.config([from_camera(topic)])
    with camera(bench, '--readers', '0'):
        _, said, _ = bench.command('check', '--connect', str(config))
    assert KEPT in ' '.join(said.split()), said


def test_check_says_what_is_kept_where_nobody_is_there_and_the_cure(
    bench: Bench, topic: str
) -> None:
    _, said, _ = bench.command('check', '--connect', str(bench.config([from_camera(topic)])))
    said = ' '.join(said.split())
    assert 'if each of the 2,000 messages (max_samples) that DDS keeps had 1,000,000 bytes' in said
    assert 'kept as if they were small; set from.type' in said, said
