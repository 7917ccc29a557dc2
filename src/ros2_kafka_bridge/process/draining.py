"""How workers drain and end: all of them in the right order, or some routes of one direction.

Each is a generator that goes on whenever it is asked to: workers must be listened to meanwhile.
"""

import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from typing import Final

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.exclusive.term import HANDOVER_S
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.plan import Rank, RoutePlan
from ros2_kafka_bridge.process.worker_handle import WorkerHandle
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.route.status import left

# More than a worker gives itself: it knows best what it leaves, and says so.
_ENDING_S: Final = 12.0
CLOSING_S: Final = _ENDING_S + HANDOVER_S
_AT_ONCE_S: Final = 5.0


def drain(pool: WorkerPool, at_once: Callable[[], bool]) -> Iterator[None]:
    """Drain the workers to ROS, then those from ROS; what does not end in time is killed.

    Each direction has a time of its own, whatever the other has used up.

    Args:
        pool: The workers.
        at_once: Whether to give up what is still in flight.
    """
    for worker in [worker for worker in pool.workers if worker.waits]:
        worker.retire()  # of a reload: it holds nothing that could be drained
    pool.failures += any(worker.is_away for worker in pool.workers)
    for worker in pool.workers:
        worker.is_over = worker.is_over or not worker.process.is_running
        worker.is_ending = True
    for rank in Rank:
        yield from _drain(pool.workers, rank, _limit_s(rank, pool.plan.routes), at_once)
    own = [worker for worker in pool.workers if worker.is_in_process]
    for worker in pool.workers:
        if worker.process.is_running and worker not in own:
            _kill(worker, pool.plan.routes)
            pool.failures += 1
    # To kill the bridge of this process would end all: it has limits of its own.
    while any(worker.process.is_running for worker in own):
        yield
        for worker in own if at_once() else []:
            worker.drain(at_once=True)
    pool.last |= {snapshot.route: snapshot for snapshot in pool.snapshots()}


def _drain(
    workers: Collection[WorkerHandle], rank: Rank, limit_s: float, at_once: Callable[[], bool]
) -> Iterator[None]:
    deadline_s = time.monotonic() + limit_s
    mine = [worker for worker in workers if worker.rank == rank]
    for worker in mine:
        worker.drain()
    while any(worker.process.is_running for worker in mine) and time.monotonic() < deadline_s:
        yield
        if at_once():
            for worker in workers:
                worker.drain(at_once=True)
            deadline_s = min(deadline_s, time.monotonic() + _AT_ONCE_S)


def _kill(worker: WorkerHandle, routes: Iterable[RoutePlan]) -> None:
    worker.kill()
    logs.route_log().error('%s did not end in time and was killed', worker)
    directions = {route.name: route.direction for route in routes}
    for name, snapshot in worker.snapshots.items():
        # Of a route that a reload takes out just now, the worse is said.
        held = left(snapshot, directions.get(name, Direction.ROS_TO_KAFKA))
        logs.route_log(name).error('its worker was killed: it is left with %s', held)


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


def end_routes(
    workers: Collection[WorkerHandle], routes: Iterable[str], drain_s: float
) -> Generator[None, None, list[str]]:
    """Drain some routes of one direction where they run, and have them no more after that.

    Who does not end them in time is killed, but for the first process, which holds what cannot
    be started again.

    Returns:
        The routes that this process still has.
    """
    names = set(routes)
    concerned = [worker for worker in workers if not worker.waits]
    for worker in concerned:
        worker.end(names)
    deadline_s = time.monotonic() + drain_s + CLOSING_S
    while any(w.leaving & names for w in concerned) and time.monotonic() < deadline_s:
        yield
    others = [worker for worker in concerned if not worker.is_in_process]
    for worker in others:
        if worker.leaving and worker.process.is_running:
            late = ', '.join(sorted(worker.leaving))
            logs.route_log().error('%s: %s did not end in time: it is killed', worker, late)
            worker.kill()
    while any(worker.leaving for worker in others):
        yield
    return sorted(name for w in concerned if w.is_in_process for name in w.leaving & names)


def end_workers(workers: Collection[WorkerHandle]) -> Iterator[None]:
    """Let some workers drain and end, and have them no more."""
    deadline_s = time.monotonic() + CLOSING_S
    for worker in workers:
        worker.drain()
    while any(worker.process.is_running for worker in workers) and time.monotonic() < deadline_s:
        yield
    for worker in workers:
        worker.retire()
