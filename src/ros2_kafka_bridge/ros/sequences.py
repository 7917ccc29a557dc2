"""The numbers of the publishers of a topic: no message twice, and every gap counted."""

from collections.abc import Callable, Mapping, Sequence

from ros2_kafka_bridge.endpoints import Message, Offer
from ros2_kafka_bridge.errors import About
from ros2_kafka_bridge.logs.lines import Log, summed

_REMEMBERED = 1000


class _Publisher:
    """What is known of one publisher: its offer, the last number taken, a loss that is ours."""

    __slots__ = ('last', 'loses', 'offer')

    def __init__(self, offer: Offer | None) -> None:
        self.offer = offer
        self.last = 0
        self.loses = False


class Sequences:
    """Keeps the numbers of each publisher: no message twice, and every gap counted.

    Two subscriptions of different QoS can match one publisher. Each publisher belongs to the
    subscription of its own offer; from another one its messages count only while they follow
    without a gap: what is missing there is still in the publisher's history, and comes through
    its own.

    Args:
        log: Where gaps are said.
        topic: The ROS topic.
        ask: Asks the graph for the offer of each publisher, when an unknown one is heard.
    """

    def __init__(
        self,
        log: Log,
        topic: str,
        ask: Callable[[], Mapping[bytes, Offer]] = dict,
    ) -> None:
        self._publishers: dict[bytes, _Publisher] = {}
        self._occasional = summed(log)
        self._topic = topic
        self._ask = ask
        self.lost = 0

    def offers(self, offers: Mapping[bytes, Offer]) -> None:
        """Learn what each publisher offers."""
        # One that has gone may come back with its history: its number is kept, within a bound.
        gone = [gid for gid in self._publishers if gid not in offers]
        for gid in gone[: max(0, len(gone) - _REMEMBERED)]:
            del self._publishers[gid]
        for gid, offer in offers.items():
            self._publishers.setdefault(gid, _Publisher(offer)).offer = offer

    def expect_loss(self, offer: Offer) -> None:
        """Note that what lay in the reader of this offer has gone with it."""
        for publisher in self._publishers.values():
            publisher.loses = publisher.loses or publisher.offer in {None, offer}

    def accept_all(self, messages: Sequence[Message]) -> bool:
        """Accept messages at once; False: nothing was noted, each is to be asked for.

        So it is where they are of several publishers, or do not follow what was taken before.
        """
        if not messages:
            return True
        gid, first = messages[0].gid, messages[0].seq
        publisher = self._publishers.get(gid)
        if publisher is None or publisher.last + 1 != first:
            return False
        end = first + len(messages)
        if [message.seq for message in messages] != [*range(first, end)]:
            return False
        if {message.gid for message in messages} != {gid}:
            return False
        publisher.last, publisher.loses = end - 1, False
        return True

    def accept(self, gid: bytes, seq: int, offer: Offer) -> bool:
        """Whether to keep message `seq` that came through the subscription of `offer`.

        Raises:
            BridgeError: The graph cannot be asked for an unknown publisher; nothing is noted.
        """
        publisher = self._publishers.get(gid)
        if publisher is None:
            self.offers(self._ask())
            publisher = self._publishers.setdefault(gid, _Publisher(None))
        last = publisher.last
        if seq == last + 1:
            publisher.last, publisher.loses = seq, False
            return True
        if seq <= last or publisher.offer not in (None, offer):
            return False
        if last:
            self._gap(gid, last, seq, is_ours=publisher.loses)
        else:
            self._say_before(gid, seq)
        publisher.last, publisher.loses = seq, False
        return True

    def _say_before(self, gid: bytes, seq: int) -> None:
        """Say that a publisher is older than this reader, which knows of no loss by that."""
        self._occasional.info(
            f'publisher {gid.hex()} of {self._topic} is read from its message number {seq} on, '
            'the first that has come here: none before it counts as lost (ros.seq tells which of '
            'them are in Kafka)',
            about=About(ros_topic=self._topic, gid=gid.hex(), seq=seq),
        )

    def _gap(self, gid: bytes, last: int, seq: int, *, is_ours: bool) -> None:
        count = seq - last - 1
        self.lost += count
        lost = (
            f'{count} messages of {self._topic} were lost before the bridge (publisher '
            f'{gid.hex()}, {last + 1} to {seq - 1}'
        )
        text = (
            '): they lay in a subscription that ROS could not read any more'
            if is_ours
            else '): its publisher is KEEP_LAST or best effort and faster than its readers, or '
            'was out of reach'
        )
        about = About(ros_topic=self._topic, gid=gid.hex(), seq=last + 1)
        self._occasional.warning(lost + text, about=about)
