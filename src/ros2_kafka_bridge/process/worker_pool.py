"""The workers of a bridge: what they run, who is started again, and what has come of them."""

import math
import os
import selectors
import signal
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from itertools import count
from typing import Final

from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.in_process_worker import InProcessWorker
from ros2_kafka_bridge.process.plan import Plan, Rank, Share, share_out
from ros2_kafka_bridge.process.worker_handle import WorkerHandle
from ros2_kafka_bridge.protocol.worker import PauseRoute, ResumeRoute
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.threads.stop import Stop

DONE: Final = 0
FAILED: Final = 1
CANNOT_START: Final = 2


class WorkerPool:
    """The workers, and the plan that they share out.

    Args:
        plan: What counts at the start.
        arguments: What the arguments of every worker end with.
        selector: Where what they tell is waited for.
        stop: Asked where the bridge cannot start at all.

    Raises:
        OSError: The system has no room for it.
    """

    def __init__(
        self, plan: Plan, arguments: Sequence[str], selector: selectors.BaseSelector, stop: Stop
    ) -> None:
        self.plan = plan
        self.selector = selector
        self.workers: list[WorkerHandle] = []
        self.paused: set[str] = set()
        self.failures = 0  # ends that make the whole a failure
        self.last: dict[str, Snapshot] = {}  # of routes that no worker has any more
        self._arguments = arguments
        self._stop = stop
        self._log = logs.route_log()
        self._has_begun = self._cannot_start = False
        self._order = _DrainOrder()

    def close(self) -> None:
        """Close what is open; the workers have ended, or find out by it."""
        for worker in self.workers:
            worker.process.close()
        self._order.close()

    @property
    def status(self) -> int:
        """The exit status that the bridge would end with now."""
        if self._cannot_start:
            return CANNOT_START
        return FAILED if self.failures else DONE

    @property
    def is_over(self) -> bool:
        """Whether no worker runs or is started again."""
        return all(worker.is_over for worker in self.workers)

    @property
    def next_look_s(self) -> float:
        """When to look at the workers at the latest, where they tell nothing before."""
        return min((worker.next_look_s for worker in self.workers), default=math.inf)

    @property
    def has_begun(self) -> bool:
        """Whether every route has begun, but for those that cannot."""
        return all(worker.has_begun or worker.is_over for worker in self.workers)

    def snapshots(self) -> list[Snapshot]:
        """What the workers have told last of the routes that they run."""
        running = [worker for worker in self.workers if not worker.waits]
        return [s for worker in running for s in worker.snapshots.values()]

    def worker_of(self, route: str) -> WorkerHandle | None:
        """Who runs a route, or is to run it soon."""
        found = [worker for worker in self.workers if route in worker.snapshots]
        return min(found, key=lambda worker: worker.waits, default=None)

    # Who there is

    def fill(self) -> None:
        """Have workers for the routes of the plan that none has."""
        names = set(self.plan.names)
        missing = names.difference(*(worker.snapshots for worker in self.workers))
        if missing == names:
            self.add(self.plan.shares())
        elif missing:
            to_ros, from_ros = self.plan.directions(missing)
            self.add(share_out(to_ros, from_ros, bool(to_ros) + bool(from_ros)))

    def add(self, shares: Iterable[Share], awaits: Plan | None = None) -> list[WorkerHandle]:
        """Have a further worker for each share; it is started by the next `tick`.

        Args:
            shares: Their routes.
            awaits: A plan that is to count later; they are told when to begin.
        """
        added = []
        for share in shares:
            used = {worker.number for worker in self.workers}
            number = next(n for n in count(1) if n not in used)
            child = ChildProcess('process.worker', 'snapshots', self.selector)
            added.append(WorkerHandle(number, share, child, awaits))
            self.workers.append(added[-1])
        return added

    def add_own(self, own: InProcessWorker) -> None:
        """Have the bridge of this process, which has all routes, as a worker, too."""
        self.workers.append(WorkerHandle(0, Share(tuple(self.plan.names), Rank.BOTH), own))

    # What they run

    def adopt(self, plan: Plan) -> None:
        """Let another plan count from now on, also for who is started again."""
        self.plan = plan
        self.paused &= set(plan.names)

    def pause(self, route: str) -> None:
        """Let a route pause, and remember it for who runs it later."""
        self.paused.add(route)
        for worker in self.workers:
            if route in worker.snapshots:
                worker.send(PauseRoute(route))

    def resume(self, route: str) -> None:
        """Let a paused route go on."""
        self.paused.discard(route)
        for worker in self.workers:
            if route in worker.snapshots:
                worker.send(ResumeRoute(route))

    # Their lives

    def tick(self) -> None:
        """Start who is due, take what they tell, and see who has ended."""
        for worker in self.workers:
            if worker.is_due:
                self._start(worker)
            if worker.hangs:
                self._log.error('%s does not begin: it is killed', worker)
                worker.kill()
            status = worker.process.exit_status()
            worker.on_lines(worker.process.exchange())
            if status is not None:
                self._on_end(worker, status)
        self._has_begun = self._has_begun or any(worker.has_begun for worker in self.workers)
        for worker in [w for w in self.workers if w.is_over and not w.snapshots]:
            worker.process.close()
            self.workers.remove(worker)

    def _start(self, worker: WorkerHandle) -> None:
        order, kept = self._order.of(worker.rank)
        try:
            worker.start(self.plan, [*order, *self._arguments], kept, self.paused)
            self._log.info('%s is process %d', worker, worker.process.pid)
        except OSError as error:
            self._start_later(worker, f'could not be started ({error.strerror})')

    def _on_end(self, worker: WorkerHandle, status: int) -> None:
        failed = worker.failed_for_good
        # A worker that was killed and comes back has lost nothing; one that gave up says so.
        self.failures += bool(failed or status == FAILED or (status and worker.is_draining))
        worker.forget(set(worker.leaving))
        if worker.is_draining or not worker.snapshots:
            worker.is_over = True
        elif worker.is_in_process:
            worker.is_over = True
            if len(failed) < len(worker.snapshots):
                self._ask_to_stop()  # a bug has ended it
        elif worker.is_ending:
            worker.is_over = True
            self.failures += 1  # it has drained nothing
            self._log.error('%s %s while others drained', worker, _how(status))
        elif status == CANNOT_START and worker.waits:
            worker.is_over = True
        elif status == CANNOT_START and worker.starts == 1 and not self._has_begun:
            worker.is_over = self._cannot_start = True  # it has said why
            self._ask_to_stop()
        elif len(failed) == len(worker.snapshots):
            worker.is_over = True
            self._log.error('%s has ended: its routes have failed for good', worker)
        else:
            self._start_later(worker, _how(status))

    def _ask_to_stop(self) -> None:
        if not self._stop.asked:  # once more would be an end at once
            self._stop.ask()

    def _start_later(self, worker: WorkerHandle, how: str) -> None:
        wait_s = worker.start_later(how)
        self._log.error('%s %s: started again in %.0f s', worker, how, wait_s)


class _DrainOrder:
    """Pipes by which those who drain later see that those before them have ended.

    The ones hold one end, the others see it close at the other: even without a supervisor.
    """

    def __init__(self) -> None:
        self._pipes: dict[Rank, tuple[int, int]] = {}
        with ExitStack() as undone:
            undone.callback(self.close)
            for rank in (Rank.TO_ROS, Rank.BOTH):
                self._pipes[rank] = os.pipe()
            undone.pop_all()

    def close(self) -> None:
        for ends in self._pipes.values():
            for end in ends:
                os.close(end)

    def of(self, rank: Rank) -> tuple[list[str], list[int]]:
        """The options of a worker of a rank, and the descriptors that it keeps open."""
        runs = [write for own, (_, write) in self._pipes.items() if rank <= own]
        waits = [read for own, (read, _) in self._pipes.items() if rank == own + 1]
        return [f'--after={read}' for read in waits], [*runs, *waits]


def _how(status: int) -> str:
    if status >= 0:
        return f'ended with status {status}'
    try:
        return f'was ended by {signal.Signals(-status).name}'
    except ValueError:
        return f'was ended by signal {-status}'
