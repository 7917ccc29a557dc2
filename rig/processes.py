"""Processes of a run: started, listened to, killed, started again; none outlives the run."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Protocol, Self

from rig.hosts import Host
from rig.patience import patient
from ros2_kafka_bridge.testing.owned import start_owned

WAIT_S: Final = 60.0
END_S: Final = 40.0
KILLED_S: Final = 30.0  # until the kernel has ended what was killed
_LOOK_S: Final = 0.02
_TAIL_LINES: Final = 40
_STACK_LINES: Final = 400
_TELL_S: Final = 5.0
_COLUMNS: Final = 200


class ProcessError(Exception):
    """A process ended, or did not do in time what it should have done."""


class Running(Protocol):
    """What a process is to the one that started it: `subprocess.Popen`, or one like it."""

    @property
    def pid(self) -> int:
        """Its number."""

    def poll(self) -> int | None:
        """The exit status, None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; returns the exit status."""

    def send_signal(self, number: int, /) -> None:
        """Send a signal, if it runs."""


Begin = Callable[[Sequence[str], Path, Mapping[str, str]], Running]
"""Starts a command: where its output is appended, and what is added to the environment."""


def owned(command: Sequence[str], log: Path, environ: Mapping[str, str]) -> Running:
    """Start a process that ends with this one, even where this one is killed."""
    values = [f'{name}={value}' for name, value in environ.items()]
    return start_owned(['/usr/bin/env', *values, *command], log)


def direct(command: Sequence[str], log: Path, environ: Mapping[str, str]) -> Running:
    """Start a process whose time is measured: no program before it takes a part of that."""
    with log.open('ab') as output:
        return subprocess.Popen(  # noqa: S603 - a command of this project
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env={**os.environ, **environ},
            start_new_session=True,  # Ctrl-C is for the owner, who ends this one in order
        )


class Process:
    """A process that can be started again and again; its output goes on in one file.

    `with` starts it, if nobody has, and ends it. What is waited for is stretched by the patience
    of the machine.

    Args:
        command: What to run.
        log: Where its output goes; its name is that of the process in errors.
        environ: Added to this process's own environment.
        begin: How it is started.
        grace_s: How long it may take to end after `with`, before it is killed.
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        environ: Mapping[str, str] | None = None,
        *,
        begin: Begin = owned,
        grace_s: float = 0.0,
    ) -> None:
        self.log = log
        self._command = command
        self._environ = environ or {}
        self._begin = begin
        self._grace_s = grace_s
        self._popen: Running | None = None
        self._shall_run = False

    def __enter__(self) -> Self:
        if self._popen is None:
            self.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is not None:  # a peer that died is no fault of the bridge
            words = ' '.join(self._command)[:_COLUMNS]
            error.add_note(self._story(f'({words}) {self._state}'))
        try:
            if error is not None and self.running and not self._grace_s:
                error.add_note(self._stacks())
            if self._grace_s:
                with contextlib.suppress(ProcessError):
                    self.end(self._grace_s)
        finally:
            self.kill()
            self._kill_children()

    def start(self, *more: str) -> int:
        """Start it, with more arguments; returns when, in nanoseconds since 1970."""
        assert not self.running, f'{self.log.stem} runs already'
        started_ns = time.time_ns()
        self._popen = self._begin([*self._command, *more], self.log, self._environ)
        self._shall_run = True
        return started_ns

    @property
    def pid(self) -> int:
        """Its number."""
        return self._started.pid

    @property
    def status(self) -> int | None:
        """How it ended; None where it was never started, or runs."""
        return None if self._popen is None else self._popen.poll()

    @property
    def running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self._popen is not None and self._popen.poll() is None

    def send(self, number: signal.Signals) -> None:
        """Send a signal, if it runs."""
        if self._popen is not None:
            self._popen.send_signal(number)

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        self._shall_run = False
        if self._popen is not None:
            self._popen.send_signal(signal.SIGKILL)
            self._popen.wait(patient(KILLED_S))

    def end(self, timeout_s: float = END_S) -> int:
        """SIGTERM; returns the exit status.

        Raises:
            ProcessError: It does not end in time.
        """
        self._shall_run = False
        self.send(signal.SIGTERM)
        return self.wait(timeout_s)

    def wait(self, timeout_s: float = WAIT_S) -> int:
        """Wait for its own end; returns the exit status.

        Raises:
            ProcessError: It does not end in time.
        """
        try:
            return self._started.wait(patient(timeout_s))
        except subprocess.TimeoutExpired:
            what = f'did not end within {patient(timeout_s):g} s'
            raise ProcessError(self._story(what)) from None

    def check(self) -> None:
        """See that it still runs, unless it was ended by us.

        Raises:
            ProcessError: It does not.
        """
        if self._shall_run and not self.running:
            raise ProcessError(self._story(self._state))

    def output(self) -> str:
        """What it has printed so far."""
        return self.log.read_text(errors='replace')

    def wait_for(self, text: str, timeout_s: float = WAIT_S, count: int = 1) -> None:
        """Wait until it has printed a text so many times.

        Raises:
            ProcessError: It has not in time, or has ended.
        """
        deadline_s = time.monotonic() + patient(timeout_s)
        read = -1
        while True:
            runs = self.running  # asked first: what it prints last is seen below
            printed = self.log.stat().st_size
            if printed != read and self.output().count(text) >= count:
                return
            read = printed
            if not runs or time.monotonic() > deadline_s:
                what = f'did not print {text!r} within {patient(timeout_s):g} s, and {self._state}'
                raise ProcessError(self._story(what))
            time.sleep(_LOOK_S)

    def _stacks(self) -> str:
        """Where its threads and its children's stand, if they tell: what hangs is seen by that.

        SIGABRT ends them; a Python with `faulthandler` prints its stacks first, whatever holds it.
        """
        told = self.log.stat().st_size
        for number in (signal.SIGABRT, signal.SIGCONT):  # a test may have stopped it
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._started.wait(patient(_TELL_S))
        with self.log.open(errors='replace') as output:
            output.seek(told)
            lines = output.read().splitlines()[:_STACK_LINES]
        return '\n    '.join([f'{self.log.stem} stands', *lines])

    def _kill_children(self) -> None:
        """SIGKILL to what it had started when it was killed: it led a session of its own.

        Its number is nobody else's as long as there are some. One that has ended by itself ends
        its children; where it does not, somebody should see that.
        """
        if self.status is not None and self.status < 0 and not Path(f'/proc/{self.pid}').exists():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)

    @property
    def _started(self) -> Running:
        assert self._popen is not None, 'the process has been started'
        return self._popen

    @property
    def _state(self) -> str:
        return 'runs' if self.running else f'ended with status {self.status}'

    def _story(self, what: str) -> str:
        lines = self.output().splitlines()[-_TAIL_LINES:]
        return '\n    '.join([f'{self.log.stem} {what}', *lines])


class Programs(NamedTuple):
    """Where programs run, and what all of them share; none is started yet.

    Args:
        logs: A directory for what they print, a file of its own for each.
        environ: Added to this process's own environment.
        host: Where they run; None is here.
        begin: How they are started.
        grace_s: How long each may take to end after its `with`.
    """

    logs: Path
    environ: Mapping[str, str]
    host: Host | None = None
    begin: Begin = owned
    grace_s: float = 0.0

    def command(self, name: str, *command: str, **environ: str) -> Process:
        """A program of any kind."""
        return Process(
            command if self.host is None else self.host.command(*command),
            self.logs / f'{name}.log',
            {**self.environ, **environ},
            begin=self.begin,
            grace_s=self.grace_s,
        )

    def python(self, name: str, *arguments: str, **environ: str) -> Process:
        """A program by the arguments of this Python."""
        return self.command(name, sys.executable, *arguments, **environ)

    def peer(self, name: str, end: str, *arguments: str, **environ: str) -> Process:
        """One of `rig.peers`."""
        return self.python(name, '-m', f'rig.peers.{end}', *arguments, **environ)

    def bridge(self, name: str, file: Path, *options: str, **environ: str) -> Process:
        """A bridge by the command line."""
        command = ('-m', 'ros2_kafka_bridge', 'run', str(file), *options)
        return self.python(name, *command, **environ)


def ros_here(domain: int) -> dict[str, str]:
    """The environment of ROS nodes that meet nobody beyond this machine."""
    return {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
