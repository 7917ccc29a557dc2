"""A disk that is full under a running bridge: it waits, says so, loses nothing, and goes on.

The guarantees are those of docs: 2 at least once, 3 order, 4 full means wait, 6 counters balance.
One part at a time: tests/unit/spool/test_full_backlog.py, tests/unit/spool/test_crash.py.
"""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from support.bridges.numbers_to_kafka import published
from support.bridges.routes import totals, values
from support.bridges.spooled import WINDOW, arrived, numbers, route
from support.bridges.workers import sized, there_and_back
from support.patience import patient
from support.processes.harness import START, Bench, eventually
from support.processes.lifetimes import Leave
from support.spools.small_disks import fill, mounted

from rig.processes import END_S, KILLED_S
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

FULL = 'cannot be written: database or disk is full'
FIRST = 500
COUNT = 8000
"""More than the window, the reader's cache, a batch and the publisher's own history can hold."""


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system that holds all messages of a test, and not much more."""
    with mounted(tmp_path / 'disk', '16m') as place:
        yield place


@pytest.mark.parametrize('back_first', ['room', 'Kafka'])
@pytest.mark.kills_kafka
def test_a_full_disk_while_kafka_is_away_holds_publishers_back_at_no_cost_guarantees_2_3_4_6(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str, disk: Path, leave: Leave,
    back_first: str,
) -> None:  # fmt: skip
    """With room again, the disk takes what has waited; with Kafka again, it needs no disk."""
    bench = own_bench
    config = bench.config([route(bench, own_topic, path=str(disk))])
    options = (*leave.options, '--count', str(COUNT))
    with bench.drained(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(FIRST)
        eventually(lambda: arrived(bench, own_topic) == FIRST, 60, bridge.output)
        ballast = fill(disk)
        bench.close()
        os.kill(own_kafka.pid, signal.SIGSTOP)  # so that the window fills
        leave.up_to(COUNT)
        bridge.wait_for(FULL)
        own_kafka.kill()
        bridge.wait_for('Kafka is away')
        waits = re.compile(rf'waiting \(.*{FULL}.*\): .* {WINDOW} in flight')
        eventually(lambda: bool(waits.search(bridge.output())), 60, bridge.output)
        assert not published(publisher), 'it is held back'
        if back_first == 'room':
            ballast.unlink()
            bridge.wait_for('the spool can be written again')
            publisher.wait_for('published')
        own_kafka.start()
        eventually(lambda: COUNT - 1 in numbers(bench, own_topic)[-1:], 60, bridge.output)
    found = totals(bridge, 'to_kafka')
    assert found['taken'] == found['confirmed'] == COUNT
    assert numbers(bench, own_topic) == list(range(COUNT))


def test_a_route_that_always_writes_first_waits_for_a_full_disk_and_goes_on_guarantees_2_3_4_6(
    bench: Bench, topic: str, disk: Path, leave: Leave
) -> None:
    config = bench.config([route(bench, topic, mode='always', path=str(disk))])
    options = (*leave.options, '--count', str(COUNT))
    with bench.drained(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(1)  # more of them would leave room in the file
        eventually(lambda: arrived(bench, topic) == 1, 60, bridge.output)
        ballast = fill(disk)
        leave.up_to(COUNT)
        waits = re.compile(rf'waiting \(.*{FULL}.*\): ')
        eventually(lambda: bool(waits.search(bridge.output())), 60, bridge.output)
        assert not published(publisher), 'it is held back'
        assert arrived(bench, topic) < WINDOW, (
            'though Kafka is there, it does not go past the disk'
        )
        ballast.unlink()
        bridge.wait_for('the spool can be written again')
        eventually(lambda: arrived(bench, topic) == COUNT, 60, bridge.output)
    found = totals(bridge, 'to_kafka')
    assert found['taken'] == found['confirmed'] == COUNT
    assert numbers(bench, topic) == list(range(COUNT))


@contextmanager
def logging_to(log: Path, bench: Bench, config: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a bridge whose standard error goes into a file of the test."""
    with log.open('ab') as file:
        command = [sys.executable, *START, '--', str(config)]
        process = subprocess.Popen(command, stderr=file, env=bench.environ, process_group=0)
    try:
        yield process
    finally:
        process.kill()
        process.wait(patient(KILLED_S))


def test_a_log_on_a_full_disk_holds_no_message_up_and_says_later_what_was_left_out(
    bench: Bench, topic: str, disk: Path
) -> None:
    returned, log, count = f'{topic}.returned', disk / 'log', 1000
    bench.create_topic(returned)
    config = bench.config(there_and_back(topic), kafka=bench.patient_kafka)
    ballast = fill(disk)
    with logging_to(log, bench, config) as process:
        bench.produce(topic, sized(count))
        eventually(partial(bench.reaches, returned, count), 90, lambda: f'{process.poll()=}')
        assert log.read_bytes() == b'', 'it could not write a line'
        ballast.unlink()
        process.terminate()
        assert process.wait(patient(END_S)) == 0
    assert values(bench.records(returned, count)) == sized(count)
    assert 'of this log left out here: it could not be written' in log.read_text()
    assert f'to_kafka: stopped: {count} taken, {count} confirmed' in log.read_text()
