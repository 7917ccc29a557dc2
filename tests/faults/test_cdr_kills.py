"""CDR bytes both ways while the bridge is killed: what arrives is what was sent, byte by byte.

The guarantees are those of docs: 1 and 2 at least once, 3 order, 8 what SIGKILL can cost.
"""

from functools import cache
from pathlib import Path

import pytest
from support.bridges.numbers_to_kafka import LATCHED, published, seqs
from support.bridges.numbers_to_ros import SAMPLES, steps_back, wait_for_lines
from support.bridges.routes import lines, totals, values
from support.formats.messages import cdr_of, exact_of, random_message
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave
from support.ros.raw import publish, route

from ros2_kafka_bridge.ros.fastdds_profile import FASTDDS_3, Histories, make_profile

JOINTS = 'sensor_msgs/msg/JointState'
"""Texts, arrays of any length, gaps between; `header.stamp.sec` is the number of a message."""
COUNT = 3000


@cache
def sent() -> tuple[bytes, ...]:
    """Random messages, of which no two are the same."""
    made = []
    for number in range(COUNT):
        message = random_message(JOINTS, number)
        message.header.stamp.sec = number
        made.append(cdr_of(message, JOINTS))
    return tuple(made)


def test_each_byte_of_a_latched_history_comes_to_kafka_once_through_sigkills_guarantees_2_3_8(
    bench: Bench, topic: str, leave: Leave
) -> None:
    config = bench.config([route('/joints', topic, JOINTS, 'to_kafka')], ros={'lease_s': 3})
    options = (*LATCHED, *leave.options)
    with publish(bench, '/joints', sent(), *options, message_type=JOINTS) as publisher:
        for held in (1000, 2000):
            leave.up_to(held)
            with bench.bridge(config) as bridge:
                eventually(lambda: bench.reaches(topic, held - 700), 60, bridge.output)  # noqa: B023 (called here)
                bridge.kill()
            assert not published(publisher)
        leave.up_to(COUNT)
        with bench.drained(config) as bridge:
            records = bench.records(topic, COUNT)
    assert seqs(records) == list(range(1, COUNT + 1))
    assert tuple(values(records)) == sent()


def reader(bench: Bench, file: Path, leave: Leave, patch: pytest.MonkeyPatch) -> Process:
    """Start a subscriber that takes few messages into its DDS cache."""
    profile = bench.place / 'reader.xml'
    profile.write_text(make_profile(Histories({}, {'/joints': SAMPLES})))
    with patch.context() as its_own:
        its_own.setenv(FASTDDS_3.variable, str(profile))
        words = '/joints', str(file), '--type', JOINTS, '--form', 'hex'
        return bench.peer('subscriber', *words, *leave.options)


def test_each_byte_comes_to_ros_through_sigkills_and_only_the_uncommitted_again_guarantees_1_8(
    bench: Bench, arrived: Path, topic: str, leave: Leave, monkeypatch: pytest.MonkeyPatch
) -> None:
    committed: list[int] = []
    made = {
        'name': 'to_ros',
        'from': {'kafka': topic, 'start': 'earliest'},
        'to': {'ros': '/joints', 'type': JOINTS},
        'format': 'cdr',
    }
    config = bench.config([made])
    bench.produce(topic, sent())
    with reader(bench, arrived, leave, monkeypatch):
        for held in (1000, 2000):
            leave.up_to(held)
            with bench.bridge(config) as bridge:
                wait_for_lines(arrived, held - 700, bridge)
                before = max(committed, default=0)
                eventually(
                    lambda: bench.committed(bench.group, topic) > before,  # noqa: B023 (called here)
                    60,
                    bridge.output,
                )
                committed.append(bench.committed(bench.group, topic))
                bridge.kill()
        leave.up_to(2 * COUNT)
        with bench.drained(config) as bridge:
            eventually(lambda: sent()[-1].hex() in lines(arrived)[-1], 60, bridge.output)
    assert totals(bridge)['confirmed'] <= COUNT - committed[-1]
    number_of = {value: number for number, value in enumerate(sent())}
    found = [number_of[exact_of(JOINTS)(bytes.fromhex(line))] for line in lines(arrived)]
    assert found[0] == 0
    again = [after for _, after in steps_back(found)]
    assert len(again) <= len(committed)
    assert all(after >= before for after, before in zip(again, committed, strict=False))
    assert committed[-1] <= 2000 + SAMPLES, 'the subscriber held the bridge in mid-stream'
    assert bench.committed(bench.group, topic) == COUNT
