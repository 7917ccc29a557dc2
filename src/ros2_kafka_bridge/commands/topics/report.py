"""The topics of both sides, with the routes that join them: what `topics` shows."""

import dataclasses
import json
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, Literal, NamedTuple

from ros2_kafka_bridge.commands.names import is_of_kafka_itself, is_of_ros_itself, stem
from ros2_kafka_bridge.commands.screen import screen, wait_for_discovery, waiting
from ros2_kafka_bridge.commands.topics.tables import show
from ros2_kafka_bridge.commands.topics.types import GraphTypes
from ros2_kafka_bridge.commands.topics.view import (
    KafkaRow,
    Match,
    Pair,
    PeerRow,
    RosRow,
    RouteRow,
    TopicsView,
)
from ros2_kafka_bridge.config.checks import DEAD_LETTER_SUFFIX
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, QoS, RosSettings
from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, records
from ros2_kafka_bridge.kafka.properties import PropertyValue, common_properties
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.ros import rates
from ros2_kafka_bridge.ros.discovery import NOT_TOLD, hint, partial_view
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.matching import DOES, counterparts
from ros2_kafka_bridge.ros.node import RosNode, Topic, domain_in_words, middleware, open_node
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.types import MessageType

EndOffsets = Mapping[tuple[str, int], int]

_DOES_IN_KAFKA: Final[Mapping[Direction, Literal['reads', 'writes']]] = {
    Direction.KAFKA_TO_ROS: 'reads',
    Direction.ROS_TO_KAFKA: 'writes',
}


class SideSettings(NamedTuple):
    """What both sides are reached with, and the routes that join them."""

    kafka: Mapping[str, PropertyValue]
    ros: RosSettings
    routes: Sequence[AnyRoute]

    @classmethod
    def of(cls, config: Config) -> 'SideSettings':
        """Those of a configuration."""
        return cls(config.kafka, config.ros, config.routes)

    @classmethod
    def without_file(cls, servers: str) -> 'SideSettings':
        """A cluster without passwords and the domain of ROS_DOMAIN_ID, no routes."""
        return cls({'bootstrap.servers': servers}, RosSettings(), [])


def report(sides: SideSettings, *, seconds: float | None, as_json: bool) -> int:
    """Look at both sides and print what is there.

    Args:
        sides: What to look at.
        seconds: How long rates are measured; None does not.
        as_json: For programs instead of people.

    Returns:
        0 when both sides were seen, 1 when one was not.
    """
    keep_clients_quiet()
    view = look(sides, seconds)
    if as_json:
        sys.stdout.write(json.dumps(dataclasses.asdict(view), indent=2) + '\n')
    else:
        show(screen(), view)
    return 1 if view.kafka_problem or view.ros_problem else 0


def look(sides: SideSettings, seconds: float | None) -> TopicsView:
    """Look at both sides.

    Raises:
        ConfigError: ROS is not here.
    """
    overview = Overview(common_properties(sides.kafka, client_id='topics'))
    topics, problem = _kafka_topics(overview)
    with open_node('topics', sides.ros.domain_id, Histories({}, {}, sides.ros.lease_s)) as node:
        wait_for_discovery()
        graph, ros_problem, ros_hint = _ros_topics(node, sides.routes)
        with waiting('Asking nodes for their types'):
            types = GraphTypes(node, sides.ros, graph)
        counted = {} if seconds is None else _countable(graph, types)
        before, started_s = overview.ends(topics), time.monotonic()
        ros_rates = {} if seconds is None else _ros_rates(node, graph, counted, seconds)
        after = before if seconds is None else overview.ends(topics)
        measured_s = time.monotonic() - started_s
        ros_rows = [_ros_row(topic, sides.routes, types, ros_rates) for topic in graph]
    kafka_rates = {} if seconds is None else _kafka_rates(topics, before, after, measured_s)
    begins = overview.begins(topics)
    kafka_rows = [
        _kafka_row(topic, sides.routes, records(topic, begins, after), kafka_rates)
        for topic in [*topics, *_missing_in_kafka(topics, sides.routes, problem)]
    ]
    return TopicsView(
        brokers=str(sides.kafka.get('bootstrap.servers', '')),
        kafka_problem=problem,
        ros_problem=ros_problem,
        ros_hint=ros_hint,
        ros_middleware=middleware(),
        ros_domain=domain_in_words(sides.ros.domain_id),
        seconds=seconds,
        kafka=sorted(kafka_rows, key=lambda row: (bool(row.kind), row.name)),
        ros=sorted(ros_rows, key=lambda row: (bool(row.kind), row.name)),
        pairs=list(_pairs(topics, graph, sides.routes)),
    )


# Kafka


def _kafka_topics(overview: Overview) -> tuple[list[KafkaTopic], str]:
    try:
        return overview.topics(), ''
    except TransportError as error:
        named = 'bootstrap.servers' in str(error)  # with its own cure
        hint = '' if named else '; is bootstrap.servers right, does the broker run?'
        return [], f'{error}{hint}'
    except BridgeError as error:
        return [], str(error)


def _kafka_rates(
    topics: Iterable[KafkaTopic], before: EndOffsets, after: EndOffsets, measured_s: float
) -> dict[str, float]:
    counts = {topic.name: records(topic, before, after) for topic in topics}
    # One that was made anew meanwhile ends before it did.
    known = {name: count for name, count in counts.items() if count is not None and count >= 0}
    return {name: count / measured_s for name, count in known.items()}


def _missing_in_kafka(
    topics: Iterable[KafkaTopic], routes: Sequence[AnyRoute], problem: str
) -> Iterator[KafkaTopic]:
    known = {topic.name for topic in topics}
    for name in sorted({route.kafka_topic for route in routes} - known):
        text = 'not seen' if problem else 'not there, or this user may not see it'
        yield KafkaTopic(name, 0, text)


def _kafka_row(
    topic: KafkaTopic, routes: Sequence[AnyRoute], held: int | None, found: Mapping[str, float]
) -> KafkaRow:
    dead_letters = {route.dead_letter_topic for route in routes}
    kind: Literal['', 'internal', 'dead letters'] = ''
    if is_of_kafka_itself(topic.name):
        kind = 'internal'
    elif topic.name in dead_letters or topic.name.endswith(DEAD_LETTER_SUFFIX):
        kind = 'dead letters'
    return KafkaRow(
        name=topic.name,
        partitions=None if topic.problem else topic.partitions,
        records=None if topic.problem else held,
        rate=found.get(topic.name),
        kind=kind,
        routes=[
            RouteRow(route.name, _DOES_IN_KAFKA[route.direction])
            for route in routes
            if route.kafka_topic == topic.name
        ],
        problem=topic.problem,
    )


# ROS


def _ros_topics(node: RosNode, routes: Sequence[AnyRoute]) -> tuple[list[Topic], str, str]:
    """All topics, why none is known, and what to look for where some may not be."""
    partial = partial_view() or ''
    try:
        graph = node.topics()
    except BridgeError as error:
        return [], str(error), partial
    look_for = partial if graph else hint('is it the domain of the nodes, do they run?')
    return graph + _missing_in_ros(graph, routes, NOT_TOLD if partial else ''), '', look_for


def _missing_in_ros(
    graph: Iterable[Topic], routes: Sequence[AnyRoute], problem: str
) -> list[Topic]:
    known = {topic.name for topic in graph}
    missing = {route.ros_topic for route in routes} - known
    return [Topic(name, [], [], [], problem) for name in missing]


def _countable(graph: Iterable[Topic], types: GraphTypes) -> dict[str, MessageType]:
    """The topics where counting disturbs nobody, with their types.

    A bridge waits for subscribers, and publishes again what is in flight when one has gone: it
    would take the counting for such a one.
    """
    loaded = {
        topic.name: types.load(topic.name, topic.types[0])
        for topic in graph
        if topic.publishers
        and not topic.problem
        and len(topic.types) == 1
        and (is_of_ros_itself(topic.name) or all(_is_no_bridge(p) for p in topic.publishers))
    }
    return {name: it for name, it in loaded.items() if it is not None}


def _ros_rates(
    node: RosNode, graph: Iterable[Topic], counted: Mapping[str, MessageType], seconds: float
) -> dict[str, float]:
    silent = {topic.name: 0.0 for topic in graph if not topic.publishers and not topic.problem}
    with waiting(f'Counting messages ({seconds:g} s)'):
        return silent | rates.count(node, counted, seconds)


def _is_no_bridge(peer: Peer) -> bool:
    return peer.named and not peer.is_bridge


def _ros_row(
    topic: Topic, routes: Sequence[AnyRoute], types: GraphTypes, found: Mapping[str, float]
) -> RosRow:
    joined = [route for route in routes if route.ros_topic == topic.name]
    return RosRow(
        name=topic.name,
        types=topic.types,
        type_origins=types.origins(topic),
        type_problems=types.problems(topic),
        publishers=[_peer_row(peer) for peer in topic.publishers],
        subscribers=[_peer_row(peer) for peer in topic.subscribers],
        rate=found.get(topic.name),
        kind='of ROS itself' if is_of_ros_itself(topic.name) else '',
        routes=[RouteRow(route.name, DOES[route.direction]) for route in joined],
        matches=[match for route in joined for match in _matches(route, topic, routes, types)],
        problem=topic.problem,
    )


def _peer_row(peer: Peer) -> PeerRow:
    return PeerRow(peer.node, peer.message_type, peer.reliability, peer.durability)


def _matches(
    route: AnyRoute, topic: Topic, routes: Sequence[AnyRoute], types: GraphTypes
) -> Iterator[Match]:
    def hash_of(route: KafkaToRosRoute) -> str | None:
        loaded = types.load(topic.name, route.type_name)
        return loaded and loaded.type_hash

    for peer, problem, unknown in counterparts(route, topic, routes, hash_of):
        text = f'{problem.text}; {problem.cure}' if problem else ''
        yield Match(route.name, peer.node, text, unknown)


# Both


def _pairs(
    topics: Sequence[KafkaTopic], graph: Sequence[Topic], routes: Sequence[AnyRoute]
) -> Iterator[Pair]:
    joined = {(route.kafka_topic, route.ros_topic) for route in routes}
    ours = [t.name for t in topics if not is_of_kafka_itself(t.name)]
    by_stem = {
        stem(topic.name): topic
        for topic in graph
        if not is_of_ros_itself(topic.name) and not topic.problem
    }
    for kafka in ours:
        ros = by_stem.get(stem(kafka))
        if ros is None or (kafka, ros.name) in joined:
            continue
        problem = '' if len(ros.types) < 2 else f'{ros.name} has types {" and ".join(ros.types)}'
        if any(not peer.is_bridge for peer in ros.publishers):
            yield Pair(kafka, ros.name, 'ROS to Kafka', problem)
        else:
            yield Pair(kafka, ros.name, 'Kafka to ROS', problem or _unmatched(ros.subscribers))


def _unmatched(subscribers: Sequence[Peer]) -> str:
    """What the subscribers ask for beyond what the bridge offers by itself."""
    asked = (mismatch(profile(QoS()), peer.qos) for peer in subscribers)
    reasons = ', '.join(sorted({reason for reason in asked if reason}))
    return f'{reasons}; set it in to.qos' if reasons else ''
