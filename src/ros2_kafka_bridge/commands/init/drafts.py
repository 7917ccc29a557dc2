"""From what the ROS graph shows to a draft of a route for each of its topics."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, NamedTuple

from ros2_kafka_bridge.commands.names import (
    is_of_ros_itself,
    kafka_name,
    route_name,
    stem,
    unique,
)
from ros2_kafka_bridge.config.checks import ros_topic
from ros2_kafka_bridge.config.routes import TEXT_TYPE
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.shown_types import ShownTypes
from ros2_kafka_bridge.ros.types import MessageType

_LARGE = frozenset(
    {'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/Image', 'sensor_msgs/msg/PointCloud2'}
)
_TOLD = 'Its type is not installed here: the bridge asks a node that uses it.'


class Draft(NamedTuple):
    """A route as it would be written.

    Args:
        name: Of the route.
        way: From the graph to Kafka, or the other way.
        message_type: Of the ROS topic, where it has one only.
        latched: Whether the bridge's writer has to be TRANSIENT_LOCAL for its readers.
        comments: Sentences for the one who edits the file.
        problem: Why it cannot be bridged as it is; empty if it can.
    """

    name: str
    way: Literal['to Kafka', 'from Kafka']
    ros: str
    kafka: str
    message_type: str
    latched: bool
    comments: list[str]
    problem: str

    @property
    def format(self) -> str:
        """Text for what is text, JSON for what people and their programs read.

        Pictures and clouds are megabytes that nobody reads as text: they stay the bytes that
        they are.
        """
        if self.message_type == TEXT_TYPE:
            return 'text'
        return 'cdr' if self.message_type in _LARGE else 'json'


def drafts(
    topics: Iterable[Topic],
    types: ShownTypes,
    kafka_topics: Sequence[str] | None = None,
) -> list[Draft]:
    """Draft a route for each topic that is not of ROS itself.

    What is published goes to Kafka, what is only subscribed to comes from Kafka: no topic goes
    both ways, so the routes close no cycle. Endpoints of bridges do not count.

    Args:
        topics: Of the graph.
        types: What is known of those that are not installed here.
        kafka_topics: What Kafka holds, to use the names that are there; None is not asked.
    """
    held = {stem(name): name for name in kafka_topics or ()}
    taken_topics: set[str] = set()
    taken_names: set[str] = set()
    found = []
    for topic in topics:
        publishers = [peer for peer in topic.publishers if not peer.is_bridge]
        subscribers = [peer for peer in topic.subscribers if not peer.is_bridge]
        if is_of_ros_itself(topic.name) or not (publishers or subscribers):
            continue
        names = sorted({peer.message_type for peer in publishers + subscribers})
        wanted = held.get(stem(topic.name)) or kafka_name(topic.name)
        kafka = unique(wanted, taken_topics)
        draft = Draft(
            name=unique(route_name(topic.name), taken_names),
            way='to Kafka' if publishers else 'from Kafka',
            ros=topic.name,
            kafka=kafka,
            message_type=names[0],
            latched=not publishers and any(p.durability == 'transient_local' for p in subscribers),
            comments=[],
            problem=_problem(topic.name, names, types),
        )
        comments = list(_comments(draft, publishers, subscribers))
        if not draft.problem and isinstance(types.get((topic.name, names[0])), MessageType):
            comments.append(_TOLD)
        if kafka_topics is not None and kafka not in kafka_topics:
            comments.append(f'Kafka has no topic {kafka} yet.')
        found.append(draft._replace(comments=comments))
    return found


def _problem(topic: str, names: Sequence[str], types: ShownTypes) -> str:
    if len(names) > 1:
        return (
            f'{topic} has types {" and ".join(names)}: a route carries one. Give one of the '
            'two another topic, or choose the type.'
        )
    try:
        ros_topic(topic)
    except ValueError as error:
        return f'{topic} cannot be bridged: {error}.'
    found = types.get((topic, names[0]))
    return f'{found}.' if isinstance(found, BridgeError) else ''


def _comments(
    draft: Draft, publishers: Sequence[Peer], subscribers: Sequence[Peer]
) -> Iterator[str]:
    if publishers:
        yield f'Published by {_names(publishers)}.'
        if lossy := [p for p in publishers if p.reliability == 'best_effort']:
            yield (
                f'Best effort from {_names(lossy)}: what the network loses is lost before the '
                'bridge.'
            )
        if latched := [p for p in publishers if p.durability == 'transient_local']:
            yield (
                f'Transient local from {_names(latched)}: what it published before the bridge '
                'came is taken, too.'
            )
    else:
        yield f'Nobody publishes it, {_names(subscribers)} subscribes.'
        if lossy := [p for p in subscribers if p.reliability == 'best_effort']:
            yield f'Best effort to {_names(lossy)}: what the network loses stays lost.'
        if draft.latched:
            yield (
                'Transient local is asked for: a subscriber that comes late gets what was '
                'published before.'
            )
        yield from _mismatches(draft.latched, subscribers)
    if draft.message_type in _LARGE:
        yield (
            'Messages above 1 MB need max_message_bytes here, and max.message.bytes of the '
            'Kafka topic.'
        )


def _mismatches(latched: bool, subscribers: Sequence[Peer]) -> Iterator[str]:  # noqa: FBT001 (a field of the draft)
    offered = profile(QoS(durability='transient_local' if latched else None))
    for peer in subscribers:
        if reason := mismatch(offered, peer.qos):
            yield f'{peer.node} would not match: {reason}. It is set in to.qos.'


def _names(peers: Sequence[Peer]) -> str:
    """The nodes, each once, the first three by name."""
    names = list(Counter(peer.node for peer in peers))
    rest = [f'{len(names) - 3} more'] if len(names) > 3 else []
    shown = [*names[:3], *rest]
    return ' and '.join([', '.join(shown[:-1]), shown[-1]]) if len(shown) > 1 else shown[0]
