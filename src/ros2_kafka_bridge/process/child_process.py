"""How a process of the bridge starts another one and speaks with it in lines, or becomes it."""

import contextlib
import math
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Final, NoReturn

from ros2_kafka_bridge.process.lines import LineReader, LineWriter
from ros2_kafka_bridge.threads.backoff import Backoff
from ros2_kafka_bridge.threads.stop import SIGNALS

_LOOK_S: Final = 0.1


class ChildProcess:
    """A module of the bridge in a process of its own, one life after the other.

    It is told lines by its standard input, and tells lines by a pipe of its own. Neither ever
    holds this process up.

    Args:
        module: Its name in `ros2_kafka_bridge`.
        tells_by: The option with which it is told the descriptor of its pipe.
        selector: Where it is waited for that it tells something.
    """

    def __init__(self, module: str, tells_by: str, selector: selectors.BaseSelector) -> None:
        self._module = module
        self._tells_by = tells_by
        self._selector = selector
        self._process: subprocess.Popen[bytes] | None = None
        self._writer: LineWriter | None = None
        self._reader: LineReader | None = None
        self._pipe = -1
        self._backoff = Backoff()
        self._due_s = 0.0

    @property
    def is_running(self) -> bool:
        """Whether there is a process; one that has ended is there until its status is taken."""
        return self._process is not None

    @property
    def is_due(self) -> bool:
        """Whether there is none, and it is time for the next."""
        return self._process is None and time.monotonic() >= self._due_s

    @property
    def pid(self) -> int:
        """The id of the process, 0 where there is none."""
        return 0 if self._process is None else self._process.pid

    @property
    def unsent_bytes(self) -> int:
        """How much it has not taken yet of what it was told."""
        return 0 if self._writer is None else len(self._writer.unsent)

    @property
    def next_look_s(self) -> float:
        """When to look at it at the latest, where it tells nothing before."""
        if self._process is None:
            return self._due_s
        # Its pipe wakes whoever waits, also at its end; one without a pipe ends unheard.
        is_heard = self._reader is not None and not self.unsent_bytes
        return math.inf if is_heard else time.monotonic() + _LOOK_S

    @property
    def stuck_s(self) -> float:
        """For how long it has taken nothing of what it was told."""
        return 0.0 if self._writer is None else self._writer.stuck_s

    def start(self, options: Sequence[str], kept: Sequence[int]) -> None:
        """Start it.

        Args:
            options: Its arguments.
            kept: File descriptors that it keeps open.

        Raises:
            OSError: There is no room for a process.
        """
        self.close()
        self._pipe, its_end = os.pipe()
        os.set_blocking(self._pipe, False)
        self._reader = LineReader(self._pipe)
        words = [f'--{self._tells_by}={its_end}', *options]
        try:
            self._selector.register(self._pipe, selectors.EVENT_READ)
            self._process = _start(self._module, words, [its_end, *kept])
        except OSError:
            self._close_output()
            raise
        finally:
            os.close(its_end)
        assert self._process.stdin is not None, 'it was started with a pipe'
        self._writer = LineWriter(self._process.stdin.fileno())

    def start_later(self, ran_s: float) -> float:
        """Let it be due again after a wait that grows with each failure; returns that wait.

        Args:
            ran_s: For how long all was well.
        """
        self._backoff = self._backoff.after(ran_s)
        self._due_s = time.monotonic() + self._backoff.wait_s
        return self._backoff.wait_s

    def send(self, line: bytes) -> None:
        """Tell it something as soon as its pipe has room; where there is none, nobody is told."""
        if self._writer is not None:
            self._writer.send(line)

    def exchange(self) -> list[bytes]:
        """Send what had no room before; returns the lines that it has told since."""
        if self._writer is not None:
            self._writer.flush()
        if self._reader is None:
            return []
        lines = self._reader.read()
        if self._reader.has_ended:
            self._close_output()
        return lines

    def exit_status(self) -> int | None:
        """The status of one that has ended since this was asked last, negative for a signal.

        What it has told at the end can be taken after that.
        """
        status = None if self._process is None else self._process.poll()
        if status is not None:
            self.close_input()
            self._process = None
        return status

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def close_input(self) -> None:
        """Let it read the end of what it is told."""
        self._writer = None
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()

    def close(self) -> None:
        """Close what is open; a process that runs finds out by it."""
        self.close_input()
        self._close_output()

    def _close_output(self) -> None:
        if self._reader is not None:
            with contextlib.suppress(KeyError):  # there was no room for it
                self._selector.unregister(self._pipe)
            os.close(self._pipe)
            self._reader, self._pipe = None, -1


def become(module: str, options: Sequence[str]) -> NoReturn:
    """Replace this process by a module of the bridge, with its process id and its signals.

    What is asked for on the way by a signal is kept for the module that takes over.

    Args:
        module: Its name in `ros2_kafka_bridge`.
        options: Its arguments.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    os.execv(sys.executable, _program(module, options))  # noqa: S606 (no shell is wanted)


def _start(module: str, options: Sequence[str], kept: Sequence[int]) -> subprocess.Popen[bytes]:
    """Start a module as a process, with its signals held back.

    Ctrl-C, a closed terminal and systemd reach every process, and what they mean is for the
    supervisor to say: a child takes the signals over when it knows what to do with them.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        return subprocess.Popen(  # noqa: S603 (this program)
            _program(module, options), bufsize=0, stdin=subprocess.PIPE, pass_fds=kept
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _program(module: str, options: Sequence[str]) -> list[str]:
    # -P: a directory that happens to be the current one is not searched for modules.
    return [sys.executable, '-P', '-m', f'ros2_kafka_bridge.{module}', *options]
