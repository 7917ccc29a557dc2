"""What a PromQL expression asks for, and whether the bridge tells it."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import promql_parser
from promql_parser import Matcher, MatchOp, VectorSelector

from ros2_kafka_bridge import errors
from ros2_kafka_bridge.monitoring.prometheus import METRICS
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.route.counters import Outcome, State

OF_SCRAPES = frozenset({'job', 'instance'})
"""Labels that Prometheus itself puts on every series."""

_VALUES: dict[str, set[str]] = {
    'outcome': {outcome.value for outcome in Outcome},
    'quantile': {'0.5', '0.99'},
    'direction': {'kafka_to_ros', 'ros_to_kafka'},
    'error': {name for name in dir(errors) if name.endswith('Error')},
    'job': {'ros2-kafka-bridge'},
}
_STATES: dict[str, set[str]] = {
    'ros2_kafka_bridge_route_state': {state.value for state in State},
    'ros2_kafka_bridge_lifecycle_state': {state.value for state in Lifecycle},
}


class Asked(NamedTuple):
    """A series that an expression asks for."""

    name: str
    matchers: tuple[Matcher, ...]


def told() -> dict[str, frozenset[str]]:
    """Every series that can be asked for, with its labels."""
    series = {'up': OF_SCRAPES}
    for metric in METRICS:
        labels = OF_SCRAPES | {'bridge', *metric.labels}
        if metric.kind == 'histogram':
            series[f'{metric.full_name}_bucket'] = labels | {'le'}
            series[f'{metric.full_name}_sum'] = labels
            series[f'{metric.full_name}_count'] = labels
        else:
            series[metric.full_name] = labels
    return series


def asked(expression: str) -> list[Asked]:
    """The series that an expression asks for.

    Raises:
        ValueError: It is no PromQL.
    """
    plain = re.sub(r'\$__(rate_interval|range|interval)\b', '5m', expression)
    found: list[Asked] = []

    def visit(node: object) -> bool:
        if isinstance(node, VectorSelector):
            found.append(Asked(node.name or '', tuple(node.matchers.matchers)))
        return True

    promql_parser.walk(promql_parser.parse(plain), visit)
    return found


def mistakes(expression: str, more: dict[str, frozenset[str]] | None = None) -> list[str]:
    """Everything in an expression that no scrape of a bridge has.

    Args:
        expression: PromQL, as it is.
        more: Further series, such as those of recording rules.
    """
    series = told() | (more or {})
    return [mistake for one in asked(expression) for mistake in _mistakes_of(one, series)] + [
        f'no metric has the label {label}'
        for label in _joined_by(expression)
        if not any(label in labels for labels in series.values())
    ]


def _mistakes_of(one: Asked, series: dict[str, frozenset[str]]) -> Iterator[str]:
    if one.name not in series:
        yield f'no metric is called {one.name}'
        return
    for matcher in one.matchers:
        if matcher.name not in series[one.name]:
            yield f'{one.name} has no label {matcher.name}'
        known = _STATES[one.name] if matcher.name == 'state' else _VALUES.get(matcher.name)
        if known is not None:
            yield from (
                f'{matcher.name} is never {value}' for value in _values_of(matcher) - known
            )


def _values_of(matcher: Matcher) -> set[str]:
    if '$' in matcher.value:  # a variable of a dashboard
        return set()
    if matcher.op in (MatchOp.Re, MatchOp.NotRe):
        return set(matcher.value.split('|'))
    return {matcher.value}


def _joined_by(expression: str) -> Iterator[str]:
    for inside in re.findall(r'\b(?:by|without|on|ignoring|group_left)\s*\(([^)]*)\)', expression):
        yield from (label.strip() for label in inside.split(',') if label.strip())
