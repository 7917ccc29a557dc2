"""A message type as the nodes of the ROS graph use it: one of them is asked to describe it."""

from typing import Final, NamedTuple

from ros2_kafka_bridge.commands.screen import wait_for_discovery, waiting
from ros2_kafka_bridge.config.settings import RosSettings
from ros2_kafka_bridge.dead_letters.shown import shortened
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.message_types.description import DescribedTypes, type_hash
from ros2_kafka_bridge.message_types.source import CURE, Definitions, TypeSource
from ros2_kafka_bridge.ros.discovery import hint
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, domain_in_words, open_node
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.type_request import LookAtUsers, ask_users
from ros2_kafka_bridge.ros.used_type import definitions, users, wait_for_type

_MOST_SHOWN: Final = 200


class TypeThere(NamedTuple):
    """A type as the graph has it.

    Args:
        name: As `tf2_msgs/msg/TFMessage`.
        described: By one definition that is used there.
        said: Where that is from, in a line.
    """

    name: str
    described: DescribedTypes
    said: str


def type_there(ros: RosSettings, source: TypeSource, name: str, topic: str) -> TypeThere:
    """A type by the definition that is used in the graph.

    Args:
        ros: With the domain.
        source: What is known here: it comes first where it is the same.
        name: Of the type; empty for the one that is published on the topic.
        topic: Where it is used; empty looks at all topics.

    Raises:
        ConfigError: ROS is not here.
        RouteError: Nobody uses the type, or nobody tells how it is defined.
    """
    keep_clients_quiet()
    with open_node('schema', ros.domain_id, Histories({}, {}, ros.lease_s)) as node:
        wait_for_discovery()
        name = name or _published(node, topic, ros)
        topics = [topic] if topic else _topics_of(node, name)

        def look() -> list[Peer]:
            return [peer for one in topics for peer in users(node, one, name)]

        peers = look()
        if not peers:
            where = f' on {topic}' if topic else ''
            raise RouteError(_nobody(f'uses {name}{where}', ros))
        return _told(name, source, definitions(peers), _Asked(node, look))


def _nobody(does: str, ros: RosSettings) -> str:
    seen = f'no node is seen in ROS {domain_in_words(ros.domain_id)} that {does}'
    return f'{seen}: {hint()}'


def _published(node: RosNode, topic: str, ros: RosSettings) -> str:
    used = wait_for_type(lambda: node.publishers(topic), topic, lambda _: True)
    if used is None:
        raise RouteError(_nobody(f'publishes on {topic}', ros))
    return used.name


def _topics_of(node: RosNode, name: str) -> list[str]:
    return [topic.name for topic in node.topics() if name in topic.types]


class _Asked:
    """Asks the users of a type, and keeps what came of it."""

    def __init__(self, node: RosNode, look: LookAtUsers) -> None:
        self.told: DescribedTypes | None = None
        self.error: RouteError | None = None
        self._node = node
        self._look = look

    def __call__(self, name: str, wanted: str) -> DescribedTypes:
        try:
            with waiting(f'Asking who uses {name}'):
                self.told = ask_users(self._node, self._look, name, wanted)
        except RouteError as error:
            self.error = error
            raise
        return self.told


def _told(name: str, source: TypeSource, there: Definitions, ask: _Asked) -> TypeThere:
    described = source.describe(name, there, ask)
    if described is ask.told:
        return TypeThere(name, described, f'{name} {described.origin}')
    if not there:
        said = 'those who use it do not tell how it is defined there'
        return TypeThere(name, described, f'{name} {described.origin}; {said}')
    found = type_hash(name, described.types)
    if found not in there:  # a route takes what is known here, where nobody tells
        raise RouteError(
            f'{name} {described.origin} otherwise than nodes use it ({_in_words(there)}): '
            f'{ask.error or CURE}'
        )
    others = {one: who for one, who in there.items() if one != found}
    said = f'{name} {described.origin}, as {shortened(there[found], _MOST_SHOWN)} has it'
    return TypeThere(name, described, said + f'; not so {_in_words(others)}' * bool(others))


def _in_words(there: Definitions) -> str:
    found = (f'{one} by {shortened(who, _MOST_SHOWN)}' for one, who in sorted(there.items()))
    return '; '.join(found)
