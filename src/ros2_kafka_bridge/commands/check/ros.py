"""What `check` finds in the ROS graph: who is there, and whether a route would match."""

from collections.abc import Iterator

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.message_types.layout import Layout, is_bulk
from ros2_kafka_bridge.ros.confirmation import Confirmation, asks_readers
from ros2_kafka_bridge.ros.discovery import NOT_TOLD, partial_view, why_nobody
from ros2_kafka_bridge.ros.installation import rclpy_folder
from ros2_kafka_bridge.ros.matching import (
    is_own,
    others,
    own_publishers,
    own_readers,
    publisher_problem,
    reader_problem,
)
from ros2_kafka_bridge.ros.node import RosNode, domain_in_words, middleware
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.probe import Abilities, limits
from ros2_kafka_bridge.ros.second_channel import unheard
from ros2_kafka_bridge.ros.sockets import receive_buffer_bytes
from ros2_kafka_bridge.ros.type_support.choice import why_import
from ros2_kafka_bridge.threads.stop import Stop


def graph_findings(abilities: Abilities, config: Config, *, sees_none: bool) -> list[Finding]:
    """Which ROS is in use, what it cannot do, and why it may not show others.

    Args:
        abilities: What the middleware can do.
        config: Says the domain.
        sees_none: Whether it shows nobody at all.
    """
    domain = domain_in_words(config.ros.domain_id)
    place = f'rclpy of {rclpy_folder()}, {middleware()}, {domain}'
    found = [Finding('ok', 'graph', place)]
    if hidden := why_nobody() if sees_none else partial_view():
        found.append(Finding('note', 'graph', hidden))
    found += [Finding('note', 'middleware', text) for text in limits(abilities)]
    if config.ros.packages == 'as_needed' and (why := why_import()):
        found.append(Finding('note', 'types', f'their packages are imported: {why}'))
    return found


def sees_none(node: RosNode) -> bool:
    """Whether the graph shows nobody else; it does where somebody there cannot be read."""
    try:
        return not node.topics()
    except BridgeError:
        return False


def confirmation_problem(node: RosNode, abilities: Abilities, config: Config) -> str:
    """Why no route to ROS would know what has arrived; empty where it would, or none asks."""
    try:
        if any(asks_readers(route, config) for route in config.to_ros):
            Confirmation(node, abilities).require(Stop())
    except BridgeError as error:
        return str(error)
    return ''


def confirmation_finding(route: KafkaToRosRoute, config: Config, problem: str) -> Finding:
    """Whether a route would know what has arrived; `problem` is why it could not."""
    if not asks_readers(route, config):
        why = 'ros.confirmation' if config.ros.confirmation == 'none' else 'to.qos'
        text = f'nobody asks what has arrived ({why}): it counts as published, not as confirmed'
        return Finding('note', 'confirmation', text)
    if problem:
        return Finding('bad', 'confirmation', problem)
    return Finding('ok', 'confirmation', f'{middleware()} tells what has arrived (it was tried)')


def reader_findings(
    route: KafkaToRosRoute, config: Config, node: RosNode, type_hash: str | None
) -> Iterator[Finding]:
    """Who would get the messages of a route to ROS; `type_hash` is of what it publishes."""
    topic, fit = route.ros_topic, 0
    own = own_readers(config.routes, route)
    peers = node.subscribers(topic)
    for peer in [*(others(peers, config.name) if own else peers), *own]:
        if problem := reader_problem(route, peer, type_hash):
            yield Finding('bad', 'readers', f'{peer.node} {problem.text}', problem.cure)
            continue
        fit += 1
        if peer.reliability == 'best_effort':
            text = f'{peer.node} reads best effort: guarantee 1 does not hold for it'
            yield Finding('note', 'readers', text)
    if fit < max(1, route.min_subscribers) and partial_view():
        yield Finding('note', 'readers', f'{topic}: {NOT_TOLD}; it tells the route itself')
        return
    if fit >= route.min_subscribers:
        names = ', '.join(peer.node for peer in own)
        text = f'{count(fit, "subscriber")} of {topic} match{"es" * (fit == 1)}'
        yield Finding('ok', 'readers', f'{text}{names and f", with {names} of this file"}')
        return
    text = (
        f'{fit} of {count(route.min_subscribers, "subscriber")} of {topic}: '
        'the route waits for them (min_subscribers)'
    )
    yield Finding('note', 'readers', text, waits=f'for subscribers of {topic}')


def publishers(route: RosToKafkaRoute, config: Config, node: RosNode) -> list[Peer]:
    """Who publishes what a route would take, the routes of its own file among them."""
    own = own_publishers(config.routes, route)
    peers = node.publishers(route.ros_topic)
    return [*(others(peers, config.name) if own else peers), *own]


def publisher_findings(
    route: RosToKafkaRoute,
    peers: list[Peer],
    message_type: str | None,
    type_hash: str | None = None,
) -> Iterator[Finding]:
    """Whom a route from ROS would take from, and which type."""
    topic = route.ros_topic
    types = sorted({peer.message_type for peer in peers})
    if not peers and partial_view():
        yield _unseen_finding(topic, message_type)
    elif not peers:
        learns = ': the route waits for one to learn its type' if message_type is None else ''
        waits = '' if message_type else f'for a publisher of {topic}'
        yield Finding('note', 'publishers', f'nobody publishes {topic}{learns}', waits=waits)
    for peer in peers:
        if problem := publisher_problem(route, peer, message_type, type_hash):
            yield Finding('bad', 'publishers', f'{peer.node} {problem.text}', problem.cure)
        else:
            yield _offer_finding(peer, topic)
    if message_type is None and types:
        text = f'{topic} has types {" and ".join(types)}'
        yield Finding('bad', 'type', text, 'set from.type')


def _unseen_finding(topic: str, message_type: str | None) -> Finding:
    """That nobody is seen to publish says nothing: a route of that type sees them, no other."""
    text = f'{topic}: {NOT_TOLD}'
    if message_type is not None:
        return Finding('note', 'publishers', f'{text}; it tells the route itself')
    text += ', nor the route, which waits to learn its type'
    cure = 'set from.type, or let the bridge be told of all'
    return Finding('note', 'publishers', text, cure, waits=f'for the type of {topic}')


def _offer_finding(peer: Peer, topic: str) -> Finding:
    if is_own(peer):
        return Finding('ok', 'publishers', f'{peer.node} of this file publishes {topic}')
    offer = f'{peer.node} publishes {peer.reliability}, {peer.durability}'
    if peer.reliability == 'best_effort':
        text = f'{offer}: what the network loses is lost before the bridge'
        return Finding('note', 'publishers', text)
    if peer.durability == 'volatile':
        text = f'{offer}: what it sends while no bridge runs is lost'
        return Finding('ok', 'publishers', text)
    text = f'{offer}: what it sends while no bridge runs comes afterwards, within its depth'
    return Finding('ok', 'publishers', text)


def size_findings(
    route: RosToKafkaRoute, layout: Layout | None, node: RosNode
) -> Iterator[Finding]:
    """Whether messages come whole that are larger than what a socket of this host holds."""
    room_bytes = receive_buffer_bytes(node.domain_id)
    if room_bytes is None or layout is None:
        return
    is_large = route.max_message_bytes != type(route).max_message_bytes or is_bulk(layout)
    if route.max_message_bytes > room_bytes and is_large:
        text = (
            f'messages may have {route.max_message_bytes:,} bytes (max_message_bytes), and a UDP '
            f'socket of DDS holds {room_bytes:,} here: of larger ones that come without shared '
            'memory, from other hosts or DDS vendors, some come late or never'
        )
        cure = 'a DDS profile with a larger receiveBufferSize (docs/tuning.md, DDS)'
        yield Finding('note', 'size', text, cure)


def channel_findings(layout: Layout | None) -> Iterator[Finding]:
    """Whether ROS sends messages of a type where the bridge may not hear them."""
    if layout is not None and (may_miss := unheard(layout)):
        yield Finding('note', 'middleware', may_miss)


def key_findings(route: RosToKafkaRoute, layout: Layout | None) -> Iterator[Finding]:
    """Whether the messages have what the key of their records is made of."""
    from ros2_kafka_bridge.route.labels import make_key  # noqa: PLC0415 (with the types of ROS)

    if route.key is None or layout is None:
        return
    try:
        make_key(route.key, route.ros_topic, layout)
    except ConfigError as error:
        yield Finding('bad', 'key', str(error), 'mend to.key')
    else:
        yield Finding('ok', 'key', f'{route.key}: {layout.type_name} has it')
