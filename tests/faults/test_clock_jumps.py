"""The clock of the day is set forward while a bridge runs; the others are as they were.

Not back: librdkafka and the wheels of ROS 2 wait until a time of the day, and so for longer then.
"""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Final

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.bridges.spooled import arrived, numbers, on_disk, route
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import Leave
from support.processes.preloads import WallClock

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

COUNT: Final = 500
HOUR_S: Final = 3600.0
DAY_S: Final = 24 * HOUR_S
SINCE_1970_S: Final = time.time() - DAY_S  # of a robot without a battery for its clock
PYTHON: Final = Path(sys.executable)  # not forked: LD_PRELOAD counts at the start


@pytest.fixture
def clock(tmp_path: Path) -> WallClock:
    return WallClock(tmp_path)


def test_a_clock_that_is_set_forward_stops_nothing_and_loses_nothing(
    bench: Bench, clock: WallClock, topic_name: str
) -> None:
    returned = f'{topic_name}.returned'
    config = bench.config([to_ros(topic_name, '/orders'), to_kafka('/orders', returned)])
    bench.create_topic(topic_name, returned, retention_ms='-1')  # else what is of 1970 is deleted
    clock.set_ahead(-SINCE_1970_S)
    sent: list[bytes] = []
    with bench.drained(config, python=PYTHON, **clock.environ) as bridge:
        for behind_s in (SINCE_1970_S, 3 * DAY_S, 2 * DAY_S, DAY_S, HOUR_S, 0.0):
            clock.set_ahead(-behind_s)
            new = [b'%d' % number for number in range(len(sent), len(sent) + COUNT)]
            bench.produce(topic_name, new)
            sent += new
            # The first of them has come, the others are on their way: or nothing is, by turns.
            far = len(sent) if behind_s in {SINCE_1970_S, 2 * DAY_S} else len(sent) - COUNT + 1
            eventually(partial(bench.reaches, returned, far), 60, bridge.output)
        assert values(bench.records(returned, len(sent))) == sent
    for name in ('to_ros', 'to_kafka'):
        assert totals(bridge, name)['confirmed'] == len(sent)
    assert ' WARNING ' not in bridge.output()
    assert ' ERROR ' not in bridge.output()


@pytest.mark.parametrize('behind_s', [DAY_S, SINCE_1970_S], ids=['a day', 'since 1970'])
def test_what_is_in_the_spool_is_sent_though_the_clock_was_set_past_its_age(
    own_bench: Bench, own_kafka: LocalKafka, clock: WallClock, topic_name: str, behind_s: float
) -> None:
    leave = Leave(own_bench.place)
    clock.set_ahead(-behind_s)
    own_bench.create_topic(topic_name, retention_ms='-1')
    spooled = route(own_bench, topic_name, mode='when_away', max_age_s=HOUR_S)
    config = own_bench.config([spooled])
    with (
        own_bench.drained(config, python=PYTHON, **clock.environ) as bridge,
        own_bench.publisher('/orders', *leave.options, '--count', str(4 * COUNT)) as robot,
    ):
        leave.up_to(COUNT)
        eventually(lambda: arrived(own_bench, topic_name) == COUNT, 60, bridge.output)
        own_kafka.stop()
        leave.up_to(3 * COUNT)  # what is in the window is not looked at
        eventually(lambda: on_disk(own_bench) >= 2 * COUNT, 60, bridge.output)
        clock.set_ahead(0.0)
        leave.up_to(4 * COUNT)
        robot.wait_for('published')
        eventually(lambda: on_disk(own_bench) >= 3 * COUNT, 60, bridge.output)
        own_kafka.start()
        bridge.wait_for('the spool is empty again')
    assert numbers(own_bench, topic_name) == list(range(4 * COUNT))
    assert 'dropped' not in totals(bridge, 'to_kafka')


def test_commands_wait_for_a_clock_that_is_not_set(
    bench: Bench, clock: WallClock, topic_name: str, tmp_path: Path
) -> None:
    commands = tmp_path / 'commands'
    bench.create_topic(topic_name, message_timestamp_after_max_ms=str(2**63 - 1))
    now_ms = int(time.time() * 1000)
    bench.produce(topic_name, [b'old'], timestamp=now_ms - int(HOUR_S * 1000))
    bench.produce(topic_name, [b'in microseconds'], timestamp=now_ms * 1000)
    new = [f'new {number}' for number in range(10)]
    bench.produce(topic_name, [text.encode() for text in new])
    config = bench.config([to_ros(topic_name, '/commands', max_age_s=HOUR_S / 2)])
    clock.set_ahead(-SINCE_1970_S)
    with (
        bench.subscriber('/commands', commands),
        bench.drained(config, python=PYTHON, **clock.environ) as bridge,
    ):
        bridge.wait_for("max_age_s: this machine's clock says 1970-01-02, and this version")
        assert not lines(commands)
        clock.set_ahead(0.0)
        eventually(lambda: len(lines(commands)) == len(new), 60, bridge.output)
    assert lines(commands) == new
    counted = totals(bridge)
    assert (counted['confirmed'], counted['dropped'], counted['dead-lettered']) == (10, 1, 1)
