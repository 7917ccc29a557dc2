"""The message types of dead letters: what is known here, or what a node describes.

A node is opened for the first type that has to be asked for, and for no other letter.
"""

import re
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Final

from ros2_kafka_bridge.commands.dead_letters.definition import definition_of
from ros2_kafka_bridge.commands.screen import waiting
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.dead_letters.letter import Letter
from ros2_kafka_bridge.errors import BridgeError, RecordError, RouteError
from ros2_kafka_bridge.message_types.description import DescribedTypes, make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.source import CURE, NOT_SHOWN, Definitions, TypeSource
from ros2_kafka_bridge.outside.extras import missing_ros
from ros2_kafka_bridge.ros.discovery import ANNOUNCED_S
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, open_node
from ros2_kafka_bridge.ros.type_request import ask_users
from ros2_kafka_bridge.ros.type_support.choice import why_import
from ros2_kafka_bridge.ros.used_type import definitions, users

_DISCOVERY_S: Final = 2 * ANNOUNCED_S
_LOOK_S: Final = 0.1
_NAME: Final = re.compile(r'\w+/msg/\w+', re.ASCII)

JoinRos = Callable[[], RosNode]
"""Opens the node; the same one each time."""


def open_asking(config: Config) -> AbstractContextManager[RosNode]:
    """Join ROS with a node that asks others, and has no endpoints."""
    ros = config.ros
    return open_node(f'{config.name}_letters', ros.domain_id, Histories({}, {}, ros.lease_s))


def why_packages(config: Config, *, to_ros: bool) -> str:
    """Why types have the fields of their packages, whatever a folder or node says; or empty."""
    if config.ros.packages == 'import':
        return 'ros.packages is import'
    # What is published here has them, too, where this ROS takes no type without one.
    return why_import() if to_ros and missing_ros() is None else ''


class LetterTypes:
    """Finds the types of letters, each once.

    Args:
        config: With the routes.
        join: Opens the node that asks.
        why: As of `why_packages`.
    """

    def __init__(self, config: Config, join: JoinRos, why: str) -> None:
        self._source = TypeSource() if why else TypeSource.of(config.ros)
        self._why = why
        self._join = join
        self._until_s: float | None = None
        self._found: dict[tuple[str, str, str], Layout | RecordError] = {}

    def of_message(self, topic: str, name: str, letter: Letter) -> Layout:
        """The type of a letter that came from a ROS topic, as it was written, if that is known.

        Raises:
            RecordError: Nobody tells it: the letter stays one.
            ConfigError: What is known of it here cannot be read.
        """
        return self._once(topic, name, definition_of(letter))

    def on_topic(self, topic: str, name: str) -> Layout:
        """The type that a route publishes on a ROS topic.

        Raises:
            RecordError, ConfigError: As `of_message`.
        """
        return self._once(topic, name, NOT_SHOWN)

    def _once(self, topic: str, name: str, wanted: Definitions) -> Layout:
        place = topic, name, ''.join(wanted)
        if place not in self._found:
            try:
                self._found[place] = self._layout(topic, name, wanted)
            except RecordError as error:
                self._found[place] = error
        found = self._found[place]
        if isinstance(found, RecordError):
            raise found
        return found

    def _layout(self, topic: str, name: str, wanted: Definitions) -> Layout:
        problem = self._source.unsettled(name)
        if problem and not _NAME.fullmatch(name):
            raise RecordError(problem)
        ask = None if self._why else partial(self._ask, topic)
        if problem is None:
            return make_layout(name, self._source.describe(name, wanted, ask))
        if ask is None:
            raise RecordError(f'{problem}: install its package ({self._why})')
        try:
            there = wanted or self._there(topic, name, wanted)
            return make_layout(name, self._source.describe(name, there, ask))
        except BridgeError as error:
            if self._source.unknown(name) is None:  # in two versions, and nobody tells which
                return make_layout(name, self._source.describe(name))
            raise _not_told(name, problem, str(error)) from error

    def _ask(self, topic: str, name: str, wanted: str) -> DescribedTypes:
        if wanted not in self._there(topic, name, {wanted: ''}):
            raise RouteError(f'no node at {topic} uses {name} {wanted}: {CURE}')
        node = self._node()
        return ask_users(node, partial(users, node, topic, name), name, wanted)

    def _there(self, topic: str, name: str, wanted: Mapping[str, str]) -> Definitions:
        """How the nodes at a topic define a type, once there is a wanted one, or any."""
        node = self._node()
        with waiting(f'Looking for who uses {topic}, to ask for {name}'):
            if self._until_s is None:
                self._until_s = time.monotonic() + _DISCOVERY_S
            while True:
                found = definitions(users(node, topic, name))
                if found.keys() & wanted.keys() or (found and not wanted):
                    return found
                if time.monotonic() >= self._until_s:
                    return found
                time.sleep(_LOOK_S)

    def _node(self) -> RosNode:
        try:
            return self._join()
        except BridgeError as error:  # ROS may not be here: what is known without it counts
            raise RouteError(f'{error}; {CURE}') from error


def _not_told(name: str, problem: str, why: str) -> RecordError:
    told = why if why.startswith(problem) else f'{problem}, and {why}'
    return RecordError(
        f'{told}; ros2-kafka-bridge schema {name} --from-graph --format msg --output DIR writes '
        'them while a node runs that describes it'
    )
