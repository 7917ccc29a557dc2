"""What becomes of a bridge and of the demonstration when their terminal is closed (SIGHUP)."""

import os
import signal
import sys
from functools import partial
from pathlib import Path

import pytest
from support.bridges.workers import sized, there_and_back
from support.patience import patient
from support.processes.harness import Bench, Process, eventually
from support.processes.terminal import terminal

from rig.processes import END_S

COMMAND = (sys.executable, '-m', 'ros2_kafka_bridge')


@pytest.mark.parametrize('workers', [1, 2])
def test_guarantee_7_a_closed_terminal_is_a_drain(
    bench: Bench, topic: str, returned: str, workers: int
) -> None:
    """As SIGTERM is; what that is worth in mid-stream is shown there (test_both_ways)."""
    config = bench.config(there_and_back(topic), workers=workers)
    bench.produce(topic, sized(10))
    log = bench.place / 'stderr.log'
    with terminal(*COMMAND, 'run', str(config), environ=bench.environ, log=log) as it:
        eventually(partial(bench.reaches, returned, 10), 60, log.read_text)
        it.close()
        assert it.program.wait(patient(END_S)) == 0, log.read_text()
    assert log.read_text().count('stopping: draining') == 1
    assert 'Traceback' not in log.read_text()
    assert bench.committed(bench.group, topic) == 10


@pytest.mark.parametrize('workers', [1, 2])
def test_a_bridge_under_nohup_outlives_its_terminal(
    bench: Bench, topic: str, returned: str, workers: int
) -> None:
    config = bench.config(there_and_back(topic), workers=workers)
    bench.produce(topic, [b'before'])
    command = ['nohup', *COMMAND, 'run', str(config)]
    with Process(command, bench.place / 'nohup.log', {'ROS_DOMAIN_ID': str(bench.domain)}) as it:
        eventually(partial(bench.reaches, returned, 1), 60, it.output)
        os.killpg(it.pid, signal.SIGHUP)
        bench.produce(topic, [b'after'])
        eventually(partial(bench.reaches, returned, 2), 60, it.output)
        assert 'stopping' not in it.output()
        assert it.end(40) == 0


def test_a_demonstration_whose_terminal_is_closed_ends_in_order_and_leaves_nothing(
    bench: Bench, tmp_path: Path
) -> None:
    place = tmp_path / 'place'
    place.mkdir()
    environ = {**bench.environ, 'TMPDIR': str(place), 'TERM': 'xterm-256color'}
    options = ('--rate', '200', '--seconds', '300')
    with terminal(*COMMAND, 'demo', *options, environ=environ) as it:
        eventually(lambda: it.shows(b'sending'), 60, it.shown)
        it.close()
        status = it.program.wait(patient(60))
    assert status == 0
    assert list(place.iterdir()) == [], 'nothing is left'
