"""A worker as its supervisor sees it: a process, its routes, and when it is to be started."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence

from ros2_kafka_bridge.backoff import Backoff
from ros2_kafka_bridge.metrics import Counters, State, from_line
from ros2_kafka_bridge.shares import Share

_LINE_LIMIT_BYTES = 16 * 1024 * 1024


class WorkerProcess:
    """One worker and what is known of it, from one start to the next.

    Args:
        number: Tells it apart from the others, from 1.
        share: Its routes.
    """

    def __init__(self, number: int, share: Share) -> None:
        self.to_ros = share.to_ros
        self.snapshots = {name: Counters(name).snapshot(0) for name in share.routes}
        self.starts = 0
        self.over = False
        self.pipe = -1
        self._number = number
        self._process: subprocess.Popen[bytes] | None = None
        self._backoff = Backoff()
        self._started_s = self._start_at_s = 0.0
        self._asked = 0
        self._heard = b''

    def __str__(self) -> str:
        return f'worker {self._number} ({", ".join(self.snapshots)})'

    @property
    def runs(self) -> bool:
        """Whether there is a process."""
        return self._process is not None

    @property
    def away(self) -> bool:
        """Whether it has failed and waits for its next start."""
        return bool(self.starts) and not self.runs and not self.over

    @property
    def due(self) -> bool:
        """Whether it is time to start it."""
        return not self.runs and not self.over and time.monotonic() >= self._start_at_s

    @property
    def pid(self) -> int:
        """The id of the process."""
        assert self._process is not None, 'the worker has been started'
        return self._process.pid

    @property
    def failed_for_good(self) -> list[str]:
        """The routes that are not started again."""
        return [name for name, snapshot in self.snapshots.items() if snapshot.final]

    def start(self, arguments: Sequence[str], inherited: Sequence[int]) -> None:
        """Start it with the routes that have not failed for good.

        Args:
            arguments: What follows its own.
            inherited: File descriptors that it keeps open.

        Raises:
            OSError: There is no room for a process.
        """
        routes = [name for name, snapshot in self.snapshots.items() if not snapshot.final]
        self.snapshots |= {name: Counters(name).snapshot(0) for name in routes}
        self.starts, self._started_s = self.starts + 1, time.monotonic()
        self._asked, self._heard = 0, b''
        pipe, its_end = os.pipe()
        options = (f'--worker={self._number}', f'--routes={",".join(routes)}')
        module = ('-P', '-m', 'ros2_kafka_bridge.worker')
        try:
            self._process = subprocess.Popen(  # noqa: S603 (this program)
                [sys.executable, *module, *options, f'--snapshots={its_end}', *arguments],
                bufsize=0,
                stdin=subprocess.PIPE,
                pass_fds=(its_end, *inherited),
            )
        except OSError:
            os.close(pipe)
            raise
        finally:
            os.close(its_end)
        self.pipe = pipe

    def hear(self, data: bytes) -> None:
        """Keep the last snapshots of what the worker has sent.

        What is none is left out: whatever a worker does, its supervisor outlives it.
        """
        *whole, rest = (self._heard + data).split(b'\n')
        self._heard = rest if len(rest) <= _LINE_LIMIT_BYTES else b''
        for line in whole[-1:]:
            with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
                told = {snapshot.route: snapshot for snapshot in from_line(line)}
                self.snapshots |= {name: told[name] for name in told.keys() & self.snapshots}

    def ask(self, times: int) -> None:
        """Ask for a drain, or twice for an end at once."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(b's' * (times - self._asked))
        self._asked = max(times, self._asked)

    def exit_status(self) -> int | None:
        """The status of one that has ended just now, negative for a signal."""
        status = None if self._process is None else self._process.poll()
        if self._process is not None and status is not None:
            assert self._process.stdin is not None, 'it was started with a pipe'
            self._process.stdin.close()
            self._process = None
        return status

    def fail(self, how: str) -> float:
        """Note that it has to be started again; returns in how many seconds."""
        now_s = time.monotonic()
        self._backoff = self._backoff.after(now_s - self._started_s)
        self._start_at_s = now_s + self._backoff.wait_s
        for name, snapshot in self.snapshots.items():
            if not snapshot.final:
                reason = f'its worker {how} and is started again'
                self.snapshots[name] = snapshot._replace(state=State.FAILED, reason=reason)
        return self._backoff.wait_s

    def kill(self) -> None:
        """End it at once."""
        assert self._process is not None, 'the worker runs'
        self._process.kill()
        self._process.wait()

    def close_pipe(self) -> None:
        """Close the pipe that it has closed."""
        os.close(self.pipe)
        self.pipe = -1
