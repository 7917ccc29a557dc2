"""A bridge as a service of systemd: what it tells it, and the unit file."""

import os
import re
import shutil
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.bridges.reloads import Reloaded
from support.bridges.routes import to_ros
from support.bridges.workers import pids
from support.processes.harness import Bench, Process, eventually
from support.processes.terminal import finished

from ros2_kafka_bridge.protocol.limits import STUCK_S
from ros2_kafka_bridge.route.counters import Counters, to_line

UNIT = Path(__file__).parents[2] / 'packaging/systemd/ros2-kafka-bridge@.service'
OFF = {'listen': 'off', 'node': False}


class Manager:
    """The end of systemd: a socket, and what came."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._socket.setblocking(False)  # noqa: FBT003 (the standard library's)
        self.told: list[str] = []

    def lines(self, start: str) -> list[str]:
        """Those lines so far that begin so."""
        try:
            while True:
                self.told += self._socket.recv(4096).decode().split('\n')
        except BlockingIOError:
            return [line for line in self.told if line.startswith(start)]

    def hears(self, line: str, count: int = 1) -> None:
        """Wait until a line has come."""
        eventually(lambda: len(self.lines(line)) >= count, 60, lambda: f'{line}: {self.told}')

    def close(self) -> None:
        self._socket.close()


@contextmanager
def manager(address: str) -> Iterator[Manager]:
    found = Manager(address)
    try:
        yield found
    finally:
        found.close()


def _service(bench: Bench, config: Path, address: str, watchdog_usec: str) -> Process:
    return bench.run(config, NOTIFY_SOCKET=address, WATCHDOG_USEC=watchdog_usec)


@pytest.mark.parametrize('more', [{}, {'monitoring': OFF}], ids=['one process', 'watched'])
def test_systemd_hears_of_the_start_each_reload_the_stop_and_that_the_bridge_lives(
    bench: Bench, topic: str, tmp_path: Path, more: dict[str, Any]
) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    config = bench.config(routes, **more)
    address = str(tmp_path / 'notify')
    began_usec = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    with manager(address) as it, _service(bench, config, address, '1000000') as process:
        it.hears('READY=1')
        it.hears('WATCHDOG=1', count=3)
        reloaded = Reloaded(bench, process, config, **more)
        added = to_ros(topic, '/b', name='b', min_subscribers=0)
        reloaded.to([*routes, added])
        it.hears('READY=1', count=2)
        order = [line for line in it.lines('') if line in {'READY=1', 'RELOADING=1'}]
        assert order == ['READY=1', 'RELOADING=1', 'READY=1']
        (usec,) = it.lines('MONOTONIC_USEC=')
        assert int(usec.partition('=')[2]) > began_usec
        worker = pids(process, 1)[0]
        assert b'NOTIFY_SOCKET' not in Path(f'/proc/{worker}/environ').read_bytes()
        reloaded.write([to_ros(topic, 'bad')])
        reloaded.ask()
        it.hears('READY=1', count=3)
        # Told when something changes, at most every ten seconds: one has just begun.
        eventually(lambda: it.lines('STATUS=')[-1] == 'STATUS=active: 2 routes', 30)
        assert process.end(40) == 0, process.output()
        assert it.lines('STOPPING=1') == ['STOPPING=1']


def test_a_route_that_is_stuck_gives_no_sign_of_life(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    """Its worker stands still, and what it has said last is that its route was seen long ago."""
    config = bench.config([to_ros(topic, '/a', min_subscribers=0)], monitoring=OFF)
    address = str(tmp_path / 'notify')
    with manager(address) as it, _service(bench, config, address, '400000') as process:
        it.hears('READY=1')
        process.wait_for('to_ros: running', 60)
        worker = pids(process, 1)[0]
        os.kill(worker, signal.SIGSTOP)
        long_ago = Counters('to_ros').snapshot(0)._replace(beat_s=time.monotonic() - STUCK_S - 1)
        _say(worker, to_line([long_ago]))
        count = -1
        end_s = time.monotonic() + 60
        while (now := len(it.lines('WATCHDOG=1'))) != count:
            assert time.monotonic() < end_s, 'it says that it lives'
            count = now
            time.sleep(2)  # a sign comes ten times a second
        os.kill(worker, signal.SIGCONT)
        it.hears('WATCHDOG=1', count=count + 1)
        assert process.end(40) == 0, process.output()


def _say(worker: int, line: bytes) -> None:
    """Write into the pipe through which a worker tells its supervisor how it is."""
    words = Path(f'/proc/{worker}/cmdline').read_bytes().decode().split('\0')
    (number,) = [word.partition('=')[2] for word in words if word.startswith('--snapshots=')]
    with Path(f'/proc/{worker}/fd/{number}').open('wb', buffering=0) as pipe:
        pipe.write(line)


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='needs systemd-analyze')
def test_the_unit_file_is_one_that_systemd_takes(tmp_path: Path) -> None:
    program = tmp_path / 'ros2-kafka-bridge'
    program.write_text('#!/bin/sh\n')
    program.chmod(0o755)
    unit = tmp_path / UNIT.name
    unit.write_text(re.sub(r'(?m)^ExecStart=\S+', f'ExecStart={program}', UNIT.read_text()))
    done = finished(['systemd-analyze', 'verify', str(unit)])
    said = [line for line in done.stderr.splitlines() if 'notify-reload' not in line]
    assert said == [], 'an older systemd takes Type=notify, and says that it does not know more'
