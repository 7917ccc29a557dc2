"""What `/diagnostics` says of the bridge, its workers and its routes, as plain values."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.protocol.advice import advice
from ros2_kafka_bridge.protocol.limits import OLD_S, STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Report, RouteReport, Worker
from ros2_kafka_bridge.protocol.quantiles import percentiles
from ros2_kafka_bridge.route.counters import Distribution, Measures, Outcome, Snapshot, State

_RATE_S: Final = 10.0
_RECENT_S: Final = 60.0
_SPOOL_FULL: Final = 0.8


class Level(IntEnum):
    """How bad it is, as diagnostic_msgs/DiagnosticStatus numbers it."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Status(NamedTuple):
    """One DiagnosticStatus, but for the hardware id.

    Args:
        name: Of the bridge's node, a colon, and what it is about.
        message: How it is, why, and what to do.
        values: Numbers and names beside it.
    """

    name: str
    level: Level
    message: str
    values: tuple[tuple[str, str], ...]


class Diagnosis(NamedTuple):
    """One thing to be said of a route."""

    level: Level
    text: str


class Change(NamedTuple):
    """What has become of a route lately.

    Args:
        rate: Messages carried per second, over ten seconds.
        dead_lettered: Within the last minute, as are those that were lost.
        delay_s: The 50th and 99th percentile within the last minute; None where nothing came on.
    """

    rate: float | None = None
    dead_lettered: int = 0
    lost: int = 0
    lost_upstream: int = 0
    delay_s: tuple[float, float] | None = None


class _Mark(NamedTuple):
    at_s: float
    carried: int
    dead_lettered: int
    lost: int
    lost_upstream: int
    delay: Distribution

    @classmethod
    def of(cls, at_s: float, told: Snapshot) -> '_Mark':
        letters, delay = told.dead_lettered, told.measures.delay
        return cls(at_s, told.carried, letters, told.lost, told.lost_upstream, delay)

    def began_again(self, before: '_Mark') -> bool:
        """Whether the process of the route was started again: then a counter falls."""
        return any(now < then for now, then in zip(self.counters, before.counters, strict=True))

    @property
    def counters(self) -> tuple[int, ...]:
        """What never falls."""
        return self.carried, self.dead_lettered, self.lost, self.lost_upstream


class RecentCounters:
    """The counters of the last minute, for what has changed since."""

    def __init__(self) -> None:
        self._marks: dict[str, deque[_Mark]] = {}

    def add(self, report: Report, now_s: float) -> None:
        """Note a report; routes that it does not name any more are forgotten."""
        kept: dict[str, deque[_Mark]] = {}
        for told in report.routes:
            marks = self._marks.get(told.snapshot.route, deque())
            mark = _Mark.of(now_s, told.snapshot)
            if marks and mark.began_again(marks[-1]):
                marks.clear()
            marks.append(mark)
            while marks[0].at_s < now_s - _RECENT_S:
                marks.popleft()
            kept[told.snapshot.route] = marks
        self._marks = kept

    def change(self, route: str) -> Change:
        """What has become of a route."""
        marks = self._marks.get(route)
        if not marks:
            return Change()
        first, last = marks[0], marks[-1]
        lately = next(mark for mark in marks if mark.at_s >= last.at_s - _RATE_S)
        period_s = last.at_s - lately.at_s
        return Change(
            rate=(last.carried - lately.carried) / period_s if period_s > 0 else None,
            dead_lettered=last.dead_lettered - first.dead_lettered,
            lost=last.lost - first.lost,
            lost_upstream=last.lost_upstream - first.lost_upstream,
            delay_s=percentiles(last.delay, first.delay),
        )


class BridgeIdentity(NamedTuple):
    """What a bridge is, beside what it reports.

    Args:
        node: Name of its node; every status begins with it.
        file: Its configuration file.
        version: Of the program.
        routes: Those that it runs.
    """

    node: str
    file: str
    version: str
    routes: Sequence[AnyRoute]


def statuses(
    bridge: BridgeIdentity, report: Report | None, silent_s: float, recent: RecentCounters
) -> list[Status]:
    """All that is to be said: the bridge, its workers, its routes.

    Args:
        bridge: Which one.
        report: The last one, None before the first.
        silent_s: How long ago it came.
        recent: What has changed lately.
    """
    if report is None or silent_s > OLD_S:
        return [*_silent(bridge, silent_s)]
    told = {route.snapshot.route: route for route in report.routes}
    workers = {worker.number: worker for worker in report.workers}
    routes = [
        _route_status(bridge, route, told.get(route.name), workers, recent.change(route.name))
        for route in bridge.routes
    ]
    below = [*(_worker_status(bridge, worker, report) for worker in report.workers), *routes]
    return [_bridge_status(bridge, report, below), *below]


def _silent(bridge: BridgeIdentity, silent_s: float) -> Iterator[Status]:
    text = f'the bridge has reported nothing for {silent_s:.0f} s: look at its log'
    yield Status(f'{bridge.node}: bridge', Level.STALE, text, _of_bridge(bridge))
    for route in bridge.routes:
        yield Status(f'{bridge.node}: {route.name}', Level.STALE, text, _of_route(route))


# The bridge


def _bridge_status(bridge: BridgeIdentity, report: Report, below: Sequence[Status]) -> Status:
    own = [*_bridge_diagnoses(report)]
    bad = [status for status in below if status.level is not Level.OK]
    level = max([Level.OK, *(one.level for one in own), *(status.level for status in bad)])
    texts = [f'{report.lifecycle}, {count(len(bridge.routes), "route")}']
    texts += [one.text for one in own]
    texts += [f'{status.name.removeprefix(bridge.node + ": ")} {_word(status)}' for status in bad]
    values = [
        *_of_bridge(bridge),
        ('lifecycle', str(report.lifecycle)),
        ('workers', str(len(report.workers))),
        ('paused routes', ', '.join(report.paused)),
        ('last reload', report.reload.text if report.reload else ''),
    ]
    return Status(f'{bridge.node}: bridge', level, '; '.join(texts), tuple(values))


def _word(status: Status) -> str:
    return status.message.partition(':')[0]


def _bridge_diagnoses(report: Report) -> Iterator[Diagnosis]:
    if report.stopping:
        yield Diagnosis(Level.WARN, 'it drains to end')
    elif report.lifecycle is not Lifecycle.ACTIVE:
        cure = (
            'configure and activate' if report.lifecycle is Lifecycle.UNCONFIGURED else 'activate'
        )
        yield Diagnosis(Level.WARN, f'no route runs: {cure} it')
    if report.reload is not None and not report.reload.done:
        text = 'the last reload was refused, and what ran before goes on: mend the file'
        yield Diagnosis(Level.WARN, text)


def _of_bridge(bridge: BridgeIdentity) -> tuple[tuple[str, str], ...]:
    return (('version', bridge.version), ('config file', bridge.file))


def _worker_status(bridge: BridgeIdentity, worker: Worker, report: Report) -> Status:
    own = [told.snapshot.route for told in report.routes if told.worker == worker.number]
    away = not worker.pid and report.lifecycle is Lifecycle.ACTIVE
    problem = f'away: {worker.problem or "it does not run"}; it is started again by itself'
    message = problem if away else 'running' if worker.pid else 'ended with its routes'
    if worker.silent_s > OLD_S:
        message = f'silent: it has told nothing for {worker.silent_s:.0f} s'
    values = (
        ('pid', str(worker.pid)),
        ('starts', str(worker.starts)),
        ('routes', ', '.join(own)),
    )
    level = Level.ERROR if away else Level.STALE if worker.silent_s > OLD_S else Level.OK
    return Status(f'{bridge.node}: worker {worker.number}', level, message, values)


# A route


def _route_status(
    bridge: BridgeIdentity,
    route: AnyRoute,
    told: RouteReport | None,
    workers: Mapping[int, Worker],
    change: Change,
) -> Status:
    name = f'{bridge.node}: {route.name}'
    if told is None:
        text = 'unknown: its worker has told nothing of it yet'
        return Status(name, Level.STALE, text, _of_route(route))
    found = sorted(_diagnoses(route, told, workers, change), key=lambda one: -one.level)
    message = '; '.join(one.text for one in found)
    values = (*_of_route(route), *_counted(told, change))
    return Status(name, found[0].level, message, values)


def _diagnoses(
    route: AnyRoute, told: RouteReport, workers: Mapping[int, Worker], change: Change
) -> Iterator[Diagnosis]:
    worker = workers.get(told.worker)
    if worker is None or not worker.pid:
        yield _without_worker(told, worker)
    else:
        yield _of_state(route, told)
        yield from _of_sink(route, told.snapshot)
    yield from _of_changes(route, told.snapshot, change)


def _without_worker(told: RouteReport, worker: Worker | None) -> Diagnosis:
    if told.snapshot.state is State.STOPPED:
        return Diagnosis(Level.WARN, _how_it_is(told.snapshot))
    reason = (worker.problem if worker else '') or 'it does not run'
    return Diagnosis(Level.ERROR, f'worker {told.worker} is away: {reason}')


_LEVELS: Final = {
    State.STARTING: Level.WARN,
    State.RUNNING: Level.OK,
    State.WAITING: Level.WARN,
    State.PAUSED: Level.WARN,
    State.FAILED: Level.ERROR,
    State.STOPPED: Level.WARN,
}


_KEEPS_MORE: Final = {
    Direction.KAFKA_TO_ROS: 'a longer retention',
    Direction.ROS_TO_KAFKA: 'a publisher with a deeper queue',
}


def _of_state(route: AnyRoute, told: RouteReport) -> Diagnosis:
    now = told.snapshot
    if told.busy_s > STUCK_S:
        text = f'stuck: its thread has done one thing for {told.busy_s:.0f} s: start it again'
        return Diagnosis(Level.ERROR, text)
    if now.state is State.RUNNING and told.age_s is not None and told.age_s > OLD_S:
        return Diagnosis(
            Level.STALE, f'silent: its thread has told nothing for {told.age_s:.0f} s'
        )
    todo = advice(now, route)
    text = '. '.join(part for part in (_how_it_is(now), todo) if part)
    return Diagnosis(_LEVELS[now.state], text)


def _how_it_is(now: Snapshot) -> str:
    return ': '.join(part for part in (str(now.state), now.reason) if part)


def _of_sink(route: AnyRoute, now: Snapshot) -> Iterator[Diagnosis]:
    ros = route.ros_topic
    if mismatched := now.measures.mismatched:
        text = f'{count(mismatched, "endpoint")} on {ros} cannot match it, by type or QoS'
        yield Diagnosis(Level.WARN, f'{text}: ros2 topic info --verbose {ros}')
    limit = route.spool.max_bytes if route.spool else 0
    held_bytes = now.measures.spool_bytes or 0
    if limit and held_bytes > _SPOOL_FULL * limit:
        share = held_bytes / limit
        text = f'its spool is full to {share:.0%}: see why Kafka takes nothing'
        yield Diagnosis(Level.WARN, text)


def _of_changes(route: AnyRoute, now: Snapshot, change: Change) -> Iterator[Diagnosis]:
    lag, rate = now.lag or 0, change.rate or 0.0
    if now.state is State.RUNNING and lag > max(rate * _RECENT_S, route.max_in_flight):
        text = f'{lag} records behind: more than a minute at {rate:.0f}/s'
        yield Diagnosis(Level.WARN, text)
    if change.dead_lettered:
        text = f'{count(change.dead_lettered, "dead letter")} in the last minute'
        yield Diagnosis(Level.WARN, f'{text}: ros2-kafka-bridge dead-letters list')
    if change.lost:
        yield Diagnosis(Level.ERROR, f'{change.lost} lost on a damaged disk: replace it')
    if change.lost_upstream:
        cure = _KEEPS_MORE[route.direction]
        text = f'{change.lost_upstream} lost before the bridge (see its log): {cure} may help'
        yield Diagnosis(Level.WARN, text)


def _of_route(route: AnyRoute) -> tuple[tuple[str, str], ...]:
    source, sink = route.topics
    return (
        ('source', source),
        ('sink', sink),
        ('type', route.type_name or 'that of its publishers'),
        ('format', str(route.format)),
    )


def _queued(measures: Measures) -> str | None:
    if measures.queued is None:
        return None
    limit = f' of {measures.queue_limit}' if measures.queue_limit is not None else ''
    return f'{measures.queued}{limit}'


def _known(*values: tuple[str, int | str | None]) -> Iterator[tuple[str, str]]:
    """Those values that are known: the others are left out."""
    return ((name, str(value)) for name, value in values if value is not None)


def _counted(told: RouteReport, change: Change) -> Iterator[tuple[str, str]]:
    now, measures = told.snapshot, told.snapshot.measures
    yield 'state', str(now.state)
    yield 'worker', str(told.worker)
    if told.age_s is None:  # it has told nothing
        return
    yield 'age (s)', f'{told.age_s:.0f}'
    if change.rate is not None:
        yield 'rate (1/s)', f'{change.rate:.1f}'
    yield 'taken', str(now.taken)
    for outcome in Outcome:
        yield outcome.replace('_', ' '), str(getattr(now, outcome))
    yield 'in flight', str(now.in_flight)
    yield from _known(
        ('spooled', now.spooled),
        ('spool (bytes)', measures.spool_bytes),
        ('lag (records)', now.lag),
        ('matched', measures.matched),
        ('mismatched', measures.mismatched),
        ('queued', _queued(measures)),
        ('memory at most (bytes)', now.memory_limit),
    )
    for name, seconds in zip(('p50', 'p99'), change.delay_s or (), strict=False):
        yield f'delay {name} (s)', f'{seconds:.6g}'
    yield 'lost upstream', str(now.lost_upstream)
    yield 'repeated', str(now.repeated)
    yield 'unproved', str(now.unproved)
    yield 'errors', ', '.join(f'{kind}: {times}' for kind, times in measures.errors.items())
    if measures.troubles:
        yield 'last error', measures.troubles[-1].text
