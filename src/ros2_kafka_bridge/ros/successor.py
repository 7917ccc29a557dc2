"""Whether another bridge has begun to read a topic."""

import contextlib

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import RosNode, own_nodes


class SuccessorWatch:
    """Another bridge of the same name that is to read a topic after this one.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
        bridge: Name of the bridge.
        own: What the gids of this process begin with; empty where that is not known.
    """

    def __init__(self, node: RosNode, topic: str, bridge: str, own: bytes) -> None:
        self._node = node
        self._topic = topic
        self._names = own_nodes(bridge)
        self._own = own
        self._known: set[bytes] = set()

    def note_readers(self, *, may_read: bool) -> None:
        """Note who reads now: another one has come where one reads that is not noted.

        Args:
            may_read: Whether the successor may be one of them already.
        """
        with contextlib.suppress(BridgeError):
            self._known = self._readers()
            if may_read and self._own:
                self._known = set()

    def is_needed(self) -> bool:
        """Whether what is published while nobody reads would be lost."""
        with contextlib.suppress(BridgeError):
            peers = self._node.publishers(self._topic)
            return any(peer.durability == 'volatile' for peer in peers)
        return True  # nobody can tell

    def has_come(self) -> bool:
        """Whether a bridge of this name reads that was not known then."""
        with contextlib.suppress(BridgeError):
            return any(not self._is_own(gid) for gid in self._readers() - self._known)
        return False

    def _is_own(self, gid: bytes) -> bool:
        """Whether it is of this process, where a reader may open at any time, too."""
        return bool(self._own) and gid.startswith(self._own)

    def _readers(self) -> set[bytes]:
        subscribers = self._node.subscribers(self._topic)
        return {peer.gid for peer in subscribers if self._names.fullmatch(peer.node)}
