"""Whether a route's own ROS endpoint and those of others would match, and why not."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, Final, Literal, NamedTuple

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.node import Topic, own_nodes
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import Unmatched, mismatch, profile, unmatched
from ros2_kafka_bridge.route.format import reads_fields

DOES: Final[Mapping[Direction, Literal['publishes', 'takes']]] = {
    Direction.KAFKA_TO_ROS: 'publishes',
    Direction.ROS_TO_KAFKA: 'takes',
}
"""What a route does at its topic in ROS."""


class Mismatch(NamedTuple):
    """Why two endpoints do not match, and what would help."""

    text: str
    cure: str


def reader_problem(route: KafkaToRosRoute, reader: Peer, type_hash: str | None) -> Mismatch | None:
    """Why a subscriber would get nothing from a route, or nothing right; None if it would.

    Args:
        route: The route that would publish to it.
        reader: Seen in the graph.
        type_hash: Of what the route publishes; None where it is not known.
    """
    if reader.message_type != route.type_name:
        text = f'reads {route.ros_topic} as {reader.message_type}'
        return Mismatch(text, 'set to.type, or give one of the two another topic')
    if found := unmatched(profile(route.qos), reader.qos):
        reasons = '; '.join(it.reason for it in found)
        return Mismatch(f'does not match: {reasons}', f'set to.qos: {_with(route.qos, found)}')
    if reader.misreads(route.type_name, type_hash):
        waits = '; the route waits while it is there' if route.when_misread == 'wait' else ''
        return Mismatch(
            f'would misread {route.type_name}, of which it has another definition{waits}',
            'install the same version of the package on both sides',
        )
    return None


def _with(qos: QoS, found: Sequence[Unmatched]) -> str:
    """The whole QoS of a route as it would have to be, to be pasted into its file."""
    said = {name: value for name, value in asdict(qos).items() if value is not None}
    wanted = said | {it.setting: it.value for it in found}
    return f'{{{", ".join(f"{name}: {value}" for name, value in wanted.items())}}}'


def publisher_problem(
    route: RosToKafkaRoute,
    publisher: Peer,
    message_type: str | None,
    type_hash: str | None = None,
) -> Mismatch | None:
    """Why a route would get nothing from a publisher; None if it would.

    Args:
        route: The route that would take from it.
        publisher: Seen in the graph.
        message_type: What the route would read; None while that is open.
        type_hash: Of what the route would read; None where it is not known.
    """
    if message_type is not None and publisher.message_type != message_type:
        text = f'publishes {publisher.message_type}, not {message_type}'
        return Mismatch(text, 'set from.type, or give one of the two another topic')
    asked = profile(route.qos, publisher.reliability, publisher.durability)
    if reason := mismatch(publisher.qos, asked):
        text = f'does not match from.qos: {reason}'
        return Mismatch(text, 'leave it out to follow the publishers')
    if message_type and reads_fields(route) and publisher.misreads(message_type, type_hash):
        text = f'publishes another definition of {message_type}: its messages are dead letters'
        cure = 'leave from.type out, put its .msg files into ros.message_path, or use format: cdr'
        return Mismatch(text, cure)
    return None


def reader_unknown(route: KafkaToRosRoute, reader: Peer, type_hash: str | None) -> str:
    """What is not known of a subscriber without a `reader_problem`; empty where nothing is."""
    here, there = ((told or '').partition('_')[0] for told in (type_hash, reader.type_hash))
    if reader.is_bridge or is_own(reader) or (here and here == there):
        return ''
    return f'whether its definition of {route.type_name} is the same is not known'


def publisher_unknown(message_type: str | None) -> str:
    """What is not known of a publisher without a `publisher_problem`; empty where nothing is."""
    return '' if message_type else 'which of their types the route takes is not known'


def type_of(route: RosToKafkaRoute, publishers: list[Peer]) -> str | None:
    """What a route from ROS would read; None where nobody or more than one kind is there."""
    types = {publisher.message_type for publisher in publishers}
    return route.type_name or (types.pop() if len(types) == 1 else None)


def others(peers: list[Peer], bridge: str) -> list[Peer]:
    """Who is there beside the bridge of that name, which may be running just now."""
    own = own_nodes(bridge)
    return [peer for peer in peers if not own.fullmatch(peer.node)]


def own_readers(routes: Sequence[AnyRoute], route: KafkaToRosRoute) -> list[Peer]:
    """The subscribers that the other routes of a configuration would be: they follow an offer."""
    reliability, durability = route.qos.reliability, route.qos.durability
    offered = partial(
        profile, reliability=reliability or 'reliable', durability=durability or 'volatile'
    )
    return _own_ends(routes, route, offered)


def own_publishers(routes: Sequence[AnyRoute], route: RosToKafkaRoute) -> list[Peer]:
    """The publishers that the other routes of a configuration would be."""
    return _own_ends(routes, route)


def _own_ends(
    routes: Sequence[AnyRoute], route: AnyRoute, qos_of: Callable[[QoS], Any] = profile
) -> list[Peer]:
    """The ends at the topic of a route of those that go the other way."""
    return [
        Peer.of_qos(
            f'route {other.name}',
            other.type_name or route.type_name or '',
            b'',
            '',
            qos_of(other.qos),
        )
        for other in routes
        if other.direction is not route.direction and other.ros_topic == route.ros_topic
    ]


def is_own(peer: Peer) -> bool:
    """Whether it is a route of the configuration, not a node of the graph."""
    return not peer.gid


class Counterpart(NamedTuple):
    """Somebody whom a route would meet at its topic in ROS.

    Args:
        peer: Who.
        problem: Why the two would not match; None where they would.
        unknown: What is not known of that; empty where nothing is.
    """

    peer: Peer
    problem: Mismatch | None
    unknown: str


def counterparts(
    route: AnyRoute,
    topic: Topic,
    routes: Sequence[AnyRoute],
    hash_of: Callable[[KafkaToRosRoute], str | None],
) -> Iterator[Counterpart]:
    """Everybody whom a route would meet.

    Args:
        route: The route.
        topic: Its topic, with those who are there.
        routes: Of its configuration: the others may be there, too.
        hash_of: Tells the hash of the type that a route would publish; None is not known.
    """
    if isinstance(route, KafkaToRosRoute):
        type_hash = hash_of(route)
        for peer in [*topic.subscribers, *own_readers(routes, route)]:
            problem = reader_problem(route, peer, type_hash)
            unknown = '' if problem else reader_unknown(route, peer, type_hash)
            yield Counterpart(peer, problem, unknown)
        return
    publishers = [*topic.publishers, *own_publishers(routes, route)]
    message_type = type_of(route, publishers)
    for peer in publishers:
        problem = publisher_problem(route, peer, message_type)
        unknown = '' if problem else publisher_unknown(message_type)
        yield Counterpart(peer, problem, unknown)
