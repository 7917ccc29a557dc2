"""The processes of a run: each can be killed, stopped and gone on with, and none outlives it."""

import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from benchmarks.faults.stacks import write_stacks
from benchmarks.processes import ProcessError
from rig.hosts import Host
from ros2_kafka_bridge.testing.owned import start_owned

_END_S: Final = 5.0
_TAIL_LINES: Final = 15


class Part:
    """A process that can be started again and again; its output goes on in one file.

    Args:
        name: For errors.
        command: Arguments of this Python.
        log: Where its output goes.
        environ: Added to this process's own environment.
        host: Where it runs; None is here.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        log: Path,
        environ: Mapping[str, str],
        host: Host | None = None,
    ) -> None:
        self.name = name
        self.log = log
        self._command = command
        self._environ = environ
        self._host = host
        self._popen: subprocess.Popen[bytes] | None = None

    def start(self, *more: str) -> int:
        """Start it, with more arguments; returns when, in nanoseconds since 1970."""
        assert not self.is_running, f'{self.name} runs already'
        values = [f'{name}={value}' for name, value in self._environ.items()]
        command = ['/usr/bin/env', *values, sys.executable, *self._command, *more]
        if self._host is not None:
            command = self._host.command(*command)
        started_ns = time.time_ns()
        self._popen = start_owned(command, self.log)
        return started_ns

    @property
    def is_running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self._popen is not None and self._popen.poll() is None

    def send(self, number: signal.Signals) -> None:
        """Send a signal, if it runs."""
        if self._popen is not None and self._popen.poll() is None:
            self._popen.send_signal(number)

    def kill(self) -> None:
        """End it at once."""
        if self._popen is not None:
            self._popen.kill()
            self._popen.wait()
            self._popen = None

    def end(self, timeout_s: float = _END_S) -> int | None:
        """Ask it to end, and kill it when it does not in time; returns its exit status.

        None says that it did not run, or had to be killed; what it was at stands beside its log.
        """
        if self._popen is None:
            return None
        self._popen.send_signal(signal.SIGCONT)
        self._popen.terminate()
        try:
            return self._popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.write_stacks()
            return None
        finally:
            self.kill()

    def write_stacks(self) -> None:
        """Write down what its threads are at, if it runs; the file stands beside its log."""
        if self._popen is not None and self._popen.poll() is None:
            write_stacks(self._popen.pid, self.log.with_suffix('.stacks'))

    def check(self) -> None:
        """See that it still runs, unless it was ended by us.

        Raises:
            ProcessError: It does not.
        """
        if self._popen is not None and (status := self._popen.poll()) is not None:
            lines = self.log.read_text(errors='replace').splitlines()[-_TAIL_LINES:]
            raise ProcessError(
                '\n    '.join([f'{self.name} ended with status {status}, see {self.log}', *lines])
            )
