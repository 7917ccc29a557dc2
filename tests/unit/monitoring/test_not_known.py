"""What is not known is not nought: of every name that is told, what it shows then, and when bad.

Each metric, and each value of the diagnostics and of the log, has a row, found in the code by its
name: how it shows that nobody knows, and how it shows what is bad. A name without a row fails
here; those of the page and of `status` are in `test_not_known_on_the_page.py`.
"""

from typing import Any, Final

import pytest
from support.monitoring.not_known import (
    ALWAYS,
    NONE,
    ORDERS,
    SILENT,
    SLOW,
    bad_report,
    badly,
    unknown_report,
)

from ros2_kafka_bridge.monitoring.prometheus import METRICS, Seen
from ros2_kafka_bridge.protocol.monitor import Report
from ros2_kafka_bridge.ros.control.diagnostics import (
    BridgeIdentity,
    RecentCounters,
    Status,
    statuses,
)
from ros2_kafka_bridge.route.status import figures

from .conftest import Told

# Metrics

METRIC_ROWS: Final = {
    # Without a sample where nobody knows; then the worst value of both routes.
    'build_info': (ALWAYS, 1),
    'messages_taken': (NONE, 72),
    'messages_ended': (NONE, 10),
    'messages_in_flight': (NONE, 7),
    'messages_spooled': (NONE, 16),
    'messages_lost_upstream': (NONE, 5),
    'messages_repeated': (NONE, 6),
    'messages_unproved': (NONE, 2),
    'bytes_taken': (NONE, 90),
    'bytes_confirmed': (NONE, 10),
    'bytes_published': (NONE, 30),
    'spool_bytes': (NONE, 4_900_000),
    'spool_limit_bytes': (NONE, 5_000_000),
    'errors': (NONE, 9),
    'bridge_seconds': (NONE, SLOW),
    'end_to_end_seconds': (NONE, SLOW),
    'publish_seconds': (NONE, SLOW),
    'produce_seconds': (NONE, SLOW),
    'broker_round_trip_seconds': (NONE, 9.0),
    'consumer_lag_records': (NONE, 500),
    'sink_queue_messages': (NONE, 500),
    'sink_queue_limit_messages': (NONE, 500),
    'memory_limit_bytes': (NONE, 111_000_000),
    'back_pressure_seconds': (NONE, 70.0),
    'rebalances': (NONE, 8),
    'kafka_up': (NONE, False),
    'dds_matched_endpoints': (NONE, 0),
    'dds_mismatched_endpoints': (NONE, 2),
    'route_state': (NONE, 1.0),
    'route_info': (NONE, 1),
    'route_snapshot_age_seconds': (NONE, 40.0),
    'worker_up': (NONE, 0.0),
    'worker_starts': (NONE, 9),
    'worker_resident_memory_bytes': (NONE, NONE),
    'lifecycle_state': (NONE, 1.0),
    'report_age_seconds': (ALWAYS, 40.0),  # before the first report: for how long it waits
    'config_reload_success': (NONE, 0.0),
    'config_reload_timestamp_seconds': (NONE, 990.0),
    'start_time_seconds': (NONE, 900.0),
}
# These are of the supervisor, which knows them although the route or its worker tells nothing.
OF_SUPERVISOR: Final = {
    'spool_limit_bytes', 'route_state', 'route_info', 'worker_up', 'worker_starts',
    'lifecycle_state', 'config_reload_success', 'config_reload_timestamp_seconds',
    'start_time_seconds',
}  # fmt: skip


def seen(told: Report | None) -> Seen:
    routes = {route.name: route for route in Told().watch.routes}
    return Seen(told, 40.0, routes)


def test_every_metric_has_a_row() -> None:
    assert set(METRIC_ROWS) == {metric.name for metric in METRICS}


@pytest.mark.parametrize('metric', METRICS, ids=lambda metric: metric.name)
def test_a_metric_has_no_sample_where_it_is_not_known_and_shows_what_is_bad(metric: Any) -> None:
    unknown, bad = METRIC_ROWS[metric.name]
    if unknown is not ALWAYS:
        assert list(metric.samples(seen(None))) == []
        if metric.name not in OF_SUPERVISOR:
            of_silent = [it for it in metric.samples(seen(unknown_report())) if ORDERS in it[0]]
            assert of_silent == [], 'nobody has told anything of this route'
    values = [value for _, value in metric.samples(seen(bad_report()))]
    assert bad in values or (bad is NONE and values == [])


OF_ONE_THAT_RUNS: Final = (
    'consumer_lag_records', 'kafka_up', 'dds_matched_endpoints', 'dds_mismatched_endpoints',
    'sink_queue_messages', 'sink_queue_limit_messages', 'broker_round_trip_seconds',
)  # fmt: skip


@pytest.mark.parametrize('name', OF_ONE_THAT_RUNS)
def test_what_only_a_route_that_runs_can_tell_is_not_told_of_one_at_rest(name: str) -> None:
    [metric] = [metric for metric in METRICS if metric.name == name]
    assert list(metric.samples(seen(unknown_report()))) == []


# Diagnostics, and the log

COUNTED: Final = {
    # What is left out where nobody knows, or what is said instead; then what is bad.
    'source': (ORDERS, ORDERS),
    'sink': ('/orders', '/orders'),
    'type': ('std_msgs/msg/String', 'std_msgs/msg/String'),
    'format': ('text', 'text'),
    'state': ('starting', 'failed'),
    'worker': ('1', '1'),
    'rate (1/s)': (NONE, '0.0'),
    'taken': (NONE, '72'),
    'confirmed': (NONE, '10'),
    'published': (NONE, '12'),
    'dead lettered': (NONE, '9'),
    'dropped': (NONE, '8'),
    'skipped': (NONE, '1'),
    'returned': (NONE, '2'),
    'lost': (NONE, '3'),
    'given up': (NONE, '4'),
    'in flight': (NONE, '7'),
    'spooled': (NONE, '16'),
    'spool (bytes)': (NONE, '4900000'),
    'lag (records)': (NONE, '500'),
    'delay p50 (s)': (NONE, '300'),
    'delay p99 (s)': (NONE, '300'),
    'matched': (NONE, '0'),
    'mismatched': (NONE, '2'),
    'queued': (NONE, '500 of 500'),
    'memory at most (bytes)': (NONE, '111000000'),
    'lost upstream': (NONE, '5'),
    'repeated': (NONE, '6'),
    'unproved': (NONE, '2'),
    'errors': (NONE, 'DecodeError: 9'),
    'last error': (NONE, 'no JSON'),
    'age (s)': (NONE, '40'),
}


def diagnosed(*reports: Report) -> dict[str, Status]:
    routes = Told().watch.routes
    bridge, recent = BridgeIdentity('node', '/etc/bridge.yaml', '1', routes), RecentCounters()
    for second, it in enumerate(reports):
        recent.add(it, 1000.0 + second)
    return {it.name: it for it in statuses(bridge, reports[-1], 0.1, recent)}


def test_a_value_of_the_diagnostics_is_left_out_where_it_is_not_known_and_shown_where_bad() -> (
    None
):
    unknown = dict(diagnosed(unknown_report())['node: orders'].values)
    bad = dict(diagnosed(bad_report(), bad_report(5))['node: orders'].values)
    assert set(unknown) | set(bad) <= set(COUNTED)
    for name, (if_unknown, if_bad) in COUNTED.items():
        assert unknown.get(name) == if_unknown, name
        assert bad.get(name) == if_bad, name


FIGURES: Final = {
    'state': ('starting', 'failed'), 'confirmed': (0, 10), 'published': (0, 12),
    'rate': (0.0, 0.0), 'in_flight': (0, 7), 'lag': (NONE, 500), 'dead_lettered': (0, 9),
}  # fmt: skip


def test_a_figure_of_the_log_shows_what_is_not_known_and_what_is_bad() -> None:
    """A bridge logs of its own routes, which have counted from 0 on: that is known."""
    unknown = figures(SILENT.snapshot, 0.0)
    bad = figures(badly(ORDERS, lag=500).snapshot, 0.0)
    assert unknown == {name: row[0] for name, row in FIGURES.items()}
    assert bad == {name: row[1] for name, row in FIGURES.items()}
