"""What Prometheus is told: names, types, units, and numbers that balance."""

import re

import pytest
from prometheus_client.exposition import generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as generate_openmetrics
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as prometheus
from prometheus_client.registry import CollectorRegistry
from support.monitoring.monitors import distribution, report, snapshot

from ros2_kafka_bridge.monitoring.prometheus import METRICS, PREFIX, BridgeCollector
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Reload
from ros2_kafka_bridge.route.counters import Measures, Outcome, State

from .conftest import Told

UNITS = (
    'seconds', 'bytes', 'messages', 'records', 'endpoints', 'info', 'success', 'state', 'up',
    'messages_in_flight', 'messages_spooled',
)  # fmt: skip


def registry(told: Told) -> CollectorRegistry:
    made = CollectorRegistry()
    made.register(BridgeCollector(told.watch))
    return made


def samples(told: Told) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    """All samples, by name and labels but that of the bridge."""
    found = {}
    for family in prometheus(generate_latest(registry(told)).decode()):
        for sample in family.samples:
            assert sample.labels.pop('bridge') == 'test', sample
            name = sample.name.removeprefix(PREFIX)
            found[name, frozenset(sample.labels.items())] = sample.value
    return found


def of(told: Told, name: str, **labels: str) -> float:
    return samples(told)[name, frozenset(labels.items())]


def test_both_formats_are_read_by_their_parsers(told: Told) -> None:
    text = generate_latest(registry(told)).decode()
    plain = {family.name: family for family in prometheus(text)}
    told_so = generate_openmetrics(registry(told)).decode()  # type: ignore[no-untyped-call]
    opened = {it.name: it for it in openmetrics(told_so)}  # type: ignore[no-untyped-call]
    for metric in METRICS:
        name = f'{PREFIX}{metric.name}'
        assert opened[name].type == metric.kind
        assert plain[name].type == metric.kind
        assert plain[name].documentation == metric.help


def test_names_follow_the_conventions_of_prometheus() -> None:
    names = [metric.full_name for metric in METRICS]
    assert len(names) == len(set(names))
    for metric in METRICS:
        assert re.fullmatch(r'[a-z][a-z0-9]*(_[a-z0-9]+)+', metric.full_name)
        assert metric.full_name.startswith(PREFIX)
        assert metric.full_name.endswith('_total') == (metric.kind == 'counter')
        assert metric.help.endswith('.'), metric
        assert not {'le', 'job', 'instance', 'bridge'} & set(metric.labels)
        if metric.kind == 'histogram':
            assert metric.name.endswith('_seconds')
        if metric.kind == 'gauge':
            assert metric.name.endswith(UNITS), metric.name
    [ended] = [it for it in METRICS if it.full_name == 'ros2_kafka_bridge_messages_ended_total']
    assert (ended.kind, ended.labels) == ('counter', ('route', 'outcome'))


def test_what_was_taken_is_what_has_ended_and_what_is_held(told: Told) -> None:
    for route in ('orders', 'returned'):
        ended = sum(
            of(told, 'messages_ended_total', route=route, outcome=outcome) for outcome in Outcome
        )
        held = of(told, 'messages_in_flight', route=route)
        held += of(told, 'messages_spooled', route=route)
        assert of(told, 'messages_taken_total', route=route) == ended + held


def test_what_was_published_is_not_told_as_confirmed(told: Told) -> None:
    measures = Measures(bytes_confirmed=40, bytes_published=700)
    told.tell(report(snapshot('orders', taken=9, confirmed=2, published=7, measures=measures)))
    assert of(told, 'messages_ended_total', route='orders', outcome='confirmed') == 2
    assert of(told, 'messages_ended_total', route='orders', outcome='published') == 7
    assert of(told, 'bytes_confirmed_total', route='orders') == 40
    assert of(told, 'bytes_published_total', route='orders') == 700


def test_durations_are_cumulated_in_their_buckets(told: Told) -> None:
    measures = Measures(in_bridge=distribution(100, 0.01))
    told.tell(report(snapshot('orders', measures=measures)))
    assert of(told, 'bridge_seconds_bucket', route='orders', le='0.005') == 0
    assert of(told, 'bridge_seconds_bucket', route='orders', le='0.01') == 98
    assert of(told, 'bridge_seconds_bucket', route='orders', le='+Inf') == 100
    assert of(told, 'bridge_seconds_count', route='orders') == 100
    assert of(told, 'bridge_seconds_sum', route='orders') == pytest.approx(1.0)


def test_each_route_tells_what_its_direction_has(told: Told) -> None:
    found = samples(told).keys()
    to_ros, to_kafka = frozenset({('route', 'orders')}), frozenset({('route', 'returned')})
    assert ('consumer_lag_records', to_ros) in found
    assert ('consumer_lag_records', to_kafka) not in found
    assert ('rebalances_total', to_ros) in found
    assert ('rebalances_total', to_kafka) not in found
    assert ('publish_seconds_count', to_ros) in found
    assert ('publish_seconds_count', to_kafka) not in found
    assert ('produce_seconds_count', to_kafka) in found
    assert ('produce_seconds_count', to_ros) not in found
    assert of(told, 'spool_limit_bytes', route='returned') == 5_000_000
    assert ('spool_limit_bytes', to_ros) not in found
    about = {
        'route': 'returned', 'direction': 'ros_to_kafka', 'source': '/orders', 'sink': 'returned',
        'type': 'std_msgs/msg/String', 'format': 'text',
    }  # fmt: skip
    assert of(told, 'route_info', **about) == 1


def test_a_route_is_in_one_state(told: Told) -> None:
    states = {s: of(told, 'route_state', route='returned', state=s) for s in State}
    assert [state for state, value in states.items() if value] == [State.WAITING]
    assert len(states) == 6


def test_a_bridge_is_in_one_state_of_its_lifecycle(told: Told) -> None:
    told.tell(report(lifecycle=Lifecycle.INACTIVE))
    states = {s: of(told, 'lifecycle_state', state=s) for s in Lifecycle}
    assert [state for state, value in states.items() if value] == [Lifecycle.INACTIVE]
    assert len(states) == 4


def test_counters_of_errors_begin_at_zero(told: Told) -> None:
    assert of(told, 'errors_total', route='orders', error='DecodeError') == 2
    assert of(told, 'errors_total', route='orders', error='TransportError') == 0


def test_a_reload_that_was_refused_is_told(told: Told) -> None:
    assert of(told, 'config_reload_success') == 1
    told.tell(report(reload=Reload(1000.0, done=False, text='routes[0]: wrong')))
    assert of(told, 'config_reload_success') == 0
    assert of(told, 'config_reload_timestamp_seconds') == 1000


def test_names_with_odd_characters_break_no_line(told: Told) -> None:
    text = 'a "quoted"\\ name\nand a line'
    told.tell(report(snapshot('orders', measures=Measures(errors={text: 1}))))
    assert of(told, 'errors_total', route='orders', error=text) == 1


def test_before_the_first_report_there_is_little_to_tell() -> None:
    found = samples(Told())
    assert {name for name, _ in found} == {'build_info', 'report_age_seconds'}
