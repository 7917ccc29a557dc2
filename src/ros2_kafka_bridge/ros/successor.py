"""Whether another bridge has begun to read a topic."""

import contextlib

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import RosNode, own_nodes


class Successor:
    """Another bridge of the same name that is to read a topic after this one.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
        bridge: Name of the bridge.
        own: What the gids of this process begin with; where that is not known, those who read
            when it was asked whether one is needed are no successors.
    """

    def __init__(self, node: RosNode, topic: str, bridge: str, own: bytes) -> None:
        self._node = node
        self._topic = topic
        self._names = own_nodes(bridge)
        self._own = own
        self._known: set[bytes] = set()

    def is_needed(self) -> bool:
        """Whether what is published while nobody reads would be lost."""
        with contextlib.suppress(BridgeError):
            if not self._own:
                self._known = self._readers()
            peers = self._node.publishers(self._topic)
            return any(peer.durability == 'volatile' for peer in peers)
        return False

    def has_come(self) -> bool:
        """Whether another bridge of this name reads."""
        with contextlib.suppress(BridgeError):
            readers = self._readers() - self._known
            return any(not self._own or not gid.startswith(self._own) for gid in readers)
        return False

    def _readers(self) -> set[bytes]:
        subscribers = self._node.subscribers(self._topic)
        return {peer.gid for peer in subscribers if self._names.fullmatch(peer.node)}
