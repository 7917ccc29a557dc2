"""Whether a route's own ROS endpoint and those of others would match, and why not."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

from ros2_kafka_bridge.config.routes import AnyRoute, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.node import Peer, own_nodes
from ros2_kafka_bridge.ros.qos import Unmatched, mismatch, profile, unmatched
from ros2_kafka_bridge.route.format import reads_fields


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
    if reader.message_type != route.sink.type:
        text = f'reads {route.sink.ros} as {reader.message_type}'
        return Mismatch(text, 'set to.type, or give one of the two another topic')
    if found := unmatched(profile(route.sink.qos), reader.qos):
        reasons = '; '.join(it.reason for it in found)
        return Mismatch(
            f'does not match: {reasons}', f'set to.qos: {_with(route.sink.qos, found)}'
        )
    if reader.misreads(route.sink.type, type_hash):
        waits = '; the route waits while it is there' if route.when_misread == 'wait' else ''
        return Mismatch(
            f'would misread {route.sink.type}, of which it has another definition{waits}',
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
    asked = profile(route.source.qos, publisher.reliability, publisher.durability)
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
    return f'whether its definition of {route.sink.type} is the same is not known'


def publisher_unknown(message_type: str | None) -> str:
    """What is not known of a publisher without a `publisher_problem`; empty where nothing is."""
    return '' if message_type else 'which of their types the route takes is not known'


def type_of(route: RosToKafkaRoute, publishers: list[Peer]) -> str | None:
    """What a route from ROS would read; None where nobody or more than one kind is there."""
    types = {publisher.message_type for publisher in publishers}
    return route.source.type or (types.pop() if len(types) == 1 else None)


def others(peers: list[Peer], bridge: str) -> list[Peer]:
    """Who is there beside the bridge of that name, which may be running just now."""
    own = own_nodes(bridge)
    return [peer for peer in peers if not own.fullmatch(peer.node)]


def own_readers(routes: Sequence[AnyRoute], route: KafkaToRosRoute) -> list[Peer]:
    """The subscribers that the other routes of a configuration would be."""
    offered = route.sink.qos.reliability or 'reliable', route.sink.qos.durability or 'volatile'
    return [
        _own(f'route {other.name}', other.source.type or route.sink.type, own)
        for other in routes
        if isinstance(other, RosToKafkaRoute) and other.source.ros == route.sink.ros
        for own in [profile(other.source.qos, *offered)]
    ]


def own_publishers(routes: Sequence[AnyRoute], route: RosToKafkaRoute) -> list[Peer]:
    """The publishers that the other routes of a configuration would be."""
    return [
        _own(f'route {other.name}', other.sink.type, profile(other.sink.qos))
        for other in routes
        if isinstance(other, KafkaToRosRoute) and other.sink.ros == route.source.ros
    ]


def is_own(peer: Peer) -> bool:
    """Whether it is a route of the configuration, not a node of the graph."""
    return not peer.gid


def _own(name: str, message_type: str, qos: object) -> Peer:
    return Peer.of_qos(name, message_type, b'', '', qos)


def ros_end(route: AnyRoute) -> str:
    """The ROS topic of a route."""
    return route.sink.ros if isinstance(route, KafkaToRosRoute) else route.source.ros
