"""The workers of a bridge: started, listened to, started again, drained in the right order."""

import os
import selectors
import signal
import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import Final

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.exclusive.term import HANDOVER_S
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.local_worker import LocalWorker
from ros2_kafka_bridge.process.plan import Rank, RoutePlan, Share
from ros2_kafka_bridge.process.worker_process import WorkerProcess
from ros2_kafka_bridge.protocol.worker import PauseRoute, ResumeRoute
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.route.status import left
from ros2_kafka_bridge.threads.stop import Stop

# More than a worker gives itself: it knows best what it leaves, and says so.
_ENDING_S: Final = 12.0
CLOSING_S: Final = _ENDING_S + HANDOVER_S
_AT_ONCE_S: Final = 5.0
_PIPE_BYTES: Final = 65_536

DONE: Final = 0
FAILED: Final = 1
CANNOT_START: Final = 2

AnyWorker = WorkerProcess | LocalWorker


class Crew:
    """The workers, in a `with` of its own.

    Args:
        arguments: What the arguments of every worker end with.
        selector: Where what they say is waited for; its data are called.
        stop: Asked where the bridge cannot start at all.
    """

    def __init__(
        self, arguments: Sequence[str], selector: selectors.BaseSelector, stop: Stop
    ) -> None:
        self.workers: list[AnyWorker] = []
        self.paused: set[str] = set()
        self.status = DONE
        self.last: dict[str, Snapshot] = {}  # of routes that no worker has any more
        self._arguments = arguments
        self._selector = selector
        self._stop = stop
        self._log = logs.route_log()
        self._has_begun = False
        # Who drains later sees at one end that those before it have ended, who hold the other:
        # even without a supervisor.
        self._pipes: dict[Rank, tuple[int, int]] = {}
        with ExitStack() as undone:
            undone.callback(self.close)
            for rank in (Rank.TO_ROS, Rank.BOTH):
                self._pipes[rank] = os.pipe()
            undone.pop_all()

    def close(self) -> None:
        """Close what is open; the workers have ended, or find out by it."""
        for worker in self.workers:
            if worker.pipe >= 0:
                self._close(worker)
        for ends in self._pipes.values():
            for end in ends:
                os.close(end)

    @property
    def over(self) -> bool:
        """Whether no worker runs or is started again."""
        return all(worker.over for worker in self.workers)

    @property
    def begun(self) -> bool:
        """Whether every route has begun, but for those that cannot."""
        return all(worker.begun or worker.over for worker in self.workers)

    def snapshots(self) -> list[Snapshot]:
        """What the workers have told last of the routes that they run."""
        running = [worker for worker in self.workers if not worker.waits]
        return [s for worker in running for s in worker.snapshots.values()]

    def worker_of(self, route: str) -> AnyWorker | None:
        """Who runs a route, or is to run it soon."""
        found = [worker for worker in self.workers if route in worker.snapshots]
        return min(found, key=lambda worker: worker.waits, default=None)

    # Start

    def hire(
        self, shares: Iterable[Share], descriptor: int, *, waits: bool = False
    ) -> list[WorkerProcess]:
        """Have a further worker for each share; it is started by the next `tick`.

        Args:
            shares: Their routes.
            descriptor: Of a file in memory with the plan that has these.
            waits: Whether they are told when to begin.
        """
        hired = []
        for share in shares:
            used = {worker.number for worker in self.workers}
            number = next(n for n in range(1, len(used) + 2) if n not in used)
            hired.append(WorkerProcess(number, share, descriptor, waits=waits))
            self.workers.append(hired[-1])
        return hired

    def tick(self) -> None:
        """Start who is due, and see who has ended."""
        for worker in self.workers:
            worker.flush()
            if worker.due:
                self._start(worker)
            if worker.hangs:
                self._log.error('%s does not begin: it is killed', worker)
                worker.kill()
            if (status := worker.exit_status()) is not None:
                while worker.pipe >= 0:
                    self._read(worker)
                self._ended(worker, status)
        self.workers = [w for w in self.workers if w.snapshots or not w.over]
        self._has_begun = self._has_begun or any(worker.begun for worker in self.workers)

    def _start(self, worker: AnyWorker) -> None:
        order, inherited = self._chain(worker.rank)
        try:
            worker.start([*order, *self._arguments], inherited, self.paused)
            self._selector.register(
                worker.pipe, selectors.EVENT_READ, lambda worker=worker: self._read(worker)
            )
            self._log.info('%s is process %d', worker, worker.pid)
        except OSError as error:
            self._fail(worker, f'could not be started ({error.strerror})')

    def _chain(self, rank: Rank) -> tuple[list[str], list[int]]:
        """What tells a worker that those before it have ended, and those after it of itself."""
        runs = [write for own, (_, write) in self._pipes.items() if rank <= own]
        waits = [read for own, (read, _) in self._pipes.items() if rank == own + 1]
        return [f'--after={read}' for read in waits], [*runs, *waits]

    # What they say

    def _read(self, worker: AnyWorker) -> None:
        data = os.read(worker.pipe, _PIPE_BYTES)
        if data:
            worker.hear(data)
        else:
            self._close(worker)

    def _close(self, worker: AnyWorker) -> None:
        self._selector.unregister(worker.pipe)
        worker.close_pipe()

    def _ended(self, worker: AnyWorker, status: int) -> None:
        failed = worker.failed_for_good
        # A worker that was killed and comes back has lost nothing; one that gave up says so.
        if failed or status == FAILED or (status and worker.asked):
            self.status = max(self.status, FAILED)
        worker.forget(set(worker.leaving))
        if worker.asked or not worker.snapshots:
            worker.over = True
        elif status == CANNOT_START and worker.waits:
            worker.over = worker.refused = True
        elif status == CANNOT_START and worker.starts == 1 and not self._has_begun:
            worker.over = True
            self.status = CANNOT_START  # it has said why
            self._stop.ask()
        elif len(failed) == len(worker.snapshots):
            worker.over = True
            self._log.error('%s has ended: its routes have failed for good', worker)
        else:
            self._fail(worker, _how(status))

    def _fail(self, worker: AnyWorker, how: str) -> None:
        wait_s = worker.fail(how)
        self._log.error('%s %s: started again in %.0f s', worker, how, wait_s)

    # What they are told

    def pause(self, route: str) -> None:
        """Let a route pause, and remember it for who runs it later."""
        self.paused.add(route)
        for worker in self.workers:
            if route in worker.snapshots:
                worker.tell(PauseRoute(route))

    def resume(self, route: str) -> None:
        """Let a paused route go on."""
        self.paused.discard(route)
        for worker in self.workers:
            if route in worker.snapshots:
                worker.tell(ResumeRoute(route))

    # Ends

    def drain(self, routes: Collection[RoutePlan], at_once: Callable[[], bool]) -> Iterator[None]:
        """Drain the workers to ROS, then those from ROS; what does not end in time is killed.

        Each direction has a time of its own, whatever the other has used up.

        Args:
            routes: All that may run.
            at_once: Whether to give up what is still in flight.
        """
        self._end_waiting()
        if any(worker.away for worker in self.workers):
            self.status = max(self.status, FAILED)
        for worker in self.workers:
            worker.over = worker.over or not worker.runs
        for rank in Rank:
            deadline_s = time.monotonic() + _limit_s(rank, routes)
            yield from self._drain(rank, deadline_s, at_once)
        directions = {route.name: route.direction for route in routes}
        for worker in self.workers:
            if worker.runs:
                self._kill(worker, directions)
        self.last |= {snapshot.route: snapshot for snapshot in self.snapshots()}

    def _kill(self, worker: AnyWorker, directions: dict[str, Direction]) -> None:
        worker.kill()
        self.status = max(self.status, FAILED)
        self._log.error('%s did not end in time and was killed', worker)
        if worker.is_first:  # which says it itself
            return
        for name, snapshot in worker.snapshots.items():
            # Of a route that a reload takes out just now, the worse is said.
            held = left(snapshot, directions.get(name, Direction.ROS_TO_KAFKA))
            logs.route_log(name).error('its worker was killed: it is left with %s', held)

    def _end_waiting(self) -> None:
        """End those of a reload that have not begun: they hold nothing that could be drained."""
        for worker in [worker for worker in self.workers if worker.waits]:
            worker.over = True
            worker.forget(list(worker.snapshots))
            if worker.runs:
                worker.kill()
                worker.exit_status()  # whatever it is

    def _drain(self, rank: Rank, deadline_s: float, at_once: Callable[[], bool]) -> Iterator[None]:
        workers = [worker for worker in self.workers if worker.rank == rank]
        for worker in workers:
            worker.ask(1)
        while any(worker.runs for worker in workers) and time.monotonic() < deadline_s:
            yield
            if at_once():
                for worker in self.workers:
                    worker.ask(2)
                deadline_s = min(deadline_s, time.monotonic() + _AT_ONCE_S)

    def dismiss(self) -> None:
        """Have no workers any more; they have ended."""
        for worker in self.workers:
            worker.over = True
            worker.forget(list(worker.snapshots))

    def end(self, routes: Iterable[str], drain_s: float) -> Generator[None, None, list[str]]:
        """Drain some routes of one direction where they run, and have them no more after that.

        Who does not end them in time is killed, but for the first process, which holds what
        cannot be started again.

        Returns:
            The routes that this process still has.
        """
        names = set(routes)
        concerned = [worker for worker in self.workers if not worker.waits]
        for worker in concerned:
            worker.end(names)
        deadline_s = time.monotonic() + drain_s + CLOSING_S
        while any(w.leaving & names for w in concerned) and time.monotonic() < deadline_s:
            yield
        others = [worker for worker in concerned if not worker.is_first]
        for worker in others:
            if worker.leaving and worker.runs:
                late = ', '.join(sorted(worker.leaving))
                self._log.error('%s: %s did not end in time: it is killed', worker, late)
                worker.kill()
        while any(worker.leaving for worker in others):
            yield
        return sorted(name for w in concerned if w.is_first for name in w.leaving & names)


def _limit_s(rank: Rank, routes: Iterable[RoutePlan]) -> float:
    """How long workers of a rank may take to drain and end."""
    longest_s = dict.fromkeys(Direction, 0.0)
    for route in routes:
        longest_s[route.direction] = max(longest_s[route.direction], route.drain_s)
    to_ros_s = longest_s[Direction.KAFKA_TO_ROS] + _ENDING_S
    from_ros_s = longest_s[Direction.ROS_TO_KAFKA] + CLOSING_S
    match rank:
        case Rank.TO_ROS:
            return to_ros_s
        case Rank.FROM_ROS:
            return from_ros_s
        case Rank.BOTH:
            return to_ros_s + from_ros_s


def _how(status: int) -> str:
    if status >= 0:
        return f'ended with status {status}'
    try:
        return f'was ended by {signal.Signals(-status).name}'
    except ValueError:
        return f'was ended by signal {-status}'
