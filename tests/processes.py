"""Processes of a test, and what it waits for."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from ending import KILLED_S
from patience import patient
from warm import Warm

PATIENCE_S = 60.0  # stretched, as all that is waited for here (patience.patient)
LAST_LINES = 10
LAST_COLUMNS = 200


class Process:
    """A process of the test, with what it printed in a file; ended at the end of `with`.

    Args:
        command: What to run.
        log: Its output goes to the end of this file.
        environ: Added to the environment of the tests.
        warm: The command are the arguments of Python, which begins with its imports done.
    """

    def __init__(
        self,
        command: list[str],
        log: Path,
        environ: dict[str, str] | None = None,
        *,
        warm: bool = False,
    ) -> None:
        self.log = log
        self._command = command
        log.touch()
        environment = {**os.environ, **(environ or {})}
        self._popen = (Warm if warm else _cold)(command, log, environment)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            sys.stderr.write(self._last_words())
        if self._popen.poll() is None:
            self._popen.kill()
        self._popen.wait(patient(KILLED_S))

    def _last_words(self) -> str:
        """What a test that fails shows of it: a peer that died is no fault of the bridge."""
        status = self._popen.poll()
        state = 'runs' if status is None else f'ended with status {status}'
        lines = self.output().splitlines()[-LAST_LINES:]
        return '\n    '.join([f'{" ".join(self._command)[:LAST_COLUMNS]} {state}', *lines]) + '\n'

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._popen.send_signal(number)

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        self._popen.kill()
        self._popen.wait(patient(KILLED_S))

    def end(self, timeout_s: float = 40.0) -> int:
        """SIGTERM; returns the exit status."""
        self._popen.terminate()
        return self.wait(timeout_s)

    def wait(self, timeout_s: float = PATIENCE_S) -> int:
        """Wait for its own end; returns the exit status."""
        try:
            return self._popen.wait(patient(timeout_s))
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f'still running after {patient(timeout_s)} s:\n{self.output()}'
            ) from None

    @property
    def pid(self) -> int:
        """Its number."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._popen.poll() is None

    def output(self) -> str:
        """What it has printed so far."""
        return self.log.read_text()

    def wait_for(self, text: str, timeout_s: float = PATIENCE_S, count: int = 1) -> None:
        """Wait until it has printed `text` (`count` times)."""
        eventually(
            lambda: self.output().count(text) >= count,
            timeout_s,
            lambda: f'{text!r} did not come:\n{self.output()}',
        )


def _cold(command: list[str], log: Path, environ: dict[str, str]) -> 'subprocess.Popen[bytes]':
    with log.open('ab') as output:
        return subprocess.Popen(
            command, stdout=output, stderr=output, stdin=subprocess.DEVNULL, env=environ
        )


def eventually(
    condition: Callable[[], bool], timeout_s: float, what: Callable[[], str] = lambda: 'never'
) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + patient(timeout_s)
    while not condition():
        assert time.monotonic() < deadline, what()
        time.sleep(0.02)


def within(condition: Callable[[], bool], seconds: float, what: Callable[[], str]) -> None:
    """Wait until a condition holds, as long as is said to a user.

    It counts its own looks: a machine that stands still costs nobody time.
    """
    for _ in range(int(seconds / 0.02)):
        if condition():
            return
        time.sleep(0.02)
    raise AssertionError(what())
