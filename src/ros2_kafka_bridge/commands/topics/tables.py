"""The tables of `topics`, for people."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from rich.console import Console

from ros2_kafka_bridge.commands.screen import show_line, show_notes, show_table
from ros2_kafka_bridge.commands.topics.view import (
    Match,
    Pair,
    PeerRow,
    RosRow,
    RouteRow,
    TopicsView,
)
from ros2_kafka_bridge.message_types.source import CURE

_MATCH_COLUMNS = ('route', 'node', 'would match')
_UNKNOWN: Final = 'not known here'


def show(console: Console, view: TopicsView) -> None:
    """Print what was seen of Kafka, of ROS, and of both together."""
    if view.kafka_problem:
        show_line(console, f'Kafka ({view.brokers}): {view.kafka_problem}', 'bold red')
    if view.kafka:
        title = f'Kafka: {view.brokers}'
        _show_kafka(console, title, view)
    elif not view.kafka_problem:
        console.print(f'Kafka: {view.brokers}: no topics that this user may see')
    title = f'ROS: {view.ros_domain}, {view.ros_middleware}'
    if view.ros:
        _show_ros(console, title, view)
    elif view.ros_problem:
        show_line(console, f'{title}: {view.ros_problem}', 'bold red')
    else:
        show_line(console, f'{title}: no topics: {view.ros_hint}')
    if view.ros and view.ros_hint:
        show_notes(console, [f'ROS: {view.ros_hint}'])
    _show_matches(console, view.ros)
    _show_pairs(console, view.pairs)


def _show_kafka(console: Console, title: str, view: TopicsView) -> None:
    rated = view.seconds is not None
    columns = ['topic', '#partitions', '#records', *['#records/s'] * rated, 'route']
    rows: list[list[list[str]]] = []
    for row in view.kafka:
        about = [*_routes(row.routes), *([row.kind] if row.kind else []), *_if(row.problem)]
        held = [_number(row.partitions), _number(row.records)] if not row.problem else ['-', '-']
        numbers = [[number] for number in held]
        rate = [['-' if row.problem else _rate(row.rate)]] if rated else []
        rows.append([[row.name], *numbers, *rate, about])
    show_table(console, title, columns, rows)


def _show_ros(console: Console, title: str, view: TopicsView) -> None:
    rated = view.seconds is not None
    kinds = ['topic'] if console.is_terminal else ['topic', 'type']
    columns = [*kinds, 'publishers', 'subscribers', *['#msg/s'] * rated, 'route']
    rows: list[list[list[str]]] = []
    for row in view.ros:
        types = [*_types(row), *_if(row.problem)] or ['nobody is there']
        first = [[row.name, *types]] if console.is_terminal else [[row.name], [*types]]
        unknown = ['?'] * bool(row.problem)
        ends = [_ends(peers) or unknown for peers in (row.publishers, row.subscribers)]
        rate = [[_rate(row.rate)]] if rated else []
        rows.append([*first, *ends, *rate, [*_routes(row.routes), *_if(row.kind)]])
    show_table(console, title, columns, rows)
    if any(row.type_problems for row in view.ros):
        show_line(
            console,
            f'{_UNKNOWN}: nobody there describes the type (--json says why): {CURE}',
        )
    if rated and any(row.rate is None for row in view.ros):
        show_line(
            console,
            '?: not counted: two types, a type that is not known here, somebody there who '
            'cannot be read, or a bridge publishes it (counting would be a subscriber to it)',
        )


def _types(row: RosRow) -> Iterator[str]:
    """The types of a topic, each with where it is described if it is not installed."""
    for name in row.types:
        yield name
        if name in row.type_origins:
            yield row.type_origins[name].removeprefix('is ')
        if name in row.type_problems:
            yield _UNKNOWN


def _ends(peers: Sequence[PeerRow]) -> list[str]:
    """Publishers or subscribers in short: `2 reliable, volatile`."""
    counted = Counter((peer.reliability, peer.durability) for peer in peers)
    return [f'{number} {", ".join(qos)}' for qos, number in sorted(counted.items())]


def _show_matches(console: Console, found: Sequence[RosRow]) -> None:
    rows: list[list[list[str]]] = []
    for row in found:
        for route in row.routes:
            nodes = [match for match in row.matches if match.route == route.route]
            rows += [[[route.route], [m.node], [_would_match(m)]] for m in nodes]
            if row.problem:
                rows.append([[route.route], [], [row.problem]])
            elif not nodes:
                does = 'subscribes to' if route.does == 'publishes' else 'publishes'
                rows.append([[route.route], [], [f'nobody {does} {row.name}']])
    if rows:
        show_table(console, 'Which nodes the routes would match', _MATCH_COLUMNS, rows)


def _would_match(match: Match) -> str:
    if match.unknown:
        return f'as far as is known: {match.unknown}'
    return match.problem or 'yes'


def _show_pairs(console: Console, pairs: Sequence[Pair]) -> None:
    if not pairs:
        return
    columns = ['Kafka', 'ROS', 'way', 'would match']
    rows: list[list[list[str]]] = [
        [[p.kafka], [p.ros], [p.way], [p.problem or 'yes']] for p in pairs
    ]
    show_table(console, 'Possible pairs, not joined by a route', columns, rows)


def _routes(rows: Sequence[RouteRow]) -> list[str]:
    return [f'{row.route} {row.does}' for row in rows]


def _if(text: str) -> list[str]:
    return [text] if text else []


def _number(number: int | None) -> str:
    return '?' if number is None else str(number)


def _rate(rate: float | None) -> str:
    return '?' if rate is None else f'{rate:.1f}'
