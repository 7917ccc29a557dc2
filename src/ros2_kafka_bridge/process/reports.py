"""How the whole bridge is doing, put together from what its workers tell."""

import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.protocol.limits import STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Report, RouteReport, Worker
from ros2_kafka_bridge.route.counters import Counters, Snapshot, State

if TYPE_CHECKING:
    from ros2_kafka_bridge.process.control_plane import ControlPlane
    from ros2_kafka_bridge.process.worker_pool import WorkerPool

_RUNS: Final = frozenset({State.RUNNING, State.WAITING, State.PAUSED})


def report_of(
    pool: 'WorkerPool', control: 'ControlPlane', started_s: float, *, stopping: bool
) -> Report:
    """Put a report together."""
    now_s = time.monotonic()
    names = pool.plan.names
    return Report(
        time_s=time.time(),
        lifecycle=control.lifecycle,
        stopping=stopping,
        started_s=started_s,
        workers=tuple(
            Worker(
                worker.number,
                worker.process.pid,
                worker.starts,
                worker.problem,
                worker.silent_s,
            )
            for worker in pool.workers
        ),
        routes=tuple(_route(name, pool, control.lifecycle, now_s) for name in names),
        paused=tuple(name for name in names if name in pool.paused),
        reload=control.last_reload,
    )


def _route(name: str, pool: 'WorkerPool', lifecycle: Lifecycle, now_s: float) -> RouteReport:
    worker = pool.worker_of(name)
    if worker is None:
        snapshot = pool.last.get(name) or Counters(name).nothing_told
        reason = '' if lifecycle is Lifecycle.ACTIVE else f'the bridge is {lifecycle}'
        stopped = snapshot.at_rest._replace(state=State.STOPPED, reason=reason)
        return RouteReport(0, _age_s(stopped, now_s), 0.0, stopped)
    snapshot = worker.snapshots[name]
    busy_s = _busy_s(snapshot, now_s)
    return RouteReport(worker.number, _age_s(snapshot, now_s), busy_s, snapshot)


def _age_s(snapshot: Snapshot, now_s: float) -> float | None:
    return max(0.0, now_s - snapshot.made_s) if snapshot.made_s else None


def in_words(lifecycle: Lifecycle, snapshots: Sequence[Snapshot]) -> str:
    """How a bridge is doing, in a line: how many routes do what they should."""
    runs = sum(snapshot.state in _RUNS for snapshot in snapshots)
    some = f'{runs} of ' if runs < len(snapshots) else ''
    return f'{lifecycle}: {some}{count(len(snapshots), "route")}'


def is_live(snapshots: Iterable[Snapshot]) -> bool:
    """Whether no route is stuck; one that waits on purpose, or for its worker, is not."""
    now_s = time.monotonic()
    return all(_busy_s(snapshot, now_s) < STUCK_S for snapshot in snapshots)


def _busy_s(snapshot: Snapshot, now_s: float) -> float:
    return max(0.0, now_s - snapshot.beat_s) if snapshot.beat_s else 0.0
