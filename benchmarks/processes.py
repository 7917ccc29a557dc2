"""Processes that are measured: what each prints, and what the kernel says that it uses."""

import contextlib
import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Self

_CPUCLOCK_SCHED: Final = 2  # linux/posix-timers.h
_END_S: Final = 5.0
_TAIL_LINES: Final = 15


class ProcessError(Exception):
    """A process ended, or did not say what it should have said."""


class Usage(NamedTuple):
    """What a process has used so far."""

    cpu_s: float
    anon_mib: float


class Process:
    """A process that ends with its `with`, first asked to, then killed.

    Args:
        name: For errors.
        command: What to run.
        log: Where its output goes.
        environ: Added to this process's own environment.
    """

    def __init__(
        self, name: str, command: Sequence[str], log: Path, environ: Mapping[str, str]
    ) -> None:
        self._name = name
        self._command = command
        self._log = log
        self._environ = environ
        self._popen: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        with self._log.open('ab') as output:
            self._popen = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, **self._environ},
                start_new_session=True,  # Ctrl-C is for the owner, who ends this one in order
            )
        return self

    def __exit__(self, *_: object) -> None:
        process = self._running
        process.terminate()
        try:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END_S)
        finally:
            process.kill()
            process.wait()

    def wait_for(self, text: str, timeout_s: float, count: int = 1) -> None:
        """Wait until it has printed a text so many times.

        Raises:
            ProcessError: It has not in time, or has ended.
        """
        deadline_s = time.monotonic() + timeout_s
        while self.output().count(text) < count:
            self.check()
            if time.monotonic() > deadline_s:
                raise self._error(f'did not print {text!r} within {timeout_s:.0f} s')
            time.sleep(0.02)

    def check(self) -> None:
        """See that it still runs.

        Raises:
            ProcessError: It does not.
        """
        status = self._running.poll()
        if status is not None:
            raise self._error(f'ended with status {status}')

    def usage(self) -> Usage:
        """Look at what it has used so far.

        Raises:
            ProcessError: It does not run any more.
        """
        self.check()
        return usage(self._running.pid)

    @property
    def pid(self) -> int:
        """Its number."""
        return self._running.pid

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        self._running.kill()
        self._running.wait()

    def end(self, timeout_s: float) -> int:
        """SIGTERM; returns the exit status.

        Raises:
            ProcessError: It does not end in time.
        """
        self._running.terminate()
        return self.ends(timeout_s)

    def ends(self, timeout_s: float) -> int:
        """Wait for its own end; returns the exit status.

        Raises:
            ProcessError: It does not end in time.
        """
        try:
            return self._running.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise self._error(f'did not end within {timeout_s:.0f} s') from error

    @property
    def _running(self) -> 'subprocess.Popen[bytes]':
        assert self._popen is not None, 'the process has been started'
        return self._popen

    def output(self) -> str:
        """What it has printed so far."""
        return self._log.read_text(errors='replace')

    def _error(self, what: str) -> ProcessError:
        lines = self.output().splitlines()[-_TAIL_LINES:]
        return ProcessError('\n    '.join([f'{self._name} {what}', *lines]))


def usage(pid: int) -> Usage:
    """Look at what a process has used so far.

    Raises:
        ProcessLookupError: It has ended.
    """
    try:
        cpu_s = time.clock_gettime(_cpu_clock(pid))
        lines = Path('/proc', str(pid), 'status').read_text().splitlines()
    except OSError as error:
        raise ProcessLookupError(f'process {pid} has ended') from error
    status = dict(line.split(':', 1) for line in lines)
    if 'RssAnon' not in status:
        raise ProcessLookupError(f'process {pid} has ended')
    return Usage(cpu_s, int(status['RssAnon'].split()[0]) / 1024)


def _cpu_clock(pid: int) -> int:
    """The clock of all CPU time of a process: clock_getcpuclockid(3), which Python does not have.

    It counts in nanoseconds, where /proc/PID/stat counts in hundredths of a second: a small drain
    takes no more than a few of those.
    """
    return ~pid << 3 | _CPUCLOCK_SCHED
