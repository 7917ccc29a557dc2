"""The bridge in this process, as one of the workers that it looks after itself."""

import os
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from ros2_kafka_bridge.process.plan import Rank
from ros2_kafka_bridge.protocol.worker import PauseRoute, ResumeRoute, WorkerOrder
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge


class LocalWorker:
    """Looks like a `WorkerProcess`, but is not started again: it ends with its process.

    Args:
        bridge: It runs.
        status: Tells the status of the bridge; None while it runs.
        stop: Asked where the bridge ends without having been asked.
    """

    number = 0
    rank = Rank.BOTH
    starts = 1
    pipe = -1
    problem = ''
    silent_s = 0.0
    waits = refused = away = due = hangs = False
    loaded = begun = is_first = True

    def __init__(self, bridge: 'Bridge', status: Callable[[], int | None], stop: Stop) -> None:
        self.over = False
        self.descriptor = -1
        self._bridge = bridge
        self._status = status
        self._stop = stop
        self._asked = 0
        self._leaving: set[str] = set()

    def __str__(self) -> str:
        return 'the first process'

    @property
    def snapshots(self) -> dict[str, Snapshot]:
        """The counters of its routes."""
        return {snapshot.route: snapshot for snapshot in self._bridge.snapshots()}

    @property
    def leaving(self) -> set[str]:
        """Its routes that are to end."""
        return self._leaving & self.snapshots.keys()

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return not self.over

    @property
    def moves(self) -> bool:
        """Whether a route of it runs."""
        return self._bridge.runs

    @property
    def paused(self) -> frozenset[str]:
        """Names of the routes that were asked to pause."""
        return self._bridge.paused

    @property
    def asked(self) -> bool:
        """Whether it was asked to drain and end."""
        return self._asked > 0

    @property
    def pid(self) -> int:
        """The id of the process."""
        return os.getpid()

    @property
    def failed_for_good(self) -> list[str]:
        """The routes that are not started again, and were not to end anyway."""
        return [n for n, s in self.snapshots.items() if s.final and n not in self._leaving]

    def start(
        self, _arguments: Sequence[str], _inherited: Sequence[int], _paused: Iterable[str]
    ) -> None:
        """It runs already."""
        raise AssertionError('the first process is never due')

    def hear(self, _data: bytes) -> None:
        """It says nothing: its snapshots are those of its bridge."""

    def flush(self) -> None:
        """It has no pipe."""

    def forget(self, routes: Iterable[str]) -> None:
        """Its bridge forgets them."""

    def begin(self) -> None:
        """It has begun."""

    def tell(self, order: WorkerOrder) -> None:
        """Let its bridge do it."""
        match order:
            case PauseRoute(route):
                self._bridge.pause(route)
            case ResumeRoute(route):
                self._bridge.resume(route)
            case _:
                raise AssertionError(f'{order} has a call of its own')

    def ask(self, times: int) -> None:
        """Ask for a drain, or twice for an end at once."""
        for _ in range(times - self._asked):
            self._bridge.stop.ask()
        self._asked = max(times, self._asked)

    def end(self, routes: Iterable[str]) -> None:
        """Let some of its routes drain, and have them no more after that."""
        mine = self.snapshots.keys() & set(routes)
        self._leaving = self.leaving | mine
        self._bridge.end(frozenset(mine))

    def exit_status(self) -> int | None:
        """The status of its bridge, once it has ended."""
        status = None if self.over else self._status()
        if status is None:
            return None
        self.over = True
        if self.snapshots and len(self.failed_for_good) < len(self.snapshots) and not self.asked:
            self._asked = 1
            self._stop.ask()  # a bug has ended it
        return status

    def fail(self, how: str) -> float:
        """It is not started again."""
        raise AssertionError(how)

    def kill(self) -> None:
        """Leave it to itself: it gives up what does not end in time, and to kill it ends all."""
        self.over = True

    def close_pipe(self) -> None:
        """It has no pipe."""
