"""Who subscribes to a topic, as far as the ROS graph tells, and who gets nothing, or misreads."""

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, Final

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.ros.node import is_fastdds
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.topic_end import TopicEnd

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.graph import View

_NO_NODE: Final = 'a reader that is no ROS node'
_FASTDDS: Final = b'\x01\x0f'  # a GUID begins with its vendor (RTPS 2.5, 9.3.1.5)
_SAME_VERSION: Final = 'install the same version of the package on both sides'


class Subscribers:
    """The subscribers of one topic, as the graph tells of them.

    Args:
        end: What the route has at the topic.
    """

    def __init__(self, end: TopicEnd) -> None:
        self.mismatched = 0
        self.alike = 0.0  # as many that match are known to be of the bridge's own vendor
        self.misread = ''  # who would misread what is published, and the cure
        self.reliable: Sequence[str] = ()  # nodes that acknowledge what they get
        self._end = end
        self._occasional = summed(end.log)
        self._told: set[tuple[str, str]] = set()  # of those in the graph
        self._view: View | None = None
        self._come_known = 0  # by the last look that told who

    def open(self) -> None:
        """Begin to follow them."""
        self._view = self._end.watch_subscribers()

    def close(self) -> None:
        """Follow them no more."""
        self._end.forget(self._view)
        self._view = None

    def look(self, come: int, *, ask: bool) -> None:
        """Look who they are, if that has changed, and say who gets nothing, or misreads.

        Args:
            come: How many have come by now.
            ask: Whether to ask the graph now: one has come or gone.
        """
        view = self._view
        assert view is not None, 'it is open'
        if ask:
            view.look()
        elif not view.has_news:
            return
        try:
            peers = view.read()
        except BridgeError as error:
            # Of those who have come since the last look that could be, nothing is known.
            if come != self._come_known and self._end.message_type.type_hash:
                self.misread = f'perhaps a subscriber would misread: {error}'
            self.reliable = ()  # whether one of them acknowledges is not known, either
            self.alike = _alike(())
            self._occasional.warning(f'{error}')
        else:
            self._come_known = come
            self._note(peers)

    def _note(self, peers: Collection[Peer]) -> None:
        here = {peer.node for peer in peers}
        self._told = {(node, what) for node, what in self._told if node in here}
        offered = profile(self._end.qos)
        matching = [peer for peer in peers if self._matches(peer, offered)]
        self.mismatched = len(peers) - len(matching)
        self.alike = _alike(matching)
        who = ', '.join(sorted({peer.node for peer in matching if self._misreads(peer)}))
        kind = self._end.message_type.name
        self.misread = f'{who} would misread {kind}: {_SAME_VERSION}' if who else ''
        waited_for = [peer for peer in matching if peer.reliability != 'best_effort']
        self.reliable = sorted({peer.node if peer.named else _NO_NODE for peer in waited_for})

    def _matches(self, peer: Peer, offered: Any) -> bool:
        """Whether it gets what is published; what is wrong with it is said."""
        here = self._end.message_type
        if peer.message_type != here.name:
            self._tell(peer, f'subscribes to it as {peer.message_type}: no match')
            return False
        if reason := mismatch(offered, peer.qos):
            self._tell(peer, f'does not match, give this route the qos it asks for: {reason}')
            return False
        if self._misreads(peer):
            kind = f'{here.name} {peer.type_hash}, this route publishes {here.type_hash}'
            self._tell(peer, f'subscribes to it as {kind}: {_SAME_VERSION}')
        if peer.reliability == 'best_effort':
            self._tell(peer, 'reads best effort: nothing tells what it has received')
        return True

    def _misreads(self, peer: Peer) -> bool:
        here = self._end.message_type
        return peer.misreads(here.name, here.type_hash)

    def _tell(self, peer: Peer, what: str) -> None:
        if peer.named and (peer.node, what) not in self._told:
            self._told.add((peer.node, what))
            self._occasional.warning(f'{self._end.topic}: {peer.node} {what}')


def _alike(matching: Sequence[Peer]) -> float:
    """How many are of the bridge's own vendor: less than none where one is not.

    Other middlewares than Fast DDS tell no vendor.
    """
    if not is_fastdds():
        return math.inf
    return len(matching) if all(peer.gid.startswith(_FASTDDS) for peer in matching) else -1
