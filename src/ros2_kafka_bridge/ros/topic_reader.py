"""Taking from one topic of ROS: subscriptions that follow its publishers."""

import contextlib
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from ros2_kafka_bridge.endpoints import Matches, Message, Offer
from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.node import is_of_a_stranger
from ros2_kafka_bridge.ros.publishers import Publishers
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.second_channel import unheard
from ros2_kafka_bridge.ros.sequences import Sequences
from ros2_kafka_bridge.ros.topic_end import TopicEnd

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.rcl import Take

DEFAULT: Final = Offer('reliable', 'volatile')
_AGAIN_S: Final = 0.1
_JUST_NOW_S: Final = 0.01
# Asking holds the thread of the route for seconds where Kafka is away: most of the time is for
# taking from the other publishers. Where there are none, one more try holds up nothing, and what
# a publisher's history holds runs out.
_POSTPONED_S: Final = 10.0
_POSTPONED_ALONE_S: Final = 1.0


@dataclass(slots=True)
class _Subscription:
    """One subscription of the topic, with the QoS of one offer.

    Args:
        handle: That of rclpy.
        take: Takes at most so many of it, and tells whether nothing is left behind them.
        is_unwanted: Whether nobody has offered this at the last look.
        is_empty: Whether the last take since that look has left nothing behind.
        has_failed: Whether the last take has.
        rings: Whether it rings for what comes.
    """

    handle: Any
    take: 'Take'
    is_unwanted: bool = False
    is_empty: bool = False
    has_failed: bool = False
    rings: bool = True


class TopicReader:
    """Reads one topic: one subscription for each QoS that is offered.

    Args:
        end: What the route has at the topic; what its QoS fixes is not followed.
        arrivals: Where it is told that messages have come.
        has_gid: Whether the middleware tells the publisher of a message.
        by_rcl: Whether messages may be taken by rcl itself.
        take_bytes: With how much a take of one subscription ends.
        on_offer: Called before a subscription of a new offer is made.
    """

    def __init__(
        self,
        end: TopicEnd,
        arrivals: Arrivals,
        *,
        has_gid: bool = True,
        by_rcl: bool = False,
        take_bytes: int = sys.maxsize,
        on_offer: Callable[[Offer], None] = lambda _: None,
    ) -> None:
        self.exhausted = False  # whether the last take has found nothing more to take
        self._end = end
        self._notifier = arrivals.of(end.topic)
        self._occasional = summed(end.log)
        self._has_gid = has_gid
        self._by_rcl = by_rcl
        self._take_bytes = take_bytes
        self._on_offer = on_offer
        # News of the graph ring as messages do: both are for the next take.
        self._publishers = Publishers(end._replace(interrupt=self._notifier.wakeup.ring))
        self._sequences = Sequences(end.log, end.topic, self._learn)
        self._subscriptions: dict[Offer, _Subscription] = {}
        self._postponed: dict[Offer, float] = {}  # since when
        self._unread: list[tuple[Offer, list[Message]]] = []  # taken, behind an unknown publisher
        self._failure: Exception | None = None  # told at the next take: first, what was taken
        self._look_at_s = 0.0

    @property
    def lost_upstream(self) -> int:
        """Messages lost before the bridge could take them, by the gaps in their numbers."""
        return self._sequences.lost

    @property
    def matches(self) -> Matches:
        """Its publishers, as far as the graph knows."""
        return self._publishers.matches

    def open(self) -> None:
        """Subscribe to what is offered now, or with the default QoS while nothing is.

        Raises:
            RouteError: ROS refuses the subscription.
        """
        if may_miss := unheard(self._end.message_type.layout):
            self._occasional.warning(may_miss)
        self._publishers.open()
        self.follow()

    def close(self) -> None:
        """Destroy the subscriptions."""
        while self._subscriptions:
            self._unsubscribe(self._subscriptions.popitem()[1])
        self._publishers.close()
        self._failure = None
        self._unread.clear()

    def type_hash(self, gid: bytes) -> str | None:
        """REP-2011 hash of what a publisher sends; None where the graph does not show it (yet).

        Asked in the midst of a batch, where no message may be lost for it: what keeps it from
        asking, the next look tells.
        """
        with contextlib.suppress(BridgeError):
            return self._publishers.type_hash(gid)
        return None

    # Following the publishers

    def look(self) -> None:
        """Follow the publishers, if they have changed or something waits for another look.

        Raises:
            RouteError: ROS refuses a subscription, or to tell who publishes.
        """
        if self._publishers.have_changed or time.monotonic() >= self._look_at_s:
            self.follow()

    def follow(self) -> None:
        """Subscribe to what is offered."""
        self._look_at_s = time.monotonic() + _AGAIN_S  # where something of this fails, too
        offers = self._offers()
        wanted = self._wanted(set(offers.values()))
        # The new one opens before the old one closes: nothing falls between them, but where Kafka
        # has to be asked first.
        self._open_wanted(wanted)
        self._sequences.offers(offers)  # now: what Kafka has of them is known, or cannot be
        self._close_unwanted(wanted)
        if wanted == self._subscriptions.keys():
            self._look_at_s = math.inf
        else:
            self._notifier.look_again(_AGAIN_S)

    def _learn(self) -> Mapping[bytes, Offer]:
        """Look who publishes, as a message of an unknown one is taken: in the midst of a batch.

        What is in Kafka already is looked for before it counts: another vendor than Fast DDS
        sends the history of a TRANSIENT_LOCAL publisher to a VOLATILE subscription, too.
        """
        offers = self._publishers.look(ask=True)
        self._open_wanted(self._wanted(set(offers.values())))
        return offers

    def _offers(self) -> Mapping[bytes, Offer]:
        try:
            return self._publishers.look()
        except BridgeError as error:
            if not is_of_a_stranger(error):
                raise
            # Who was there is taken from all the same.
            topic = self._end.topic
            self._occasional.error(f'{error}: new publishers of {topic} are not followed')
            return self._publishers.offers

    def _wanted(self, offers: AbstractSet[Offer]) -> AbstractSet[Offer]:
        if not offers:
            # A topic without publishers keeps what it has: they may come back.
            return set(self._subscriptions) or {self._publishers.followed(DEFAULT)}
        if self._has_gid:
            return offers
        # Without the publisher of a message, two subscriptions could not be told apart.
        weakest = Offer(min(o.reliability for o in offers), max(o.durability for o in offers))
        return {weakest}

    def _open_wanted(self, wanted: AbstractSet[Offer]) -> None:
        others = wanted & self._subscriptions.keys()
        wait_s = _POSTPONED_S if others else _POSTPONED_ALONE_S
        for offer in sorted(wanted - self._subscriptions.keys()):
            if time.monotonic() >= self._postponed.get(offer, -math.inf) + wait_s:
                self._subscribe(offer)

    def _subscribe(self, offer: Offer) -> None:
        from ros2_kafka_bridge.ros.take import make_take  # noqa: PLC0415 (heavy)

        try:
            self._on_offer(offer)
        except TransportError as error:
            # The others are taken meanwhile; this one keeps its history.
            self._postponed[offer] = time.monotonic()
            self._end.log.warning(
                '%s, so %s (%s, %s) is read later', error, self._end.topic, *offer
            )
            return
        handle = self._end.subscribe(profile(self._end.qos, *offer))
        self._notifier.attach(handle)
        take = make_take(handle, self._take_bytes, has_gid=self._has_gid, by_rcl=self._by_rcl)
        self._subscriptions[offer] = _Subscription(handle, take)
        self.exhausted = False
        self._end.log.info('subscribes to %s (%s, %s)', self._end.topic, *offer)

    def _unsubscribe(self, subscription: _Subscription) -> None:
        self._notifier.detach(subscription.handle)
        self._end.unsubscribe(subscription.handle)

    def _close_unwanted(self, wanted: AbstractSet[Offer]) -> None:
        """Close what was found empty after its last publisher had gone."""
        for offer, subscription in list(self._subscriptions.items()):
            is_unwanted = offer not in wanted
            if is_unwanted and subscription.is_unwanted and subscription.is_empty:
                self._unsubscribe(self._subscriptions.pop(offer))
            subscription.is_unwanted, subscription.is_empty = is_unwanted, False

    # Taking

    def take(self, limit: int) -> Sequence[Message]:
        """Take at most `limit` messages that are there; what fails is raised afterwards."""
        messages: list[Message] = []
        self.exhausted = True
        unread, self._unread = self._unread, []
        for offer, taken in unread:
            self._select(taken, offer, messages)
        if self._unread:  # nothing may overtake it
            return messages
        share = max(1, limit // max(1, len(self._subscriptions)))
        for offer, subscription in list(self._subscriptions.items()):
            self._select(self._take(offer, subscription, share), offer, messages)
        return messages

    def raise_failure(self) -> None:
        """Tell what has failed since it was told last.

        Raises:
            RouteError: ROS has failed; what was taken before that was returned.
        """
        failure, self._failure = self._failure, None
        if failure is not None:
            with translated(f'subscription of {self._end.topic}'):
                raise failure

    def _take(self, offer: Offer, subscription: _Subscription, limit: int) -> list[Message]:
        try:
            taken, subscription.is_empty = subscription.take(limit)
        except Exception as error:  # noqa: BLE001 (raised by the next take)
            subscription.is_empty = self.exhausted = False
            self._fail(offer, subscription, error)
            return []
        subscription.has_failed = False
        self.exhausted = self.exhausted and subscription.is_empty
        if subscription.rings is not subscription.is_empty:
            self._let_ring(subscription, rings=subscription.is_empty)
        return taken

    def _let_ring(self, subscription: _Subscription, *, rings: bool) -> None:
        """Let a subscription ring, but not for what is taken anyway.

        For each ring Fast DDS goes through all that is unread.
        """
        subscription.rings = rings
        if rings:
            self._notifier.attach(subscription.handle)
            self._notifier.look_again(_JUST_NOW_S)  # what comes in between rings perhaps not
        else:
            self._notifier.detach(subscription.handle)

    def _fail(self, offer: Offer, subscription: _Subscription, error: Exception) -> None:
        """Keep an error of a subscription; one that fails again and again is made anew."""
        self._failure = error
        subscription.has_failed = not subscription.has_failed
        if subscription.has_failed:
            return
        self._end.log.error('%s (%s, %s) cannot be read: subscribes anew', self._end.topic, *offer)
        try:
            self._subscribe(offer)  # first: nobody would hold the publishers back in between
        except BridgeError as another:
            self._occasional.error(f'{another}')
        if self._subscriptions[offer] is not subscription:
            self._sequences.expect_loss(offer)
            self._unsubscribe(subscription)

    def _select(self, taken: list[Message], offer: Offer, messages: list[Message]) -> None:
        """Keep what counts; what stands behind a publisher that nobody can tell of now waits."""
        if not self._has_gid or self._sequences.accept_all(taken):
            messages += taken
            return
        accept, number = self._sequences.accept, 0
        try:
            for number, message in enumerate(taken):  # noqa: B007 (read where one fails)
                if accept(message.gid, message.seq, offer):
                    messages.append(message)
        except BridgeError as error:
            self._failure = error
            self._unread.append((offer, taken[number:]))
            self.exhausted = False
