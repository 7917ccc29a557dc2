"""What the page shows of a bridge, as values for JSON, in sections that change apart."""

import time
from typing import Any

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.monitoring.health import liveness, readiness
from ros2_kafka_bridge.monitoring.history import RouteStatistics
from ros2_kafka_bridge.monitoring.prometheus import memory_bytes
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.advice import ERROR_ADVICE, advice
from ros2_kafka_bridge.protocol.limits import OLD_S
from ros2_kafka_bridge.protocol.monitor import RouteReport
from ros2_kafka_bridge.route.counters import Outcome

_MOST_TROUBLES = 100
_COUNTERS = (
    'taken', 'in_flight', 'lost_upstream', 'repeated', 'unproved', 'bytes_taken',
    'bytes_confirmed', 'bytes_published', 'waited_s', 'rebalances', 'errors',
)  # fmt: skip

Json = dict[str, Any]


def sections(watch: Watch) -> Json:
    """All that the reports tell: each section is sent again when it has changed.

    What is not known is None.
    """
    return {
        'bridge': bridge(watch),
        'about': [about(route, watch.config.name) for route in watch.routes],
        'routes': routes(watch),
        'troubles': troubles(watch),
        'workers': workers(watch),
    }


def bridge(watch: Watch) -> Json:
    """The bridge as a whole."""
    report, settings = watch.report(), watch.config.monitoring
    age_s = watch.report_age_s
    ready = readiness(report, age_s, [route.name for route in watch.routes])
    live = liveness(report, age_s)
    return {
        'name': watch.config.name,
        'version': __version__,
        'file': watch.configured.file,
        'now_s': round(time.time()),
        'report_age_s': round(age_s),
        'old': age_s > OLD_S,
        'started_s': report.started_s if report else None,
        'lifecycle': report.lifecycle if report else None,
        'stopping': report.stopping if report else None,
        'ready': ready.good,
        'live': live.good,
        'problems': list(dict.fromkeys([*live.problems, *ready.problems])),
        'may_change': bool(settings and settings.token),
        'reload': report.reload if report else None,
    }


def about(route: AnyRoute, bridge: str) -> Json:
    """What the configuration of the bridge of that name says of a route."""
    source, sink = route.topics
    return {
        'name': route.name,
        'direction': route.direction,
        'source': source,
        'sink': sink,
        'type': route.type_name or '',
        'format': route.format,
        'dead_letter_topic': route.dead_letter_topic,
        'group': route.group(bridge),
        'spool': route.spool is not None,
        'max_in_flight': route.max_in_flight,
        'drain_s': route.drain_s,
        'on_error': route.on_error,
        'when_full': route.when_full,
    }


def routes(watch: Watch) -> list[Json]:
    """All routes, as their workers told them last."""
    report = watch.report()
    paused = frozenset(report.paused if report else ())
    configured = {route.name: route for route in watch.routes}
    return [
        {
            **_route(told, watch.history.recent(told.snapshot.route)),
            'paused': told.snapshot.route in paused,
            'advice': advice(told.snapshot, configured.get(told.snapshot.route)),
        }
        for told in (report.routes if report else ())
    ]


def _route(told: RouteReport, recent: RouteStatistics) -> Json:
    row = _numbers(told, recent)
    if told.age_s is None:  # its counters stand at 0, but nobody has told so
        row |= dict.fromkeys(_COUNTERS) | {'ended': dict.fromkeys(row['ended'])}
    return row


def _numbers(told: RouteReport, recent: RouteStatistics) -> Json:
    now = told.snapshot
    measures = now.measures
    return {
        'name': now.route,
        'worker': told.worker,
        'state': now.state,
        'reason': now.reason,
        'final': now.final,
        'age_s': _rounded(told.age_s, 1),
        'busy_s': round(told.busy_s, 1),
        'rate': _rounded(recent.rate, 1),
        'bytes_rate': _rounded(recent.bytes_rate),
        'waited': _rounded(recent.waited, 3),
        'taken': now.taken,
        'ended': {outcome.value: getattr(now, outcome.value) for outcome in Outcome},
        'spooled': now.spooled,
        'in_flight': now.in_flight,
        'lag': now.lag,
        'lost_upstream': now.lost_upstream,
        'repeated': now.repeated,
        'unproved': now.unproved,
        'delay_s': _both(recent.delay),
        'in_bridge_s': _both(recent.in_bridge),
        'end_to_end_s': _both(recent.end_to_end),
        'produce_s': _both(recent.round_trip),
        'broker_round_trip_s': _both(measures.broker_round_trip_s),
        'bytes_taken': measures.bytes_taken,
        'bytes_confirmed': measures.bytes_confirmed,
        'bytes_published': measures.bytes_published,
        'spool_bytes': measures.spool_bytes,
        'waited_s': round(measures.waited_s, 1),
        'rebalances': measures.rebalances,
        'matched': measures.matched,
        'mismatched': measures.mismatched,
        'queued': measures.queued,
        'queue_limit': measures.queue_limit,
        'memory_limit': now.memory_limit,
        'errors': measures.errors,
    }


def _rounded(value: float | None, digits: int | None = None) -> float | None:
    return None if value is None else round(value, digits)


def _both(found: tuple[float, float] | None) -> list[float] | None:
    return None if found is None else [round(value, 6) for value in found]


def troubles(watch: Watch) -> list[Json]:
    """The last different errors of all routes, the newest first."""
    report = watch.report()
    found = [
        {
            'route': told.snapshot.route,
            **trouble._asdict(),
            'advice': ERROR_ADVICE.get(trouble.error, ''),
        }
        for told in (report.routes if report else ())
        for trouble in told.snapshot.measures.troubles
    ]
    return sorted(found, key=lambda it: it['time_s'], reverse=True)[:_MOST_TROUBLES]


def workers(watch: Watch) -> list[Json]:
    """All processes, with the routes that they run."""
    report = watch.report()
    if report is None:
        return []
    return [
        {
            'number': worker.number,
            'pid': worker.pid,
            'starts': worker.starts,
            'problem': worker.problem,
            'memory_bytes': memory_bytes(worker.pid) if worker.pid else None,
            'routes': [it.snapshot.route for it in report.routes if it.worker == worker.number],
        }
        for worker in report.workers
    ]


def sparks(watch: Watch) -> Json:
    """The last ten minutes of each route."""
    return {route.name: watch.history.spark(route.name) for route in watch.routes}
