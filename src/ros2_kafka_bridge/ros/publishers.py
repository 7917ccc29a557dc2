"""Who publishes on a topic, and what each of them offers, as far as the ROS graph tells."""

import time
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from ros2_kafka_bridge.endpoints import Matches, Offer
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.topic_end import TopicEnd

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.graph import View

_ASK_S = 0.02
_MOST_HASHES = 1000


class Publishers:
    """The publishers of one topic: what they offer, and who of them cannot be read.

    Args:
        end: What the route has at the topic; what its QoS fixes is not followed.
    """

    def __init__(self, end: TopicEnd) -> None:
        self.matches = Matches()
        self.offers: Mapping[bytes, Offer] = {}
        self._end = end
        self._view: View | None = None
        self._hashes: dict[bytes, str] = {}
        self._asked_at_s = 0.0
        self._mismatched: set[bytes] = set()
        self._strangers: set[tuple[str, str]] = set()  # of those in the graph
        self._occasional = summed(end.log)

    def open(self) -> None:
        """Begin to follow them."""
        self._view = self._end.watch_publishers()

    def close(self) -> None:
        """Follow them no more."""
        self._end.forget(self._view)
        self._view = None

    @property
    def have_changed(self) -> bool:
        """Whether the graph has told of a change since the last look that did not ask."""
        return self._view is not None and self._view.has_news

    def look(self, *, ask: bool = False) -> Mapping[bytes, Offer]:
        """What each publisher of the right type offers, by its gid.

        Args:
            ask: Whether to ask the graph now; else what it has told of itself counts.

        Raises:
            BridgeError: The graph cannot be asked; what it told last stays.
        """
        view = self._view
        assert view is not None, 'it is open'
        if ask:
            view.look()
        # Who asks in between has not followed them yet.
        peers = view.peers if ask else view.read()
        if len(self._hashes) > _MOST_HASHES:
            self._forget_all_but({peer.gid for peer in peers})
        self._say_other_types(peers)
        self._say_mismatches(peers)
        # Those that have gone stay: what they sent may still be in line.
        self._hashes |= {peer.gid: peer.type_hash for peer in peers}
        right = [peer for peer in peers if peer.message_type == self._end.message_type.name]
        matched = sum(peer.gid not in self._mismatched for peer in right)
        self.matches = Matches(matched, len(peers) - matched)
        self.offers = {
            peer.gid: self.followed(Offer(peer.reliability, peer.durability)) for peer in right
        }
        return self.offers

    def type_hash(self, gid: bytes) -> str | None:
        """REP-2011 hash of what a publisher sends; that of the type here if it is not told.

        None where the graph does not show the publisher (yet): ask again.

        Raises:
            BridgeError: The graph cannot be asked.
        """
        if gid and gid not in self._hashes and time.monotonic() >= self._asked_at_s + _ASK_S:
            self._asked_at_s = time.monotonic()
            self.look(ask=True)
        if gid and gid not in self._hashes:
            return None
        return self._hashes.get(gid) or self._end.message_type.type_hash or ''

    def followed(self, offer: Offer) -> Offer:
        """What is asked of those who offer that: what the route fixes is not followed."""
        fixed = self._end.qos
        return Offer(fixed.reliability or offer.reliability, fixed.durability or offer.durability)

    def _forget_all_but(self, here: set[bytes]) -> None:
        self._hashes = {gid: known for gid, known in self._hashes.items() if gid in here}
        self._mismatched &= here

    def _say_mismatches(self, peers: Collection[Peer]) -> None:
        for peer in peers:
            if peer.gid in self._hashes:
                continue
            reason = mismatch(peer.qos, profile(self._end.qos, peer.reliability, peer.durability))
            if reason:
                self._mismatched.add(peer.gid)
                self._occasional.error(
                    f'{peer.node} on {self._end.topic} does not match the qos of this route, '
                    f'leave it out to follow the publishers: {reason}'
                )

    def _say_other_types(self, peers: Collection[Peer]) -> None:
        name = self._end.message_type.name
        self._strangers &= {(peer.node, peer.message_type) for peer in peers}
        for peer in peers:
            stranger = (peer.node, peer.message_type)
            if peer.message_type == name or not peer.named or stranger in self._strangers:
                continue
            self._strangers.add(stranger)
            self._occasional.error(
                f'{peer.node} publishes {peer.message_type} on {self._end.topic}, this route '
                f'reads {name}: the messages of that node cannot be read; give one of the two '
                'another topic'
            )
