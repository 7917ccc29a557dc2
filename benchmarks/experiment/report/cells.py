"""`cells.csv`: one line for each cell, for those who calculate on."""

import csv
import io
from collections.abc import Callable, Mapping
from typing import Final

from benchmarks.experiment.results import Experiment, Hops, Latency, Result, Usage

Value = str | int | float | bool | None


def cells_csv(experiment: Experiment) -> str:
    """Write all that was measured but the curves; what is not there is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(_FIELDS)
    for result in experiment.results:
        writer.writerow([_plain(read(result)) for read in _FIELDS.values()])
    return text.getvalue()


def _plain(value: Value) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:.10g}' if isinstance(value, float) else str(value)


def _latency(read: Callable[[Latency], float]) -> Callable[[Result], Value]:
    return lambda result: read(result.latency) if result.latency else None


def _hop(read: Callable[[Hops], float]) -> Callable[[Result], Value]:
    return lambda result: read(result.hops) if result.hops else None


def _usage(name: str, of: Callable[[Result], Usage]) -> Mapping[str, Callable[[Result], Value]]:
    return {
        f'{name}_before_mib': lambda result: of(result).before_mib,
        f'{name}_peak_mib': lambda result: of(result).peak_mib,
        f'{name}_cpu_s': lambda result: of(result).cpu_s,
    }


_FIELDS: Final[Mapping[str, Callable[[Result], Value]]] = {
    'load': lambda r: r.cell.load.name,
    'rate_orders_per_s': lambda r: r.cell.load.rate,
    'burst_orders': lambda r: r.cell.load.burst,
    'load_of_paper': lambda r: r.cell.load.of_paper,
    'contestant': lambda r: r.cell.contestant,
    'depth_messages': lambda r: r.cell.depth,
    'length_s': lambda r: r.cell.seconds,
    'at': lambda r: r.at,
    'producer_orders': lambda r: r.counts.producer,
    'kafka_ros_orders': lambda r: r.counts.kafka_ros,
    'ros_kafka_orders': lambda r: r.counts.ros_kafka,
    'consumer_orders': lambda r: r.counts.consumer,
    'lost_orders': lambda r: r.counts.lost,
    'lost_share': lambda r: r.counts.loss,
    'duplicated_orders': lambda r: r.counts.duplicated,
    'out_of_order_orders': lambda r: r.counts.out_of_order,
    'sent_orders_per_s': lambda r: r.sent_per_s,
    'delivered_orders_per_s': lambda r: r.delivered_per_s,
    'latency_first_ms': _latency(lambda latency: latency.first),
    'latency_fastest_ms': _latency(lambda latency: latency.fastest),
    'latency_median_ms': _latency(lambda latency: latency.median),
    'latency_p95_ms': _latency(lambda latency: latency.p95),
    'latency_p99_ms': _latency(lambda latency: latency.p99),
    'latency_p999_ms': _latency(lambda latency: latency.p999),
    'latency_slowest_ms': _latency(lambda latency: latency.slowest),
    'hop_to_ros_median_ms': _hop(lambda hops: hops.to_ros),
    'hop_to_kafka_median_ms': _hop(lambda hops: hops.to_kafka),
    'hop_to_consumer_median_ms': _hop(lambda hops: hops.to_consumer),
    **_usage('kafka_ros', lambda r: r.kafka_ros),
    **_usage('ros_kafka', lambda r: r.ros_kafka),
    **_usage('broker', lambda r: r.broker),
    'cpu_ms_per_order': lambda r: r.cpu_ms_per_order,
    'broker_share_of_cpu': lambda r: r.broker_share,
    'problems': lambda r: '; '.join(r.problems),
}
