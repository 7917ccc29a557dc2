"""What a configuration would meet: the broker, the graph, route by route. Nothing is changed."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from rich.console import Console
from rich.text import Text

from ros2_kafka_bridge.config.settings import (
    Config,
    KafkaToRosRoute,
    QoS,
    RosToKafkaRoute,
    masked,
    warnings,
)
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.kafka.broker import Broker, TopicView
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.ros.node import Peer, RosNode, middleware, open_node
from ros2_kafka_bridge.ros.probe import SAMPLES, limits, probe, probe_topic
from ros2_kafka_bridge.ros.profile import Endpoints
from ros2_kafka_bridge.ros.qos import mismatch, profile

_DISCOVERY_S = 4.0  # Fast DDS announces a participant every 3 s: sometimes the first are missed

Level = Literal['ok', 'note', 'bad']
_MARKS: dict[Level, tuple[str, str]] = {
    'ok': ('ok  ', 'green'),
    'note': ('note', 'yellow'),
    'bad': ('BAD ', 'red'),
}


class Finding(NamedTuple):
    """One thing seen, and what it means for the user."""

    level: Level
    text: str


def report(config: Config, file: Path, *, connect: bool) -> int:
    """Print what the configuration says and, with `connect`, what it would meet.

    Returns:
        0 when all is well, 1 when a route could not run as it is.
    """
    console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
    console.print(f'{file}: {len(config.routes)} routes of bridge {config.name}, all well written')
    shown = masked(config)
    for name, value in shown['kafka'].items():
        console.print(f'  kafka {name}: {value}')
    findings = [Finding('note', text) for text in warnings(config)]
    _print(console, findings)
    if not connect:
        for route in config.routes:
            console.print(f'  {_way(route)}')
        return 0
    return _report_connected(console, config)


def _report_connected(console: Console, config: Config) -> int:
    bad = False
    broker = Broker(common_properties(config.kafka, client_id=config.name))
    brokers = _broker_findings(broker, config)
    console.print('Kafka')
    bad |= _print(console, brokers)
    topic = probe_topic()
    endpoints = Endpoints({topic: SAMPLES}, {topic: SAMPLES}, config.ros.lease_s)
    with open_node(f'{config.name}_check', config.ros.domain_id, endpoints) as node:
        console.print('ROS')
        bad |= _print(console, _ros_findings(node, topic, config))
        time.sleep(_DISCOVERY_S)
        for route in config.routes:
            console.print(_way(route))
            findings = list(_route_findings(route, node))
            if brokers[0].level != 'bad':
                findings += _kafka_findings(route, config, broker)
            bad |= _print(console, findings)
    return 1 if bad else 0


def _print(console: Console, findings: list[Finding]) -> bool:
    for finding in findings:
        mark, colour = _MARKS[finding.level]
        console.print(Text.assemble('  ', (mark, colour), ' ', finding.text))
    return any(finding.level == 'bad' for finding in findings)


def _way(route: KafkaToRosRoute | RosToKafkaRoute) -> str:
    if isinstance(route, KafkaToRosRoute):
        ends = f'Kafka {route.source.kafka} -> ROS {route.sink.ros} ({route.sink.type})'
    else:
        kind = route.source.type or 'the type that is published'
        ends = f'ROS {route.source.ros} ({kind}) -> Kafka {route.sink.kafka}'
    return f'{route.name}: {ends}, {route.format}'


# Kafka


def _broker_findings(broker: Broker, config: Config) -> list[Finding]:
    try:
        return [Finding('ok', broker.greeting())]
    except BridgeError as error:
        where = config.kafka.get('bootstrap.servers')
        return [
            Finding('bad', f'{error}: is bootstrap.servers ({where}) right, does the broker run?')
        ]


def _kafka_findings(
    route: KafkaToRosRoute | RosToKafkaRoute, config: Config, broker: Broker
) -> Iterator[Finding]:
    if isinstance(route, KafkaToRosRoute):
        topic = route.source.kafka
        view = broker.topic(topic)
        yield _topic_finding(topic, view, 'READ')
        yield from _group_findings(route, config, broker, view)
    else:
        topic = route.sink.kafka
        view = broker.topic(topic)
        if view.exists:
            yield _topic_finding(topic, view, 'WRITE')
            if view.rights is not None and 'READ' not in view.rights:
                yield Finding(
                    'note',
                    f'no READ on topic {topic}: needed for TRANSIENT_LOCAL publishers, to skip '
                    'what is there from before a restart',
                )
        else:
            yield Finding(
                'note',
                f'topic {topic} is not there: the route fails unless the broker creates topics '
                'by itself',
            )
    dead = broker.topic(route.dead_letter_topic)
    if route.on_error != 'dead_letter':
        yield Finding('note', f'on_error: {route.on_error}: bad records are not kept')
    elif dead.exists:
        yield _topic_finding(route.dead_letter_topic, dead, 'WRITE')
    else:
        yield Finding(
            'note',
            f'dead-letter topic {route.dead_letter_topic} is not there: it is created at the '
            'first dead letter, if this user may',
        )


def _topic_finding(topic: str, view: TopicView, right: str) -> Finding:
    if not view.exists:
        return Finding('bad', f'topic {topic} is not there ({view.problem}): create it')
    if view.rights is not None and right not in view.rights:
        return Finding('bad', f'this user has no {right} on topic {topic}: add the ACL')
    return Finding('ok', f'topic {topic} has {view.partitions} partitions')


def _group_findings(
    route: KafkaToRosRoute, config: Config, broker: Broker, view: TopicView
) -> Iterator[Finding]:
    group = route.group(config.name)
    if not view.exists:
        return
    try:
        committed = broker.committed(group, route.source.kafka, view.partitions)
    except BridgeError as error:
        yield Finding('bad', f'group {group}: {error}')
        return
    if committed:
        yield Finding('ok', f'group {group} goes on at its committed offsets')
    else:
        what = 'all that the topic holds' if route.source.start == 'earliest' else 'only new ones'
        yield Finding('ok', f'group {group} is new: start is {route.source.start}, {what}')


# ROS


def _ros_findings(node: RosNode, topic: str, config: Config) -> list[Finding]:
    import rclpy  # noqa: PLC0415 (open already, and heavy)

    domain = config.ros.domain_id
    where = 'ROS_DOMAIN_ID' if domain is None else f'domain {domain}'
    found = [Finding('ok', f'rclpy of {Path(rclpy.__file__).parent}, {middleware()}, {where}')]
    return found + [Finding('note', text) for text in limits(probe(node, topic))]


def _route_findings(route: KafkaToRosRoute | RosToKafkaRoute, node: RosNode) -> Iterator[Finding]:
    if isinstance(route, KafkaToRosRoute):
        yield from _reader_findings(route, _others(node.subscribers(route.sink.ros)))
    else:
        yield from _publisher_findings(route, _others(node.publishers(route.source.ros)))


def _others(peers: list[Peer]) -> list[Peer]:
    return [peer for peer in peers if not peer.node.endswith('_check')]


def _reader_findings(route: KafkaToRosRoute, peers: list[Peer]) -> Iterator[Finding]:
    fit = 0
    for peer in peers:
        if peer.message_type != route.sink.type:
            yield Finding('bad', f'{peer.node} reads {route.sink.ros} as {peer.message_type}')
        elif reason := mismatch(profile(route.sink.qos), peer.qos):
            yield Finding('bad', f'{peer.node} does not match: {reason}; set it in to.qos')
        else:
            fit += 1
            if peer.reliability == 'best_effort':
                text = f'{peer.node} reads best effort: guarantee 1 does not hold for it'
                yield Finding('note', text)
    if fit >= route.min_subscribers:
        yield Finding('ok', f'{fit} subscribers of {route.sink.ros} match')
    else:
        yield Finding(
            'note',
            f'{fit} of {route.min_subscribers} subscribers of {route.sink.ros}: '
            'the route waits for them (min_subscribers)',
        )
    if route.max_rate is None:
        yield Finding(
            'note',
            'a subscriber that is KEEP_LAST can overwrite its own queue, and its depth cannot '
            'be seen from outside: if one is, set max_rate',
        )


def _publisher_findings(route: RosToKafkaRoute, peers: list[Peer]) -> Iterator[Finding]:
    types = sorted({peer.message_type for peer in peers})
    if not peers:
        what = 'the route waits for one to learn its type' if route.source.type is None else ''
        yield Finding('note', f'nobody publishes {route.source.ros}{what and f": {what}"}')
    wanted = route.source.type or (types[0] if len(types) == 1 else None)
    if wanted is None and len(types) > 1:
        yield Finding('bad', f'{route.source.ros} has types {" and ".join(types)}: set from.type')
    for peer in peers:
        yield _publisher_finding(route.source.qos, peer, wanted)


def _publisher_finding(qos: QoS, peer: Peer, wanted: str | None) -> Finding:
    if wanted is not None and peer.message_type != wanted:
        return Finding('bad', f'{peer.node} publishes {peer.message_type}, not {wanted}')
    if reason := mismatch(peer.qos, profile(qos, peer.reliability, peer.durability)):
        return Finding('bad', f'{peer.node} does not match from.qos: {reason}')
    offer = f'{peer.node} publishes {peer.reliability}, {peer.durability}'
    if peer.reliability == 'best_effort':
        return Finding('note', f'{offer}: what the network loses is lost before the bridge')
    if peer.durability == 'volatile':
        return Finding('ok', f'{offer}: what it sends while the bridge is dead is lost')
    return Finding('ok', f'{offer}: what it sends while the bridge is dead comes afterwards')
