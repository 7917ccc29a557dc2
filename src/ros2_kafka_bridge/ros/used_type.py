"""The types of routes: those that a file names, or that are shown by those who use the topic."""

import math
import time
from collections.abc import Callable, Collection
from functools import partial
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.message_types import INSTALLED
from ros2_kafka_bridge.message_types.description import DescribedTypes
from ros2_kafka_bridge.message_types.source import Ask, Definitions
from ros2_kafka_bridge.ros.discovery import (
    ANNOUNCED_S,
    waits_for_description,
    waits_for_type,
)
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.type_request import ask_users
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader, WantedType
from ros2_kafka_bridge.threads.stop import Stop

_LOOK_S: Final = 0.1


Say = Callable[[str], None]


class UsedType(NamedTuple):
    """A type that is used on a topic, and how it is defined there."""

    name: str
    definitions: Definitions


def _nobody(_: str) -> None:
    """Nobody is told."""


def wait_for_type(
    look: Callable[[], Collection[Peer]],
    topic: str,
    asked_to_stop: Callable[[float], bool],
    say: Callable[[], None] = lambda: None,
) -> UsedType | None:
    """Wait until the graph shows the type of a topic; None when asked to stop before.

    Args:
        look: Who counts, as far as discovery knows.
        topic: The ROS topic.
        asked_to_stop: Pauses for so many seconds.
        say: Called once, where that takes longer than discovery does.

    Raises:
        RouteError: Two types are used on the topic.
    """
    say_at_s, patient_until_s = time.monotonic() + ANNOUNCED_S, math.inf
    while True:
        peers = look()
        if peers:  # their nodes are named a moment later
            patient_until_s = min(patient_until_s, time.monotonic() + ANNOUNCED_S)
        types = sorted({peer.message_type for peer in peers})
        if len(types) > 1:
            raise RouteError(
                f'{topic} has two types, {" and ".join(types)}: write the one to bridge in '
                'from.type, or give one of the publishers another topic'
            )
        if types and (time.monotonic() >= patient_until_s or all(map(_is_known, peers))):
            return UsedType(types[0], definitions(peers))
        if not types and time.monotonic() >= say_at_s:
            say()
            say_at_s = math.inf
        if asked_to_stop(_LOOK_S):
            return UsedType(types[0], definitions(peers)) if types else None


def _is_known(peer: Peer) -> bool:
    """Whether the graph tells the node of it; of what is no node of ROS, it never does."""
    return peer.named or not peer.type_hash


def definitions(peers: Collection[Peer]) -> Definitions:
    """How those define their type who tell that; a bridge has it from others."""
    users: dict[str, list[str]] = {}
    for peer in peers:
        if peer.type_hash and not peer.is_bridge:
            users.setdefault(peer.type_hash, []).append(peer.node)
    return {told: ', '.join(sorted({*nodes})) for told, nodes in users.items()}


def users(node: RosNode, topic: str, name: str) -> list[Peer]:
    """Who uses a type on a topic, without the bridges, which describe none."""
    peers = [*node.publishers(topic), *node.subscribers(topic)]
    return [peer for peer in peers if peer.message_type == name and not peer.is_bridge]


def asks_users(node: RosNode, topic: str, others: Collection[str] = ()) -> Ask:
    """Make what asks the nodes at a topic for a type, and those at others, if there are any."""

    def ask(name: str, wanted_hash: str) -> DescribedTypes:
        def look() -> list[Peer]:
            return [peer for one in {topic, *others} for peer in users(node, one, name)]

        return ask_users(node, look, name, wanted_hash)

    return ask


class RosEnd(NamedTuple):
    """The end of a route that is in ROS, as far as its type goes.

    Args:
        topic: The ROS topic.
        said: The type that the file names; None takes the one that is published.
        publishes: Whether the route goes to ROS.
    """

    topic: str
    said: str | None = None
    publishes: bool = False

    @classmethod
    def of(cls, route: AnyRoute) -> Self:
        """That of a route."""
        publishes = route.direction is Direction.KAFKA_TO_ROS
        return cls(route.ros_topic, route.type_name, publishes)


class RouteTypes:
    """Finds and loads the types of routes, each in the thread of its route.

    Args:
        node: The bridge's own.
        ros: As of a `TypeLoader`.
    """

    def __init__(self, node: RosNode, ros: RosSettings) -> None:
        self.loader = TypeLoader(ros)
        self._node = node
        # By the type: routes of one type wait for one answer, of whoever uses it.
        self._topics: dict[str, set[str]] = {}

    def load(self, end: RosEnd, log: Log, stop: Stop, say: Say = _nobody) -> MessageType | None:
        """Load the type of a route; None where a stop came before it was known.

        Args:
            end: Of the route.
            log: Where to say who describes it.
            stop: Ends the waiting.
            say: Told once what is waited for, where that takes long.

        Raises:
            ConfigError, RouteError: As `TypeLoader.load`.
        """
        ask = partial(self._who_shows, end)
        with self._node.graph.watched(ask) as view:
            wanted = self.find(end, stop.wait, say, lambda: view.peers)
        if wanted is None:
            return None
        try:
            loaded = self.loader.load(wanted, stop)
        except ConfigError as error:
            if wanted.ask is None:
                raise
            # What others tell may be mended there, and is no mistake of the configuration.
            raise RouteError(str(error)) from error
        if loaded is not None:
            _say_origin(loaded, wanted.definitions, log)
        return loaded

    def find(
        self,
        end: RosEnd,
        asked_to_stop: Callable[[float], bool],
        say: Say = _nobody,
        look: Callable[[], Collection[Peer]] | None = None,
    ) -> WantedType | None:
        """Find which type a route has, and how it is defined; None when asked to stop before.

        Args:
            end: Of the route.
            asked_to_stop: Pauses for so many seconds.
            say: As of `load`.
            look: Who is there that tells it; None asks the graph each time.

        Raises:
            RouteError: Two types are used on the topic.
        """
        topic, said, _ = end
        problem = None if said is None else self.loader.unsettled(said)
        if said is not None and problem is None:
            return WantedType(said)
        look = look or partial(self._who_shows, end)
        used = wait_for_type(look, topic, asked_to_stop, lambda: say(waits_for(topic, problem)))
        if used is None:
            return None
        # Where bridges alone publish, those who subscribe may tell.
        shown = used.definitions or definitions(users(self._node, topic, used.name))
        topics = self._topics.setdefault(used.name, set())
        topics.add(topic)
        return WantedType(used.name, shown, asks_users(self._node, topic, topics))

    def _who_shows(self, end: RosEnd) -> list[Peer]:
        """Those by whose definition a route reads, or those for whose it publishes."""
        topic, said, publishes = end
        if said is None:
            return self._node.publishers(topic)
        publishers = [it for it in self._node.publishers(topic) if it.message_type == said]
        there = users(self._node, topic, said)
        subscribers = [peer for peer in there if peer not in publishers]
        own = [peer for peer in publishers if peer.is_bridge]
        others = [peer for peer in publishers if not peer.is_bridge]
        if publishes:
            return subscribers or others
        return others or (subscribers if own else [])


def waits_for(topic: str, problem: str | None) -> str:
    """What a route waits for that has no type yet.

    Args:
        topic: The ROS topic.
        problem: Why the type that the file names is not enough; None where it names none.
    """
    return waits_for_type(topic) if problem is None else waits_for_description(topic, problem)


def _say_origin(loaded: MessageType, definitions: Definitions, log: Log) -> None:
    if definitions and loaded.type_hash not in definitions:
        users = '; '.join(f'{it} by {users}' for it, users in sorted(definitions.items()))
        log.warning(
            '%s %s as %s, and is used there as %s, which nobody describes: messages of that are '
            'dead letters, but in format: cdr',
            loaded.name, loaded.origin, loaded.type_hash, users,
        )  # fmt: skip
    elif loaded.origin != INSTALLED:
        log.info('%s %s', loaded.name, loaded.origin)
