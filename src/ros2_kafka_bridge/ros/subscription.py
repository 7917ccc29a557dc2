"""Taking from ROS: subscriptions that follow the publishers of a topic."""

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.endpoints import Matches, Message, Offer
from ros2_kafka_bridge.errors import BridgeError, TransportError, blamed
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.ros.errors import left_behind, translated
from ros2_kafka_bridge.ros.node import Peer, RosNode, is_of_a_stranger
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.second_channel import unheard
from ros2_kafka_bridge.ros.sequences import Sequences
from ros2_kafka_bridge.ros.types import MessageType

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.take import Taken

_GRAPH_S = 0.1
_ASK_S = 0.02
_MOST_HASHES = 1000
# Asking holds the thread of the route for seconds where Kafka is away: most of the time is for
# taking from the other publishers. Where there are none, one more try holds up nothing, and what
# a publisher's history holds runs out.
_POSTPONED_S = 10.0
_POSTPONED_ALONE_S = 1.0


DEFAULT = Offer('reliable', 'volatile')


class RosSource:
    """A `MessageSource` on a real topic: one subscription for each QoS that is offered.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
        message_type: What is read.
        qos: What the route says about QoS; what it fixes is not followed.
        has_gid: Whether the middleware tells the publisher of a message.
        on_offer: Called before a subscription of a new offer is made.
        log: Where to say what happens.
    """

    def __init__(
        self,
        node: RosNode,
        topic: str,
        message_type: MessageType,
        qos: QoS,
        log: logging.LoggerAdapter[logging.Logger],
        *,
        has_gid: bool = True,
        on_offer: Callable[[Offer], None] = lambda _: None,
    ) -> None:
        self._node = node
        self._topic = topic
        self._message_type = message_type
        self._qos = qos
        self._log = log
        self._has_gid = has_gid
        self._on_offer = on_offer
        self._read = _told if has_gid else _untold
        self._sequences = Sequences(log, topic, self._offers)
        self._subscriptions: dict[Offer, Any] = {}
        self._hashes: dict[bytes, str] = {}
        self._known: dict[bytes, Offer] = {}  # as the graph has told it last
        self._closing: set[Offer] = set()  # subscriptions that nobody offers to any more
        self._emptied: set[Offer] = set()  # those that the last take left empty
        self._postponed: dict[Offer, float] = {}  # since when
        self._failing: set[Offer] = set()  # subscriptions whose last take has failed
        self._failure: Exception | None = None  # told at the next take: first, what was taken
        self._unread: list[tuple[Offer, list[Taken]]] = []  # taken, behind an unknown publisher
        self.exhausted = False
        self._waiter: Any = None
        self._take: Any = None
        self._graph_at_s = 0.0
        self._asked_at_s = 0.0
        self._mismatched: set[bytes] = set()  # of those in the graph
        self.matches = Matches()
        self._strangers: set[tuple[str, str]] = set()  # of those in the graph
        self._occasional = summed(log)

    @property
    def lost_upstream(self) -> int:
        """Messages lost before the bridge could take them, by the gaps in their numbers."""
        return self._sequences.lost

    def open(self) -> None:
        """Subscribe to what is offered now, or with the default QoS while nothing is.

        Raises:
            RouteError: ROS refuses the subscription.
        """
        from ros2_kafka_bridge.ros import take  # noqa: PLC0415 (heavy)

        self._take = take.take
        self._waiter = take.Waiter(self._node.context)
        if may_miss := unheard(self._message_type.layout):
            self._occasional.warning(may_miss)
        self.follow()

    def look(self) -> None:
        """Follow the publishers, if it is time for that."""
        if time.monotonic() >= self._graph_at_s:
            self.follow()

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Wait up to `timeout_s` for messages, then take at most `limit`.

        Raises:
            RouteError: ROS has failed; what was taken before that was returned.
        """
        self.look()
        with translated(f'subscription of {self._topic}'):
            self._raise_failure()
            messages = self._take_all(limit)
            if not messages:
                self._raise_failure()
            if not messages and self.exhausted and timeout_s > 0:
                self._wait(timeout_s)
                messages = self._take_all(limit)
        return messages

    def close(self) -> None:
        """Destroy the subscriptions."""
        while self._subscriptions:
            self._destroy(self._subscriptions.popitem()[1])
        self._failure = None
        self._failing.clear()
        self._unread.clear()

    def type_hash(self, gid: bytes) -> str | None:
        """REP-2011 hash of what a publisher sends; that of the type here if it is not told.

        None where the graph does not show the publisher (yet): ask again.
        """
        if gid and gid not in self._hashes and time.monotonic() >= self._asked_at_s + _ASK_S:
            self._asked_at_s = time.monotonic()
            self._ask_for_hashes()
        if gid and gid not in self._hashes:
            return None
        return self._hashes.get(gid) or self._message_type.type_hash or ''

    def follow(self) -> None:
        """Look at the graph and subscribe to what is offered."""
        now_s = time.monotonic()
        self._graph_at_s = now_s + _GRAPH_S
        try:
            offers = self._known = self._offers()
        except BridgeError as error:
            if not is_of_a_stranger(error):
                raise
            # Who was there is taken from all the same.
            self._occasional.error(f'{error}: new publishers of {self._topic} are not followed')
            offers = self._known
        self._sequences.offers(offers)
        wanted = self._wanted(set(offers.values()))
        # The new one opens before the old one closes: nothing falls between them, but where Kafka
        # has to be asked first.
        others = wanted & self._subscriptions.keys()
        wait_s = _POSTPONED_S if others else _POSTPONED_ALONE_S
        for offer in sorted(wanted - self._subscriptions.keys()):
            if now_s >= self._postponed.get(offer, -math.inf) + wait_s:
                self._subscribe(offer)
        self._close_unwanted(wanted)

    def _offers(self) -> dict[bytes, Offer]:
        """What each publisher of the right type offers, as far as the graph knows."""
        peers = self._node.publishers(self._topic)
        self._say_other_types(peers)
        self._say_mismatches(peers)
        if len(self._hashes) > _MOST_HASHES:
            self._hashes.clear()
        # Those that have gone stay: what they sent may still be in line.
        self._hashes |= {peer.gid: peer.type_hash for peer in peers}
        right = [peer for peer in peers if peer.message_type == self._message_type.name]
        matched = sum(peer.gid not in self._mismatched for peer in right)
        self.matches = Matches(matched, len(peers) - matched)
        return {peer.gid: self._offer(peer) for peer in right}

    def _ask_for_hashes(self) -> None:
        """Look at the graph in the middle of a batch, where no message may be lost for it."""
        try:
            self._offers()
        except BridgeError as error:
            self._failure = error

    def _close_unwanted(self, wanted: set[Offer]) -> None:
        """Close what was found empty after its last publisher had gone."""
        closing = self._subscriptions.keys() - wanted
        for offer in closing & self._closing & self._emptied:
            self._destroy(self._subscriptions.pop(offer))
        self._closing = closing
        self._emptied.clear()

    def _destroy(self, subscription: Any) -> None:
        lock = self._node.endpoint_lock
        with left_behind(self._log, f'subscription of {self._topic}'), lock:
            self._node.handle.destroy_subscription(subscription)

    def _offer(self, peer: Peer) -> Offer:
        return Offer(
            self._qos.reliability or peer.reliability, self._qos.durability or peer.durability
        )

    def _wanted(self, offers: set[Offer]) -> set[Offer]:
        if not offers:
            fixed = Offer(
                self._qos.reliability or DEFAULT.reliability,
                self._qos.durability or DEFAULT.durability,
            )
            # A topic without publishers keeps what it has: they may come back.
            return set(self._subscriptions) or {fixed}
        if self._has_gid:
            return offers
        # Without the publisher of a message, two subscriptions could not be told apart.
        weakest = Offer(min(o.reliability for o in offers), max(o.durability for o in offers))
        return {weakest}

    def _subscribe(self, offer: Offer) -> None:
        from rclpy.event_handler import SubscriptionEventCallbacks  # noqa: PLC0415 (heavy)

        try:
            self._on_offer(offer)
        except TransportError as error:
            # The others are taken meanwhile; this one keeps its history.
            self._postponed[offer] = time.monotonic()
            self._log.warning('%s, so %s (%s, %s) is read later', error, self._topic, *offer)
            return
        where = f'subscription of {self._topic}'
        lock = self._node.endpoint_lock
        with blamed(f'{where} as {self._message_type.name}'), translated(where), lock:
            self._subscriptions[offer] = self._node.handle.create_subscription(
                self._message_type.endpoint_class,
                self._topic,
                lambda _: None,
                profile(self._qos, *offer),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )
        self._log.info('subscribes to %s (%s, %s)', self._topic, *offer)

    def _wait(self, timeout_s: float) -> None:
        if not self._subscriptions:
            time.sleep(timeout_s)
            return
        try:
            self._waiter.wait(list(self._subscriptions.values()), timeout_s)
        except Exception:
            self._waiter.begin_anew()
            raise

    def _take_all(self, limit: int) -> list[Message]:
        messages: list[Message] = []
        share = max(1, limit // max(1, len(self._subscriptions)))
        self.exhausted = True
        unread, self._unread = self._unread, []
        for offer, taken in unread:
            self._select(taken, offer, messages)
        if self._unread:  # nothing may overtake it
            return messages
        for offer, subscription in list(self._subscriptions.items()):
            try:
                taken, is_empty = self._take(subscription, share)
            except Exception as error:  # noqa: BLE001 (raised by the next take)
                self._emptied.discard(offer)
                self.exhausted = False
                self._fail(offer, error)
                continue
            self._failing.discard(offer)
            if is_empty:
                self._emptied.add(offer)
            else:
                self._emptied.discard(offer)
                self.exhausted = False
            self._select(taken, offer, messages)
        return messages

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _fail(self, offer: Offer, error: Exception) -> None:
        """Keep an error of a subscription; one that fails again and again is made anew."""
        self._failure = error
        if offer not in self._failing:
            self._failing.add(offer)
            return
        self._failing.discard(offer)
        self._log.error('%s (%s, %s) cannot be read: subscribes anew', self._topic, *offer)
        before = self._subscriptions[offer]
        try:
            self._subscribe(offer)  # first: nobody would hold the publishers back in between
        except BridgeError as another:
            self._log.error('%s', another)
        if self._subscriptions[offer] is not before:
            self._sequences.expect_loss(offer)
            self._destroy(before)

    def _select(self, taken: list['Taken'], offer: Offer, messages: list[Message]) -> None:
        """Keep what counts; what stands behind a publisher that nobody can tell of now waits."""
        read, accept = self._read, self._sequences.accept
        number = 0
        try:
            for number, (cdr, info) in enumerate(taken):  # noqa: B007 (read where one fails)
                message = read(cdr, info)
                if not message.gid or accept(message.gid, message.seq, offer):
                    messages.append(message)
        except BridgeError as error:
            self._failure = error
            self._unread.append((offer, taken[number:]))
            self.exhausted = False

    def _say_mismatches(self, peers: list[Peer]) -> None:
        self._mismatched &= {peer.gid for peer in peers}
        for peer in peers:
            if peer.gid in self._hashes:
                continue
            reason = mismatch(peer.qos, profile(self._qos, *self._offer(peer)))
            if reason:
                self._mismatched.add(peer.gid)
                self._occasional.error(
                    f'{peer.node} on {self._topic} does not match the qos of this route, leave '
                    f'it out to follow the publishers: {reason}'
                )

    def _say_other_types(self, peers: list[Peer]) -> None:
        self._strangers &= {(peer.node, peer.message_type) for peer in peers}
        for peer in peers:
            stranger = (peer.node, peer.message_type)
            if peer.message_type == self._message_type.name or not peer.named:
                continue
            if stranger not in self._strangers:
                self._strangers.add(stranger)
                self._occasional.error(
                    f'{peer.node} publishes {peer.message_type} on {self._topic}, this route '
                    f'reads {self._message_type.name}: the messages of that node cannot be '
                    'read; give one of the two another topic'
                )


def _told(cdr: bytes, info: Mapping[str, Any]) -> Message:
    return Message(
        cdr,
        info['publisher_gid']['data'],
        info['publication_sequence_number'],
        info['source_timestamp'],
    )


def _untold(cdr: bytes, info: Mapping[str, Any]) -> Message:
    """Read a message of a ROS that does not tell its publisher, and perhaps not its number."""
    seq = info.get('publication_sequence_number') or 0
    return Message(cdr, b'', seq, info['source_timestamp'])
