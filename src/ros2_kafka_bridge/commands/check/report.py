"""What a configuration would meet: the broker, the graph, route by route. Nothing is changed."""

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from ros2_kafka_bridge.commands.check import clock as check_clock
from ros2_kafka_bridge.commands.check import formats as check_format
from ros2_kafka_bridge.commands.check import kafka as check_kafka
from ros2_kafka_bridge.commands.check import memory as check_memory
from ros2_kafka_bridge.commands.check import ros as check_ros
from ros2_kafka_bridge.commands.check import types as check_types
from ros2_kafka_bridge.commands.screen import (
    Finding,
    screen,
    show_findings,
    show_line,
    show_notes,
    wait_for_discovery,
)
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import (
    Config,
    KafkaToRosRoute,
    RosToKafkaRoute,
    masked,
    warnings,
)
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.message_sizes import described_sizes
from ros2_kafka_bridge.ros.node import RosNode, is_fastdds, open_node
from ros2_kafka_bridge.ros.probe import SAMPLES, probe, probe_topic
from ros2_kafka_bridge.ros_to_kafka import BATCH as TO_KAFKA_BATCH
from ros2_kafka_bridge.route.memory import Kept
from ros2_kafka_bridge.route.pieces import PIECE


class Surroundings(NamedTuple):
    """What the routes of a configuration would meet.

    Args:
        unconfirmed: Why no route to ROS would know what has arrived.
        kept: What DDS would keep for each route.
    """

    config: Config
    node: RosNode
    kafka: check_kafka.CheckedCluster
    unconfirmed: str
    kept: Mapping[str, Kept]


def report(config: Config, file: Path, *, connect: bool) -> int:
    """Print what the configuration says and, with `connect`, what it would meet.

    Returns:
        0 when all is well, 1 when a route could not run as it is.
    """
    console = screen()
    routes = count(len(config.routes), 'route')
    console.print(f'{file}: {routes} of bridge {config.name}, all well written')
    shown = masked(config)
    for section, word in (('kafka', 'kafka'), ('schema_registry', 'schema registry')):
        for name, value in shown.get(section, {}).items():
            console.print(f'  {word} {name}: {value}')
    show_notes(console, [*warnings(config), *tracing_notes(config, os.environ)])
    failed = _show_clock(console, config)
    if connect:
        return _report_connected(console, config) or int(failed)
    kept = check_memory.kept_by_routes(config, described_sizes(config))
    for route in config.routes:
        named = check_types.named_type(route, config)
        memory = check_memory.memory_words(route, config, kept[route.name])
        console.print(f'  {_way(route)}{memory}')
        found = [*named.found, *check_format.format_findings(route, config, named.layout)]
        failed = _show_short(console, found) or failed
    return 1 if failed else 0


def _show_short(console: Console, found: Sequence[Finding]) -> bool:
    """Show what is not as usual; tells whether anything cannot stay as it is."""
    for finding in found:
        if finding.level == 'note':
            show_line(console, f'    note {finding.text}', 'yellow')
        elif finding.level == 'bad':
            show_line(console, f'    BAD {finding.text}', 'bold red')
    return any(finding.level == 'bad' for finding in found)


def _show_clock(console: Console, config: Config) -> bool:
    """Say what a wrong clock does; tells whether routes would wait for it."""
    found = list(check_clock.clock_findings(config))
    show_notes(console, [it.text for it in found if it.level == 'note'])
    bad = [it.text for it in found if it.level == 'bad']
    for text in bad:
        show_line(console, f'  BAD  {text}', 'bold red')
    return bool(bad)


def tracing_notes(config: Config, environ: Mapping[str, str]) -> Iterator[str]:
    """What tracing promises to others and does not do."""
    tracing = config.tracing
    if config.to_kafka and tracing is not None and tracing.sample and not tracing.exports(environ):
        yield (
            'tracing: no span is made (no endpoint, or OTEL_SDK_DISABLED), and yet a share of '
            f'{tracing.sample:g} of the records names one as the parent, which nobody finds: set '
            'endpoint (or OTEL_EXPORTER_OTLP_ENDPOINT where the bridge runs), or sample: 0'
        )


def _report_connected(console: Console, config: Config) -> int:
    keep_clients_quiet()
    kafka, findings = check_kafka.ask(config)
    _show(console, 'Kafka', findings)
    topic = probe_topic()
    histories = Histories({topic: SAMPLES}, {topic: SAMPLES}, config.ros.lease_s)
    with open_node(f'{config.name}_check', config.ros.domain_id, histories) as node:
        abilities = probe(node, topic)
        unconfirmed = check_ros.confirmation_problem(node, abilities, config)
        wait_for_discovery()
        sees_none = check_ros.sees_none(node)
        _show(console, 'ROS', check_ros.graph_findings(abilities, config, sees_none=sees_none))
        types = check_types.find_types(config, node)
        kept = check_memory.kept_by_routes(config, check_types.sizes_of(config, types))
        met = Surroundings(config, node, kafka, unconfirmed, kept)
        found = {route.name: _findings(route, types[route.name], met) for route in config.routes}
    for route in config.routes:
        _show(console, _way(route), found[route.name])
    if kafka.problem:
        show_line(console, f'No route can run: {kafka.problem}', 'bold red')
        return 1
    show_line(console, summary(found), 'bold')
    return 1 if any(f.level == 'bad' for f in chain(findings, *found.values())) else 0


def _show(console: Console, title: str, findings: Sequence[Finding]) -> None:
    """Show what cannot stay as it is first: there are notes on a route that runs well, too."""
    show_findings(console, title, sorted(findings, key=lambda finding: finding.level != 'bad'))


def summary(found: dict[str, list[Finding]]) -> str:
    """Say in a line how many of the routes would run, would wait and cannot run, and why."""
    failing = {
        name: [f.text for f in findings if f.level == 'bad'] for name, findings in found.items()
    }
    waiting = {
        name: [f.waits for f in findings if f.waits]
        for name, findings in found.items()
        if not failing[name]
    }
    fails = [f'{name}: {texts[0]}' for name, texts in failing.items() if texts]
    waits = [f'{name}: {", ".join(texts)}' for name, texts in waiting.items() if texts]
    runs = len(found) - len(fails) - len(waits)
    parts = [f'{count(runs, "route")} would run']
    parts += [f'{len(waits)} would wait ({"; ".join(waits)})'] * bool(waits)
    parts += [f'{len(fails)} cannot run as it is ({"; ".join(fails)})'] * bool(fails)
    return '; '.join(parts)


def _way(route: AnyRoute) -> str:
    kind = route.type_name or 'the type that is published'
    ends = {
        route.kafka_topic: f'Kafka {route.kafka_topic}',
        route.ros_topic: f'ROS {route.ros_topic} ({kind})',
    }
    return f'{route.name}: {" -> ".join(ends[topic] for topic in route.topics)}, {route.format}'


def _findings(
    route: AnyRoute, message_type: check_types.FoundType, met: Surroundings
) -> list[Finding]:
    try:
        return _route_findings(route, message_type, met)
    except BridgeError as error:  # of the ROS graph, of what others tell there
        return [Finding('bad', 'graph', str(error))]


def _route_findings(
    route: AnyRoute, message_type: check_types.FoundType, met: Surroundings
) -> list[Finding]:
    """What is found of a route, in the order in which a message meets it."""
    if isinstance(route, KafkaToRosRoute):
        found = _findings_to_ros(route, message_type, met)
    else:
        found = _findings_to_kafka(route, message_type, met)
    if is_fastdds():  # no other middleware counts by the profile
        kept, layout = met.kept[route.name], message_type.layout
        found = chain(found, [check_memory.memory_finding(route, met.config, kept, layout)])
    asks = not met.kafka.problem
    return [*found, *(check_kafka.dead_letter_findings(route, met.kafka) if asks else ())]


def _findings_to_ros(
    route: KafkaToRosRoute, message_type: check_types.FoundType, met: Surroundings
) -> Iterator[Finding]:
    config, node, kafka, unconfirmed, _ = met
    if not kafka.problem:
        yield from check_kafka.source_findings(route, config, kafka)
    yield from message_type.found
    yield from check_format.format_findings(route, config, message_type.layout)
    yield from check_format.registry_findings(route, config, message_type.layout)
    yield from check_ros.reader_findings(route, config, node, message_type.type_hash)
    yield check_ros.confirmation_finding(route, config, unconfirmed)
    yield _pace_finding(route)
    yield from check_clock.age_findings(route)
    yield window_to_ros(route)


def _findings_to_kafka(
    route: RosToKafkaRoute, message_type: check_types.FoundType, met: Surroundings
) -> Iterator[Finding]:
    config, node, kafka, *_ = met
    name, layout, type_hash, found = message_type
    publishers = check_ros.publishers(route, config, node)
    yield from check_ros.publisher_findings(route, publishers, name, type_hash)
    yield from found
    yield from check_ros.key_findings(route, layout)
    yield from check_ros.size_findings(route, layout, node)
    yield from check_ros.channel_findings(layout)
    yield from check_format.format_findings(route, config, layout)
    yield from check_format.registry_findings(route, config, layout)
    if not kafka.problem:
        yield from check_kafka.sink_findings(route, kafka)
        yield from check_kafka.lock_findings(route, config, kafka)
    yield window_to_kafka(route)


def _pace_finding(route: KafkaToRosRoute) -> Finding:
    if route.max_rate is not None:
        return Finding('ok', 'pace', f'at most {route.max_rate:g} messages a second (max_rate)')
    return Finding(
        'note',
        'pace',
        'a subscriber that is KEEP_LAST can overwrite its own queue, and its depth cannot '
        'be seen from outside: if one is, set max_rate',
    )


def window_to_ros(route: KafkaToRosRoute) -> Finding:
    """How much may be in flight, as the counters show it, and what happens then."""
    waits = (
        f'at most {route.max_in_flight_bytes:,} bytes in flight and a batch of {PIECE} '
        f'(max_in_flight_bytes), of it at most {route.max_in_flight:,} messages not acknowledged '
        '(max_in_flight), then the route waits'
    )
    return _in_memory(route, waits, 'not acknowledged', PIECE)


def window_to_kafka(route: RosToKafkaRoute) -> Finding:
    """The same of a route to Kafka, with the disk behind it."""
    if route.spool is not None:
        return Finding('note' if route.drops else 'ok', 'window', _with_spool(route))
    waits = (
        f'at most {route.max_in_flight:,} messages in flight (max_in_flight), or '
        f'{route.max_in_flight_bytes:,} bytes and a batch of {TO_KAFKA_BATCH} '
        '(max_in_flight_bytes), then the route waits'
    )
    return _in_memory(route, waits, 'with the producer', TO_KAFKA_BATCH)


def _in_memory(route: AnyRoute, waits: str, where: str, batch: int) -> Finding:
    if not route.drops:
        return Finding('ok', 'window', waits)
    text = (
        f'at most {route.max_in_flight:,} messages (max_in_flight), or '
        f'{route.max_in_flight_bytes:,} bytes (max_in_flight_bytes), {where}, and as many more '
        f'and a batch of {batch} waiting, then the oldest that wait are dropped (when_full)'
    )
    return Finding('note', 'window', text)


def _with_spool(route: RosToKafkaRoute) -> str:
    dropped = ', and the oldest there are dropped where it is full (when_full)'
    then = dropped if route.drops else ''
    return (
        f'at most {route.max_in_flight:,} messages in flight (max_in_flight), or '
        f'{route.max_in_flight_bytes:,} bytes (max_in_flight_bytes), and a batch of '
        f'{TO_KAFKA_BATCH}, then the rest waits on disk (spool){then}'
    )
