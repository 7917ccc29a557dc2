"""Whether another bridge has begun to read a topic."""

import contextlib

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import RosNode


class Successor:
    """Another bridge that is to read a topic after this one.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
    """

    def __init__(self, node: RosNode, topic: str) -> None:
        self._node = node
        self._topic = topic
        self._known: set[bytes] = set()

    def is_needed(self) -> bool:
        """Whether what is published while nobody reads would be lost; notes who reads now."""
        with contextlib.suppress(BridgeError):
            self._known = self._readers()
            peers = self._node.publishers(self._topic)
            return any(peer.durability == 'volatile' for peer in peers)
        return False

    def has_come(self) -> bool:
        """Whether a bridge reads that did not when it was asked whether one is needed."""
        with contextlib.suppress(BridgeError):
            return bool(self._readers() - self._known)
        return False

    def _readers(self) -> set[bytes]:
        return {peer.gid for peer in self._node.subscribers(self._topic) if peer.is_bridge}
