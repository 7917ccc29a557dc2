"""The types of many topics at once, for who looks at the whole graph."""

import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.message_types.description import DescribedTypes
from ros2_kafka_bridge.message_types.installed import installed_names
from ros2_kafka_bridge.ros.node import RosNode, Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.type_request import ask_users
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader, WantedType
from ros2_kafka_bridge.ros.used_type import definitions
from ros2_kafka_bridge.threads.stop import Stop

_AT_ONCE: Final = 8  # the service of a node holds ten requests, and drops the rest
_PATIENCE_S: Final = 2.5
_ALL_S: Final = 5.0

TypeOrError = MessageType | BridgeError
"""A type, or why it cannot be loaded."""

ShownTypes = Mapping[tuple[str, str], TypeOrError]
"""ROS topic, type -> what is known of that type there."""


def load_all(loader: TypeLoader, wanted: Sequence[WantedType]) -> list[TypeOrError]:
    """Load types side by side: one that nobody describes takes seconds."""
    stop = Stop()

    def load(one: WantedType) -> TypeOrError:
        try:
            loaded = loader.load(one, stop)
        except BridgeError as error:
            return error
        assert loaded is not None, 'nobody looks at it after a stop'
        return loaded

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        try:
            return list(pool.map(load, wanted))
        finally:
            stop.ask()  # Ctrl-C waits for no node


def load_shown(node: RosNode, loader: TypeLoader, graph: Sequence[Topic]) -> ShownTypes:
    """Load the types of a graph that are not installed here, each definition once.

    The nodes at all topics are asked, and have 5 s together.

    Args:
        node: The bridge's own.
        loader: Knows what does not have to be asked for.
        graph: The topics.
    """
    peers = [peer for topic in graph for peer in _nodes(topic)]
    until_s = time.monotonic() + _ALL_S

    def ask(name: str, wanted_hash: str) -> DescribedTypes:
        left_s = until_s - time.monotonic()
        if left_s <= 0:
            raise RouteError('no time was left to ask for it: too many others get no answer')
        return ask_users(node, lambda: peers, name, wanted_hash, min(left_s, _PATIENCE_S))

    wanted: dict[tuple[str, str], WantedType] = {}
    for topic, name in _not_installed(graph):
        shown = definitions([peer for peer in _nodes(topic) if peer.message_type == name])
        wanted[topic.name, name] = WantedType(name, shown, ask)
    once = {one.place: one for one in wanted.values()}
    loaded = dict(zip(once, load_all(loader, [*once.values()]), strict=True))
    return {where: loaded[one.place] for where, one in wanted.items()}


def _nodes(topic: Topic) -> list[Peer]:
    """Who is there, without the bridges, which describe no type."""
    return [peer for peer in [*topic.publishers, *topic.subscribers] if not peer.is_bridge]


def _not_installed(graph: Sequence[Topic]) -> Iterator[tuple[Topic, str]]:
    installed = installed_names()
    return ((topic, name) for topic in graph for name in topic.types if name not in installed)
