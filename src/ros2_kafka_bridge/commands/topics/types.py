"""The types on the topics of a graph: where those are described that are not installed here."""

from collections.abc import Sequence

from ros2_kafka_bridge.commands.names import is_of_ros_itself
from ros2_kafka_bridge.config.settings import RosSettings
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import RosNode, Topic
from ros2_kafka_bridge.ros.shown_types import load_shown
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader, WantedType


class GraphTypes:
    """What is known of the types of a graph; its nodes are asked at once, when this is made.

    Args:
        node: The bridge's own.
        ros: As of a `TypeLoader`.
        graph: The topics. Of what ROS itself uses nobody is asked.
    """

    def __init__(self, node: RosNode, ros: RosSettings, graph: Sequence[Topic]) -> None:
        self._loader = TypeLoader(ros)
        users_own = [topic for topic in graph if not is_of_ros_itself(topic.name)]
        self._shown = load_shown(node, self._loader, users_own)

    def load(self, topic: str, name: str) -> MessageType | None:
        """Load a type as it is used on a topic; None where that is not possible."""
        if (topic, name) in self._shown:
            found = self._shown[topic, name]
            return None if isinstance(found, BridgeError) else found
        try:
            return self._loader.load(WantedType(name))
        except BridgeError:
            return None

    def origins(self, topic: Topic) -> dict[str, str]:
        """Where each type of a topic is described that is not installed here."""
        told = {name: self._shown.get((topic.name, name)) for name in topic.types}
        return {name: it.origin for name, it in told.items() if isinstance(it, MessageType)}

    def problems(self, topic: Topic) -> dict[str, str]:
        """Why a type of a topic is described nowhere."""
        told = {name: self._shown.get((topic.name, name)) for name in topic.types}
        return {name: str(it) for name, it in told.items() if isinstance(it, BridgeError)}
