"""A worker as its supervisor sees it: a process, its routes, and when it is to be started."""

import contextlib
import os
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.process.child import start_child
from ros2_kafka_bridge.process.plan import Share
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import (
    EVENTS,
    Begun,
    Drain,
    End,
    Loaded,
    RoutesEnded,
    WorkerOrder,
)
from ros2_kafka_bridge.route.counters import Counters, Snapshot, State, from_line
from ros2_kafka_bridge.threads.backoff import Backoff

if TYPE_CHECKING:
    import subprocess

_LINE_LIMIT_BYTES = 16 * 1024 * 1024
_SILENT_S: Final = 120.0
_BEGIN_S: Final = 600.0


class WorkerProcess:
    """One worker and what is known of it, from one start to the next.

    Args:
        number: Tells it apart from the others, from 1.
        share: Its routes.
        descriptor: Of a file in memory with the plan of the bridge.
        waits: Whether it loads everything and waits to be told to begin.
    """

    is_first = False

    def __init__(self, number: int, share: Share, descriptor: int, *, waits: bool = False) -> None:
        self.number = number
        self.rank = share.rank
        self.descriptor = descriptor
        self.waits = waits
        self.snapshots = _unheard(share.routes)
        self.leaving: set[str] = set()  # routes that are to end
        self.starts = 0
        self.over = False
        self.refused = False  # it cannot start: its configuration is wrong
        self.loaded = self.begun = False
        self.problem = ''
        self.pipe = -1
        self._process: subprocess.Popen[bytes] | None = None
        self._backoff = Backoff()
        self._started_s = self._start_at_s = self._heard_s = self._begun_s = 0.0
        self._asked = 0
        self._heard = b''
        self._untold = b''

    def __str__(self) -> str:
        return f'worker {self.number} ({", ".join(self.snapshots)})'

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
    def asked(self) -> bool:
        """Whether it was asked to drain and end."""
        return self._asked > 0

    @property
    def pid(self) -> int:
        """The id of the process, 0 where there is none."""
        return 0 if self._process is None else self._process.pid

    @property
    def failed_for_good(self) -> list[str]:
        """The routes that are not started again, and were not to end anyway."""
        found = [name for name, snapshot in self.snapshots.items() if snapshot.final]
        return [name for name in found if name not in self.leaving]

    @property
    def silent_s(self) -> float:
        """For how long it has told nothing; 0 where it need not, as in its start and its end."""
        tells = self.runs and self.begun and not self.asked
        return time.monotonic() - self._heard_s if tells else 0.0

    @property
    def hangs(self) -> bool:
        """Whether it has said nothing for long, or all too little, in its start.

        One that waits for Kafka, or for a type, has begun; one that waits to begin has a limit
        of its own.
        """
        if not self.runs or self.begun or self.waits or self.asked:
            return False
        now_s = time.monotonic()
        return now_s - self._heard_s > _SILENT_S or now_s - self._started_s > _BEGIN_S

    def start(
        self, arguments: Sequence[str], inherited: Sequence[int], paused: Iterable[str] = ()
    ) -> None:
        """Start it with the routes that have not failed for good.

        Args:
            arguments: What follows its own.
            inherited: File descriptors that it keeps open.
            paused: Routes that begin paused.

        Raises:
            OSError: There is no room for a process.
        """
        routes = [name for name, snapshot in self.snapshots.items() if not snapshot.final]
        self.snapshots |= _unheard(routes)
        self.starts, self._started_s = self.starts + 1, time.monotonic()
        self._heard_s = self._started_s
        self._asked, self._heard, self._untold = 0, b'', b''
        self.loaded = self.begun = False
        pipe, its_end = os.pipe()
        options = [f'--worker={self.number}', f'--routes={",".join(routes)}']
        options += [f'--snapshots={its_end}', *(['--waits'] if self.waits else [])]
        if mine := [name for name in routes if name in set(paused)]:
            options.append(f'--paused={",".join(mine)}')
        options.append(f'--plan={self.descriptor}')
        kept = [its_end, self.descriptor, *inherited]
        try:
            self._process = start_child('process.worker', [*options, *arguments], kept)
        except OSError:
            os.close(pipe)
            raise
        finally:
            os.close(its_end)
        assert self._process.stdin is not None, 'it was started with a pipe'
        os.set_blocking(self._process.stdin.fileno(), False)
        self.pipe, self.problem = pipe, ''

    # What it says

    def hear(self, data: bytes) -> None:
        """Keep the last snapshots of what the worker has sent, and note what has happened.

        What is none is left out: whatever a worker does, its supervisor outlives it.
        """
        self._heard_s = time.monotonic()
        *whole, rest = (self._heard + data).split(b'\n')
        self._heard = rest if len(rest) <= _LINE_LIMIT_BYTES else b''
        for line in [line for line in whole if not line.startswith(b'{')][-1:]:
            with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
                told = {snapshot.route: snapshot for snapshot in from_line(line)}
                self.snapshots |= {name: told[name] for name in told.keys() & self.snapshots}
        for line in [line for line in whole if line.startswith(b'{')]:
            with contextlib.suppress(ValueError):
                self._note(EVENTS.decode(line))

    def _note(self, event: wire.Event) -> None:
        match event:
            case Loaded():
                self.loaded = True
            case Begun():
                self.begun, self._begun_s = True, time.monotonic()
            case RoutesEnded(routes):
                self.forget(routes)

    def forget(self, routes: Iterable[str]) -> None:
        """Have no such routes any more."""
        for name in routes:
            self.snapshots.pop(name, None)
            self.leaving.discard(name)

    # What it is told

    def tell(self, order: WorkerOrder) -> None:
        """Give it an order, if it runs; one that was not begun is begun by `start`."""
        if self.runs:
            self._untold += wire.to_line(order)
            self.flush()

    def flush(self) -> None:
        """Send what the pipe had no room for."""
        if self._untold and self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                written = self._process.stdin.write(self._untold)
                self._untold = self._untold[written or 0 :]

    def ask(self, times: int) -> None:
        """Ask for a drain, or twice for an end at once."""
        for _ in range(times - self._asked):
            self.tell(Drain())
        self._asked = max(times, self._asked)

    def begin(self) -> None:
        """Let one begin that waits."""
        self.waits = False
        self._started_s = self._heard_s = time.monotonic()
        self.tell(wire.Begin())

    def end(self, routes: Iterable[str]) -> None:
        """Let some of its routes drain, and have them no more after that."""
        mine = self.snapshots.keys() & set(routes)
        if self.runs and not self.asked:
            self.leaving |= mine
            self.tell(End(tuple(mine)))
        else:
            self.forget(mine)
            self.over = self.over or not self.snapshots

    # Its end

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
        # A start that fails is never a good time, however long it takes.
        self._backoff = self._backoff.after(now_s - self._begun_s if self.begun else 0.0)
        self._start_at_s = now_s + self._backoff.wait_s
        self.problem = how
        for name, snapshot in self.snapshots.items():
            if not snapshot.final:
                reason = f'its worker {how} and is started again'
                self.snapshots[name] = snapshot.at_rest._replace(state=State.FAILED, reason=reason)
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


def _unheard(routes: Iterable[str]) -> dict[str, Snapshot]:
    """What is known of routes before their worker has said anything: none of them is stuck."""
    return {name: Counters(name).nothing_told for name in routes}
