"""The ROS graph as the routes meet it: who is there, with which QoS, and what does not match."""

from collections.abc import Iterator, Sequence
from typing import Any

from ros2_kafka_bridge.commands.names import is_of_ros_itself
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.ros.discovery import NOT_TOLD, partial_view, why_nobody
from ros2_kafka_bridge.ros.matching import DOES, Counterpart, counterparts, others
from ros2_kafka_bridge.ros.node import Topic, domain_in_words, middleware, own_nodes
from ros2_kafka_bridge.ros.peer import Peer

_NO_TIME_NS = 2**31 * 10**9 - 1

Json = dict[str, Any]


def seen(config: Config, routes: Sequence[AnyRoute], topics: Sequence[Topic]) -> Json:
    """All topics, those of routes first, also those that nobody has joined yet."""
    known = {topic.name for topic in topics}
    missing = sorted({route.ros_topic for route in routes} - known)
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
    joined = [route for route in routes if route.ros_topic == topic.name]
    return {
        'name': topic.name,
        'types': topic.types,
        'problem': topic.problem,
        'of_ros': is_of_ros_itself(topic.name),
        'publishers': [_peer(peer, bool(own.fullmatch(peer.node))) for peer in topic.publishers],
        'subscribers': [_peer(peer, bool(own.fullmatch(peer.node))) for peer in topic.subscribers],
        'routes': [{'route': route.name, 'does': DOES[route.direction]} for route in joined],
        'matches': [
            {
                'route': route.name,
                'node': peer.node,
                'problem': problem.text if problem else '',
                'cure': problem.cure if problem else '',
                'unknown': unknown,
            }
            for route in joined
            for peer, problem, unknown in _counterparts(config, routes, route, topic)
        ],
    }


def _counterparts(
    config: Config, routes: Sequence[AnyRoute], route: AnyRoute, topic: Topic
) -> Iterator[Counterpart]:
    """Everybody whom a route could meet: its own bridge as its file says, not as it runs."""
    own = own_nodes(config.name)
    hashes = [peer.type_hash for peer in topic.publishers if own.fullmatch(peer.node)]
    there = topic._replace(
        publishers=others(topic.publishers, config.name),
        subscribers=others(topic.subscribers, config.name),
    )
    return counterparts(route, there, routes, lambda _: next(iter(hashes), None))


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
