"""The metrics of a bridge in the words of Prometheus."""

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import accumulate
from pathlib import Path
from typing import Final, Literal, NamedTuple

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Report, RouteReport, Worker
from ros2_kafka_bridge.route.counters import BOUNDS_S, Distribution, Outcome, State

PREFIX: Final = 'ros2_kafka_bridge_'
_NO_ERRORS: Final = dict.fromkeys(
    (
        'DecodeError', 'EncodeError', 'LoopError', 'RecordTooLargeError', 'RouteError',
        'TimestampError', 'TransportError',
    ),
    0,
)  # fmt: skip
_PAGE_BYTES: Final = os.sysconf('SC_PAGE_SIZE')

Labels = tuple[str, ...]
MetricKind = Literal['gauge', 'counter', 'histogram']
SampleValue = float | Distribution
Sample = tuple[Labels, SampleValue]


class Seen(NamedTuple):
    """What metrics are made of: one report, and the configuration that belongs to it.

    Args:
        report: None before the first one.
        report_age_s: How long ago it came.
        routes: The settings of each route, by its name.
    """

    report: Report | None
    report_age_s: float
    routes: dict[str, AnyRoute]

    @property
    def listed(self) -> tuple[RouteReport, ...]:
        """All routes."""
        return self.report.routes if self.report else ()

    @property
    def told(self) -> list[RouteReport]:
        """Those that have told their numbers: of the others not even a 0 is known."""
        return [route for route in self.listed if route.age_s is not None]

    def direction(self, told: RouteReport) -> Direction | None:
        """Of a route; None where its settings are not known."""
        route = self.routes.get(told.snapshot.route)
        return route.direction if route else None


class MetricDefinition(NamedTuple):
    """A metric.

    Args:
        name: With its unit, without the prefix and without `_total`.
        kind: Its type.
        help: What it says, in a sentence.
        labels: The names of its labels beside `bridge`.
        samples: Finds its values.
    """

    name: str
    kind: MetricKind
    help: str
    labels: Labels
    samples: Callable[[Seen], Iterable[Sample]]

    @property
    def full_name(self) -> str:
        """As a query spells it."""
        return f'{PREFIX}{self.name}' + ('_total' if self.kind == 'counter' else '')


def _of_routes(
    name: str,
    kind: MetricKind,
    about: str,
    read: Callable[[RouteReport], SampleValue | None],
    direction: Direction | None = None,
) -> MetricDefinition:
    """A metric of each route, or of each in one direction, as far as it is known."""

    def samples(seen: Seen) -> Iterator[Sample]:
        for told in seen.told:
            is_meant = direction in {None, seen.direction(told)}
            if is_meant and (value := read(told)) is not None:
                yield (told.snapshot.route,), value

    return MetricDefinition(name, kind, about, ('route',), samples)


def _of_workers(
    name: str, kind: MetricKind, about: str, read: Callable[[Worker], float | None]
) -> MetricDefinition:
    def samples(seen: Seen) -> Iterator[Sample]:
        for worker in seen.report.workers if seen.report else ():
            if (value := read(worker)) is not None:
                yield (str(worker.number),), value

    return MetricDefinition(name, kind, about, ('worker',), samples)


def _of_report(name: str, about: str, read: Callable[[Report], float]) -> MetricDefinition:
    def samples(seen: Seen) -> Iterator[Sample]:
        if seen.report is not None:
            yield (), read(seen.report)

    return MetricDefinition(name, 'gauge', about, (), samples)


def _ended(seen: Seen) -> Iterator[Sample]:
    for told in seen.told:
        for outcome in Outcome:
            yield (told.snapshot.route, outcome.value), getattr(told.snapshot, outcome.value)


def _errors(seen: Seen) -> Iterator[Sample]:
    for told in seen.told:
        # Also those that have not come: a rate does not see a counter that begins at 1.
        for name, number in sorted((_NO_ERRORS | told.snapshot.measures.errors).items()):
            yield (told.snapshot.route, name), number


def _broker_round_trip(seen: Seen) -> Iterator[Sample]:
    for told in seen.told:
        if (found := told.snapshot.measures.broker_round_trip_s) is not None:
            yield (told.snapshot.route, '0.5'), found[0]
            yield (told.snapshot.route, '0.99'), found[1]


def _states(seen: Seen) -> Iterator[Sample]:
    for told in seen.listed:
        for state in State:
            yield (told.snapshot.route, state.value), float(told.snapshot.state is state)


def _lifecycle(seen: Seen) -> Iterator[Sample]:
    if seen.report is not None:
        for state in Lifecycle:
            yield (state.value,), float(seen.report.lifecycle is state)


def _about_routes(seen: Seen) -> Iterator[Sample]:
    for told in seen.listed:
        if (route := seen.routes.get(told.snapshot.route)) is not None:
            kind = route.type_name or ''
            yield (route.name, route.direction, *route.topics, kind, route.format), 1


def _spool_limits(seen: Seen) -> Iterator[Sample]:
    for told in seen.listed:
        route = seen.routes.get(told.snapshot.route)
        if route is not None and route.spool is not None:
            yield (route.name,), route.spool.max_bytes


def memory_bytes(pid: int) -> int | None:
    """The resident memory of a process; None where it is gone or hidden."""
    try:
        return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * _PAGE_BYTES
    except (OSError, ValueError, IndexError):
        return None


METRICS: Final = (
    MetricDefinition(
        'build_info', 'gauge', 'Version of the bridge.', ('version',),
        lambda _: [((__version__,), 1)],
    ),
    _of_routes('messages_taken', 'counter', 'Records or messages that the route has taken.',
        lambda told: told.snapshot.taken),
    MetricDefinition(
        'messages_ended', 'counter', 'What became of those that were taken, each in one outcome.',
        ('route', 'outcome'), _ended,
    ),
    _of_routes('messages_in_flight', 'gauge', 'Taken and not ended yet.',
        lambda told: told.snapshot.in_flight),
    _of_routes('messages_spooled', 'gauge', 'Waiting on disk for Kafka.',
        lambda told: told.snapshot.spooled),
    _of_routes('messages_lost_upstream', 'counter',
        'Lost before the bridge could take them, as far as gaps in sequence numbers or '
        'offsets show.',
        lambda told: told.snapshot.lost_upstream),
    _of_routes('messages_repeated', 'counter',
        'Published again, because a reader had gone before it confirmed them.',
        lambda told: told.snapshot.repeated),
    _of_routes('messages_unproved', 'counter',
        'Sent to Kafka though a record there has their publisher and number, as the '
        'rest of its headers does not prove that it is theirs.',
        lambda told: told.snapshot.unproved),
    _of_routes('bytes_taken', 'counter', 'Bytes of values of records or of CDR, taken.',
        lambda told: told.snapshot.measures.bytes_taken),
    _of_routes('bytes_confirmed', 'counter', 'Bytes of what was confirmed, as it was taken.',
        lambda told: told.snapshot.measures.bytes_confirmed),
    _of_routes('bytes_published', 'counter',
        'Bytes of what was published to ROS where nothing confirms it, as it was taken.',
        lambda told: told.snapshot.measures.bytes_published),
    _of_routes('spool_bytes', 'gauge', 'Bytes that wait on disk.',
        lambda told: told.snapshot.measures.spool_bytes),
    MetricDefinition(
        'spool_limit_bytes', 'gauge',
        'Bytes on disk with which it is full; only routes with a spool.',
        ('route',), _spool_limits,
    ),
    MetricDefinition(
        'errors', 'counter', 'Errors by their class.', ('route', 'error'), _errors,
    ),
    _of_routes('bridge_seconds', 'histogram', 'From the take to the confirmation.',
        lambda told: told.snapshot.measures.in_bridge),
    _of_routes('end_to_end_seconds', 'histogram',
        'From the time of the record, or that of its publisher, to its publication in '
        'ROS, or its confirmation by Kafka.',
        lambda told: told.snapshot.measures.end_to_end),
    _of_routes('publish_seconds', 'histogram',
        'From the take of a record to its publication (Kafka to ROS).',
        lambda told: told.snapshot.measures.published, Direction.KAFKA_TO_ROS),
    _of_routes('produce_seconds', 'histogram',
        'From handing a record to the producer to its delivery report (ROS to Kafka).',
        lambda told: told.snapshot.measures.round_trip, Direction.ROS_TO_KAFKA),
    MetricDefinition(
        'broker_round_trip_seconds', 'gauge', 'Round trip to the slowest broker in the last '
        'seconds, as librdkafka measures it (ROS to Kafka).', ('route', 'quantile'),
        _broker_round_trip,
    ),
    _of_routes('consumer_lag_records', 'gauge',
        'Records in Kafka behind the last that has ended (Kafka to ROS).',
        lambda told: told.snapshot.lag),
    _of_routes('sink_queue_messages', 'gauge',
        'What the sink holds: the history of the ROS writer, the queue of the producer.',
        lambda told: told.snapshot.measures.queued),
    _of_routes('sink_queue_limit_messages', 'gauge', 'How much the sink may hold.',
        lambda told: told.snapshot.measures.queue_limit),
    _of_routes('memory_limit_bytes', 'gauge',
        'How much memory the route may take, beside what its process takes without it.',
        lambda told: told.snapshot.memory_limit),
    _of_routes('back_pressure_seconds', 'counter',
        'For how long the sink has held the route back.',
        lambda told: told.snapshot.measures.waited_s),
    _of_routes('rebalances', 'counter', 'How often partitions came or went (Kafka to ROS).',
        lambda told: told.snapshot.measures.rebalances, Direction.KAFKA_TO_ROS),
    _of_routes('kafka_up', 'gauge',
        'Whether Kafka answers the route; no sample while that is not known.',
        lambda told: told.snapshot.measures.kafka_up),
    _of_routes('dds_matched_endpoints', 'gauge', "DDS endpoints that match the route's own.",
        lambda told: told.snapshot.measures.matched),
    _of_routes('dds_mismatched_endpoints', 'gauge',
        "DDS endpoints on the route's topic that do not match: their QoS or type differs.",
        lambda told: told.snapshot.measures.mismatched),
    MetricDefinition(
        'route_state', 'gauge', '1 for the state in which the route is, 0 for the others.',
        ('route', 'state'), _states,
    ),
    MetricDefinition(
        'route_info', 'gauge', 'What the route joins.',
        ('route', 'direction', 'source', 'sink', 'type', 'format'), _about_routes,
    ),
    _of_routes('route_snapshot_age_seconds', 'gauge', "Age of the route's numbers.",
        lambda told: told.age_s),
    _of_workers('worker_up', 'gauge', 'Whether the process runs.',
        lambda worker: float(worker.pid > 0)),
    _of_workers('worker_starts', 'counter', 'How often the process was started.',
        lambda worker: worker.starts),
    _of_workers('worker_resident_memory_bytes', 'gauge', 'Memory of the process.',
        lambda worker: memory_bytes(worker.pid) if worker.pid else None),
    MetricDefinition(
        'lifecycle_state', 'gauge', '1 for the state in which the bridge is, 0 for the others.',
        ('state',), _lifecycle,
    ),
    MetricDefinition(
        'report_age_seconds', 'gauge', 'How long ago the supervisor has told all these numbers.',
        (), lambda seen: [((), seen.report_age_s)],
    ),
    _of_report('config_reload_success',
        'Whether the last reload of the configuration succeeded; 1 before the first.',
        lambda report: float(report.reload is None or report.reload.done)),
    _of_report('config_reload_timestamp_seconds',
        'When the configuration was last read, since 1970.',
        lambda report: report.reload.time_s if report.reload else report.started_s),
    _of_report('start_time_seconds', 'When the bridge was started, since 1970.',
        lambda report: report.started_s),
)  # fmt: skip
"""Every metric, in the order in which they are told."""


class BridgeCollector(Collector):
    """Makes the metrics of one report at each scrape: their balance is that of its snapshots.

    Args:
        watch: Knows the last report.
    """

    def __init__(self, watch: Watch) -> None:
        self._watch = watch

    def describe(self) -> Iterator[Metric]:
        """All metrics without their samples, so that one can be asked for by its name."""
        for metric in METRICS:
            yield Metric(f'{PREFIX}{metric.name}', metric.help, metric.kind)

    def collect(self) -> Iterator[Metric]:
        """All metrics."""
        routes = {route.name: route for route in self._watch.routes}
        seen = Seen(self._watch.report(), self._watch.report_age_s, routes)
        bridge = self._watch.config.name
        for metric in METRICS:
            yield _family(metric, seen, bridge)


def _family(metric: MetricDefinition, seen: Seen, bridge: str) -> Metric:
    name, labels = f'{PREFIX}{metric.name}', ('bridge', *metric.labels)
    if metric.kind == 'histogram':
        histogram = HistogramMetricFamily(name, metric.help, labels=labels)
        for own, value in metric.samples(seen):
            assert isinstance(value, Distribution), f'{name} is told as a distribution'
            histogram.add_metric((bridge, *own), _buckets(value), value.sum_s)
        return histogram
    kind = CounterMetricFamily if metric.kind == 'counter' else GaugeMetricFamily
    family = kind(name, metric.help, labels=labels)
    for own, value in metric.samples(seen):
        assert not isinstance(value, Distribution), f'{name} is told as a number'
        family.add_metric((bridge, *own), value)
    return family


def _buckets(found: Distribution) -> list[tuple[str, float]]:
    bounds = [*map(floatToGoString, BOUNDS_S), '+Inf']
    return list(zip(bounds, accumulate(found.counts), strict=True))
