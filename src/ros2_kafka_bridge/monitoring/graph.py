"""The ROS graph as the routes meet it: who is there, with which QoS, and what does not match."""

from collections.abc import Iterator, Sequence
from typing import Any

from ros2_kafka_bridge.commands.names import is_of_ros_itself
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.ros.discovery import NOT_TOLD, partial_view, why_nobody
from ros2_kafka_bridge.ros.matching import (
    Mismatch,
    others,
    own_publishers,
    own_readers,
    publisher_problem,
    publisher_unknown,
    reader_problem,
    reader_unknown,
    ros_end,
    type_of,
)
from ros2_kafka_bridge.ros.node import Peer, Topic, domain_in_words, middleware, own_nodes

_NO_TIME_NS = 2**31 * 10**9 - 1

Json = dict[str, Any]


def seen(config: Config, routes: Sequence[AnyRoute], topics: Sequence[Topic]) -> Json:
    """All topics, those of routes first, also those that nobody has joined yet."""
    known = {topic.name for topic in topics}
    missing = sorted({ros_end(route) for route in routes} - known)
    partial = partial_view() or ''
    untold = NOT_TOLD if partial else ''
    rows = [
        _topic(config, routes, topic)
        for topic in [*topics, *(Topic(name, [], [], [], untold) for name in missing)]
    ]
    return {
        'problem': '',
        'domain': domain_in_words(config.ros.domain_id),
        'middleware': middleware(),
        'hidden': partial if topics else why_nobody() or '',
        'topics': sorted(rows, key=lambda it: (not it['routes'], it['of_ros'], it['name'])),
    }


def _topic(config: Config, routes: Sequence[AnyRoute], topic: Topic) -> Json:
    own = own_nodes(config.name)
    joined = [route for route in routes if ros_end(route) == topic.name]
    return {
        'name': topic.name,
        'types': topic.types,
        'problem': topic.problem,
        'of_ros': is_of_ros_itself(topic.name),
        'publishers': [_peer(peer, bool(own.fullmatch(peer.node))) for peer in topic.publishers],
        'subscribers': [_peer(peer, bool(own.fullmatch(peer.node))) for peer in topic.subscribers],
        'routes': [
            {
                'route': route.name,
                'does': 'publishes' if isinstance(route, KafkaToRosRoute) else 'takes',
            }
            for route in joined
        ],
        'matches': [
            {
                'route': route.name,
                'node': peer.node,
                'problem': problem.text if problem else '',
                'cure': problem.cure if problem else '',
                'unknown': '' if problem else unknown,
            }
            for route in joined
            for peer, problem, unknown in _matches(config, routes, route, topic)
        ],
    }


def _matches(
    config: Config, routes: Sequence[AnyRoute], route: AnyRoute, topic: Topic
) -> Iterator[tuple[Peer, Mismatch | None, str]]:
    """Everybody whom a route could meet, what is wrong, and what is not known, as far as it goes.

    Its own bridge as its file says, not as it runs.
    """
    if isinstance(route, KafkaToRosRoute):
        own = own_nodes(config.name)
        hashes = [peer.type_hash for peer in topic.publishers if own.fullmatch(peer.node)]
        type_hash = hashes[0] if hashes else None
        for peer in [*others(topic.subscribers, config.name), *own_readers(routes, route)]:
            problem = reader_problem(route, peer, type_hash)
            yield peer, problem, reader_unknown(route, peer, type_hash)
        return
    publishers = [*others(topic.publishers, config.name), *own_publishers(routes, route)]
    message_type = type_of(route, publishers)
    for peer in publishers:
        yield peer, publisher_problem(route, peer, message_type), publisher_unknown(message_type)


def _peer(peer: Peer, own: bool) -> Json:  # noqa: FBT001 (a field)
    return {
        'node': peer.node if peer.named else 'not known yet',
        'type': peer.message_type,
        'own': own,
        'qos': [peer.reliability, peer.durability, *_further(peer.qos)],
    }


def _further(qos: Any) -> Iterator[str]:
    """What is not as usual, in words; history and depth are not told to others."""
    if qos.liveliness.name == 'MANUAL_BY_TOPIC':
        yield 'liveliness manual_by_topic'
    for name in ('deadline', 'lifespan'):
        if 0 < (time_ns := getattr(qos, name).nanoseconds) < _NO_TIME_NS:
            yield f'{name} {time_ns / 1e9:g} s'
