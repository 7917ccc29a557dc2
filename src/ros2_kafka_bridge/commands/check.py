"""What a configuration would meet: the broker, the graph, route by route. Nothing is changed."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from ros2_kafka_bridge.commands.matching import (
    AnyRoute,
    is_own,
    others,
    own_publishers,
    own_readers,
    publisher_problem,
    reader_problem,
    type_of,
)
from ros2_kafka_bridge.commands.screen import (
    Finding,
    keep_clients_quiet,
    screen,
    show_findings,
    show_line,
    show_notes,
    wait_for_discovery,
)
from ros2_kafka_bridge.config.settings import (
    Config,
    KafkaToRosRoute,
    RosToKafkaRoute,
    masked,
    warnings,
)
from ros2_kafka_bridge.errors import BridgeError, ConfigError, TransportError
from ros2_kafka_bridge.kafka.broker import Broker, TopicView
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, records
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.ros.node import Peer, RosNode, domain_in_words, middleware, open_node
from ros2_kafka_bridge.ros.probe import SAMPLES, limits, probe, probe_topic
from ros2_kafka_bridge.ros.profile import Endpoints


class _Kafka(NamedTuple):
    """The cluster as `check` asks it.

    Args:
        problem: Why it cannot be asked; empty if it answers.
        creates_topics: Whether it creates what is written to; None where it does not tell.
    """

    broker: Broker
    overview: Overview
    problem: str
    creates_topics: bool | None


def report(config: Config, file: Path, *, connect: bool) -> int:
    """Print what the configuration says and, with `connect`, what it would meet.

    Returns:
        0 when all is well, 1 when a route could not run as it is.
    """
    console = screen()
    count = _count(len(config.routes), 'route')
    console.print(f'{file}: {count} of bridge {config.name}, all well written')
    for name, value in masked(config)['kafka'].items():
        console.print(f'  kafka {name}: {value}')
    show_notes(console, warnings(config))
    if connect:
        return _report_connected(console, config)
    for route in config.routes:
        console.print(f'  {_way(route)}')
    return 0


def _report_connected(console: Console, config: Config) -> int:
    keep_clients_quiet()
    kafka, findings = _ask_kafka(config)
    show_findings(console, 'Kafka', findings)
    topic = probe_topic()
    endpoints = Endpoints({topic: SAMPLES}, {topic: SAMPLES}, config.ros.lease_s)
    with open_node(f'{config.name}_check', config.ros.domain_id, endpoints) as node:
        show_findings(console, 'ROS', _ros_findings(node, topic, config))
        wait_for_discovery()
        found = {
            route.name: _route_findings(route, config, node, kafka) for route in config.routes
        }
    for route in config.routes:
        show_findings(console, _way(route), found[route.name])
    if kafka.problem:
        show_line(console, f'No route can run: {kafka.problem}', 'bold red')
        return 1
    show_line(console, summary(found), 'bold')
    return 1 if any(f.level == 'bad' for f in chain(*found.values())) else 0


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
    parts = [f'{_count(runs, "route")} would run']
    parts += [f'{len(waits)} would wait ({"; ".join(waits)})'] * bool(waits)
    parts += [f'{len(fails)} cannot run as it is ({"; ".join(fails)})'] * bool(fails)
    return '; '.join(parts)


def _count(number: int, thing: str) -> str:
    return f'{number} {thing}' if number == 1 else f'{number} {thing}s'


def _way(route: AnyRoute) -> str:
    if isinstance(route, KafkaToRosRoute):
        ends = f'Kafka {route.source.kafka} -> ROS {route.sink.ros} ({route.sink.type})'
    else:
        kind = route.source.type or 'the type that is published'
        ends = f'ROS {route.source.ros} ({kind}) -> Kafka {route.sink.kafka}'
    return f'{route.name}: {ends}, {route.format}'


def _route_findings(
    route: AnyRoute, config: Config, node: RosNode, kafka: _Kafka
) -> list[Finding]:
    """What is found of a route, in the order in which a message meets it."""
    asks = not kafka.problem
    if isinstance(route, KafkaToRosRoute):
        found = [
            *(_source_findings(route, config, kafka) if asks else ()),
            *_reader_findings(route, config, node),
            _pace_finding(route),
        ]
    else:
        publishers = _publishers(route, config, node)
        message_type = type_of(route, publishers)
        found = [
            *_publisher_findings(route, publishers, message_type),
            *_key_findings(route, message_type),
            *(_sink_findings(route, kafka) if asks else ()),
        ]
    return [*found, _window_finding(route), *(_dead_letter_findings(route, kafka) if asks else ())]


# Kafka


def _ask_kafka(config: Config) -> tuple[_Kafka, list[Finding]]:
    properties = common_properties(config.kafka, client_id=config.name)
    broker, overview = Broker(properties), Overview(properties)
    try:
        greeting = broker.greeting()
    except BridgeError as error:
        where = config.kafka.get('bootstrap.servers')
        away = isinstance(error, TransportError)
        cure = f'is bootstrap.servers ({where}) right, does the broker run?' if away else ''
        kafka = _Kafka(broker, overview, str(error), None)
        return kafka, [Finding('bad', 'brokers', str(error), cure)]
    kafka = _Kafka(broker, overview, '', overview.creates_topics())
    return kafka, [Finding('ok', 'brokers', greeting)]


def _source_findings(route: KafkaToRosRoute, config: Config, kafka: _Kafka) -> Iterator[Finding]:
    topic = route.source.kafka
    view = kafka.broker.topic(topic)
    yield _topic_finding('source', topic, view, 'READ')
    if not view.exists:
        return
    group = route.group(config.name)
    try:
        committed = kafka.broker.committed(group, topic, view.partitions)
    except BridgeError as error:
        yield Finding('bad', 'group', f'group {group}: {error}', 'add the ACL READ on the group')
        return
    held = KafkaTopic(topic, view.partitions, '')
    begins, ends = kafka.overview.begins([held]), kafka.overview.ends([held])
    if committed:
        places = {(topic, partition): offset for partition, offset in committed.items()}
        behind = records(held, {**begins, **places}, ends)
        told = '' if behind is None else f', {_count(behind, "record")} to deliver'
        yield Finding('ok', 'group', f'group {group} goes on at its committed offsets{told}')
    elif route.source.start == 'earliest':
        size = records(held, begins, ends)
        told = '' if size is None else f' ({_count(size, "record")})'
        text = f'group {group} is new: start is earliest, all that the topic holds{told}'
        yield Finding('ok', 'group', text)
    else:
        yield Finding('ok', 'group', f'group {group} is new: start is latest, only new ones')


def _sink_findings(route: RosToKafkaRoute, kafka: _Kafka) -> Iterator[Finding]:
    topic = route.sink.kafka
    view = kafka.broker.topic(topic)
    if not view.exists:
        yield _missing_sink(topic, kafka.creates_topics)
        return
    yield _topic_finding('sink', topic, view, 'WRITE')
    if view.rights is not None and 'READ' not in view.rights:
        text = (
            f'no READ on topic {topic}: needed for TRANSIENT_LOCAL publishers, to skip '
            'what is there from before a restart'
        )
        yield Finding('note', 'sink', text)


def _missing_sink(topic: str, creates_topics: bool | None) -> Finding:  # noqa: FBT001 (unknown, too)
    text = f'topic {topic} is not there'
    if creates_topics is None:
        text += ': the route fails unless the broker creates topics by itself'
        return Finding('note', 'sink', text, 'create it')
    if creates_topics:
        text += ': the broker creates it with its default settings'
        return Finding('note', 'sink', text, 'create it for partitions and copies of your choice')
    return Finding('bad', 'sink', f'{text}, and the broker creates none by itself', 'create it')


def _topic_finding(thing: str, topic: str, view: TopicView, right: str) -> Finding:
    if not view.exists:
        return Finding('bad', thing, f'topic {topic} is not there ({view.problem})', 'create it')
    if view.rights is not None and right not in view.rights:
        return Finding('bad', thing, f'this user has no {right} on topic {topic}', 'add the ACL')
    return Finding('ok', thing, f'topic {topic} has {_count(view.partitions, "partition")}')


def _dead_letter_findings(route: AnyRoute, kafka: _Kafka) -> Iterator[Finding]:
    if route.on_error != 'dead_letter':
        text = f'on_error: {route.on_error}: bad records are not kept'
        yield Finding('note', 'dead letters', text)
        return
    topic = route.dead_letter_topic
    view = kafka.broker.topic(topic)
    if view.exists:
        yield _topic_finding('dead letters', topic, view, 'WRITE')
    else:
        text = (
            f'dead-letter topic {topic} is not there: it is created at the '
            'first dead letter, if this user may'
        )
        yield Finding('note', 'dead letters', text)


# ROS


def _ros_findings(node: RosNode, topic: str, config: Config) -> list[Finding]:
    import rclpy  # noqa: PLC0415 (open already, and heavy)

    domain = domain_in_words(config.ros.domain_id)
    place = f'rclpy of {Path(rclpy.__file__).parent}, {middleware()}, {domain}'
    found = [Finding('ok', 'graph', place)]
    return found + [Finding('note', 'middleware', text) for text in limits(probe(node, topic))]


def _reader_findings(route: KafkaToRosRoute, config: Config, node: RosNode) -> Iterator[Finding]:
    topic, fit = route.sink.ros, 0
    own = own_readers(config.routes, route)
    peers = node.subscribers(topic)
    for peer in [*(others(peers, config.name) if own else peers), *own]:
        if problem := reader_problem(route, peer):
            yield Finding('bad', 'readers', f'{peer.node} {problem.text}', problem.cure)
            continue
        fit += 1
        if peer.reliability == 'best_effort':
            text = f'{peer.node} reads best effort: guarantee 1 does not hold for it'
            yield Finding('note', 'readers', text)
    if fit >= route.min_subscribers:
        names = ', '.join(peer.node for peer in own)
        text = f'{_count(fit, "subscriber")} of {topic} match{"es" * (fit == 1)}'
        yield Finding('ok', 'readers', f'{text}{names and f", with {names} of this file"}')
        return
    text = (
        f'{fit} of {_count(route.min_subscribers, "subscriber")} of {topic}: '
        'the route waits for them (min_subscribers)'
    )
    yield Finding('note', 'readers', text, waits=f'for subscribers of {topic}')


def _pace_finding(route: KafkaToRosRoute) -> Finding:
    if route.max_rate is not None:
        return Finding('ok', 'pace', f'at most {route.max_rate:g} messages a second (max_rate)')
    return Finding(
        'note',
        'pace',
        'a subscriber that is KEEP_LAST can overwrite its own queue, and its depth cannot '
        'be seen from outside: if one is, set max_rate',
    )


def _publishers(route: RosToKafkaRoute, config: Config, node: RosNode) -> list[Peer]:
    own = own_publishers(config.routes, route)
    peers = node.publishers(route.source.ros)
    return [*(others(peers, config.name) if own else peers), *own]


def _publisher_findings(
    route: RosToKafkaRoute, peers: list[Peer], message_type: str | None
) -> Iterator[Finding]:
    topic = route.source.ros
    types = sorted({peer.message_type for peer in peers})
    if not peers:
        learns = ': the route waits for one to learn its type' if message_type is None else ''
        waits = '' if message_type else f'for a publisher of {topic}'
        yield Finding('note', 'publishers', f'nobody publishes {topic}{learns}', waits=waits)
    for peer in peers:
        if problem := publisher_problem(route, peer, message_type):
            yield Finding('bad', 'publishers', f'{peer.node} {problem.text}', problem.cure)
        else:
            yield _offer_finding(peer, topic)
    if message_type is not None:
        yield _type_finding(message_type)
    elif types:
        text = f'{topic} has types {" and ".join(types)}'
        yield Finding('bad', 'type', text, 'set from.type')


def _offer_finding(peer: Peer, topic: str) -> Finding:
    if is_own(peer):
        return Finding('ok', 'publishers', f'{peer.node} of this file publishes {topic}')
    offer = f'{peer.node} publishes {peer.reliability}, {peer.durability}'
    if peer.reliability == 'best_effort':
        text = f'{offer}: what the network loses is lost before the bridge'
        return Finding('note', 'publishers', text)
    if peer.durability == 'volatile':
        text = f'{offer}: what it sends while the bridge is dead is lost'
        return Finding('ok', 'publishers', text)
    text = f'{offer}: what it sends while the bridge is dead comes afterwards'
    return Finding('ok', 'publishers', text)


def _type_finding(message_type: str) -> Finding:
    from ros2_kafka_bridge.ros.types import unknown_type  # noqa: PLC0415 (reads files)

    if problem := unknown_type(message_type):
        return Finding('bad', 'type', problem, 'install its package beside the bridge')
    return Finding('ok', 'type', f'{message_type} is installed here')


def _key_findings(route: RosToKafkaRoute, message_type: str | None) -> Iterator[Finding]:
    from ros2_kafka_bridge.labels import make_key  # noqa: PLC0415 (with the types of ROS)
    from ros2_kafka_bridge.ros.types import load_type, unknown_type  # noqa: PLC0415

    if route.sink.key is None or message_type is None or unknown_type(message_type):
        return
    try:
        make_key(route.sink.key, route.source.ros, load_type(message_type).layout)
    except ConfigError as error:
        yield Finding('bad', 'key', str(error), 'mend to.key')
    else:
        yield Finding('ok', 'key', f'{route.sink.key}: {message_type} has it')


def _window_finding(route: AnyRoute) -> Finding:
    full = f'at most {route.max_in_flight} messages in flight, then'
    if route.when_full == 'drop_oldest':
        return Finding('note', 'window', f'{full} the oldest are dropped (when_full)')
    return Finding('ok', 'window', f'{full} the route waits (max_in_flight)')
