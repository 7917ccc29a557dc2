"""What tests of a reload share: a bridge, its file, and its SIGHUP."""

import contextlib
import os
import re
import signal
from pathlib import Path
from typing import Any

import msgspec
from harness import Bench, Process, eventually

from ros2_kafka_bridge.protocol.monitor import Do, Request

DONE = 'reloaded: '
REFUSED = 'refused: all goes on as it was'


class Reloaded:
    """A bridge whose file is changed while it runs.

    Args:
        bench: Where it runs.
        process: The bridge.
        config: Its file.
        more: What its file has beside the routes, each time.
    """

    def __init__(self, bench: Bench, process: Process, config: Path, **more: Any) -> None:
        self._bench = bench
        self._config = config
        self._more = more
        self.process = process
        self.times = 0

    def write(self, routes: list[dict[str, Any]], **more: Any) -> None:
        """Change the file."""
        self._bench.config(routes, **{**self._more, **more}).replace(self._config)

    def ask(self) -> None:
        """Ask for a reload."""
        self.process.send(signal.SIGHUP)

    def to(self, routes: list[dict[str, Any]], **more: Any) -> str:
        """Change the file and reload it; returns what the bridge says that it has done."""
        self.write(routes, **more)
        self.times += 1
        self.ask()
        self.process.wait_for(DONE, 120, count=self.times)
        return self.process.output().split(DONE)[-1].split('\n')[0]


def request(process: Process, do: Do, route: str = '') -> None:
    """Ask a supervisor for something, through the pipe of the process that watches the bridge."""
    line = msgspec.json.encode(Request(1_000_000, do, route)) + b'\n'
    eventually(lambda: _write(process, line), 60, process.output)


def _write(process: Process, line: bytes) -> bool:
    monitor = int(re.findall(r'the monitor is process (\d+)', process.output())[-1])
    shared = _pipes(process.pid)
    for number, pipe in _pipes(monitor).items():
        if number > 2 and pipe in shared.values() and _writes(monitor, number):
            with Path(f'/proc/{monitor}/fd/{number}').open('wb', buffering=0) as end:
                end.write(line)
            return True
    return False


def _pipes(pid: int) -> dict[int, str]:
    place = Path(f'/proc/{pid}/fd')
    found = {}
    for entry in place.iterdir():
        with contextlib.suppress(OSError):
            found[int(entry.name)] = str(entry.readlink())
    return {number: target for number, target in found.items() if target.startswith('pipe:')}


def _writes(pid: int, descriptor: int) -> bool:
    flags = Path(f'/proc/{pid}/fdinfo/{descriptor}').read_text().split('flags:')[1].split()[0]
    return int(flags, 8) & os.O_ACCMODE == os.O_WRONLY
