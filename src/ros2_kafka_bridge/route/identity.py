"""What a record proves by its headers: next to nothing, for anybody may write them.

Stream processors copy the headers of what they have read, and a stranger can invent numbers. So a
message counts as delivered before only where a record carries its whole identity: publisher,
number and time, and the ROS topic, the bridge and the route that have made a record of it. What
is not certain is sent again. All who ask whether something is there, or goes round, ask here.
"""

from array import array
from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Callable
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.dedup import of_publisher, place_in
from ros2_kafka_bridge.endpoints import HeaderList, source_time_ns
from ros2_kafka_bridge.errors import LoopError
from ros2_kafka_bridge.route.type_hash import CheckHeaders

MAX_PUBLISHERS: Final = 1000
"""Of so many publishers of a topic it is remembered what is there."""

TOLERANCE_NS: Final = 1000
"""By so much transports and vendors round the time of a message that they send again."""

_LARGEST: Final = 2**63 - 1


class Identity(NamedTuple):
    """Which message it is.

    Args:
        gid: Of its publisher, 16 bytes; empty where that is not told.
        seq: Its number there, from 1; 0 where that is not told.
        source_time_ns: When it was published, since 1970; 0 where that is not told.
    """

    gid: bytes
    seq: int
    source_time_ns: int

    @property
    def is_whole(self) -> bool:
        """Whether all of it is told: what lacks a part may be another's."""
        return bool(self.gid) and self.seq > 0 and self.source_time_ns > 0


class Author(NamedTuple):
    """Who makes records of the messages of a ROS topic: one route of one bridge."""

    ros_topic: str
    bridge: str
    route: str

    @property
    def headers(self) -> list[tuple[str, bytes]]:
        """What each of its records says of it."""
        return [
            ('ros.topic', self.ros_topic.encode()),
            ('bridge.origin', self.bridge.encode()),
            ('bridge.route', self.route.encode()),
        ]


Identify = Callable[[HeaderList], Identity | None]
"""Headers of a record -> the message that it claims to carry; None where it claims nothing.

The time is left out where the record lacks a part of the identity: it proves nothing then.
"""


def make_identify(author: Author) -> Identify:
    """Make the function that reads which message a record carries, if this author has made it."""
    of_author = author.headers

    def identify(headers: HeaderList) -> Identity | None:
        place = place_in(headers)
        if place is None or place[1] > _LARGEST:
            return None
        made_ns = source_time_ns(headers)
        is_own = made_ns <= _LARGEST and all(one in headers for one in of_author)
        return Identity(*place, made_ns if is_own else 0)

    return identify


class _Times:
    """The numbers of one publisher that are in a topic, each with when it was published.

    A number may stand there with several times: the others are forged.
    """

    __slots__ = ('_is_sorted', '_made_ns', '_seqs', 'first')

    def __init__(self) -> None:
        self.first = _LARGEST  # the lowest number
        self._seqs = array('q')
        self._made_ns = array('q')
        self._is_sorted = True

    def add(self, seq: int, made_ns: int) -> None:
        """Add a number."""
        self.first = min(self.first, seq)
        self._is_sorted = self._is_sorted and (not self._seqs or self._seqs[-1] <= seq)
        self._seqs.append(seq)
        self._made_ns.append(made_ns)

    def has(self, seq: int) -> bool:
        """Whether a number is there, with whatever time."""
        place = self._place(seq)
        return place < len(self._seqs) and self._seqs[place] == seq

    def holds(self, seq: int, made_ns: int) -> bool:
        """Whether a number is there with that time."""
        place = self._place(seq)
        seqs = self._seqs
        while place < len(seqs) and seqs[place] == seq:
            if abs(self._made_ns[place] - made_ns) <= TOLERANCE_NS:
                return True
            place += 1
        return False

    def _place(self, seq: int) -> int:
        """Where a number stands, or would."""
        if not self._is_sorted:
            order = sorted(range(len(self._seqs)), key=self._seqs.__getitem__)
            self._seqs = array('q', map(self._seqs.__getitem__, order))
            self._made_ns = array('q', map(self._made_ns.__getitem__, order))
            self._is_sorted = True
        return bisect_left(self._seqs, seq)


class Evidence:
    """Which messages are in a topic, by what its records say of themselves.

    Its memory is bounded: 16 bytes for each record that was noted, and 1,000 publishers; the one
    that was noted least recently is forgotten for a further one, but for one that is only in older
    records. What only claims to be a message, and is noted to be told, pushes out no publisher.
    """

    def __init__(self) -> None:
        self._proved: OrderedDict[bytes, _Times] = OrderedDict()
        self._claimed: OrderedDict[bytes, _Times] = OrderedDict()

    def note(self, identity: Identity, *, is_older: bool = False) -> None:
        """Note a message, or what only claims to be one.

        Args:
            identity: Which it is; without a time where it only claims it.
            is_older: Whether its record lies before those that were noted so far.
        """
        gid, seq, made_ns = identity
        known = self._proved if made_ns > 0 else self._claimed
        if is_older and gid not in known and len(known) >= MAX_PUBLISHERS:
            return
        of_publisher(known, gid, _Times, MAX_PUBLISHERS).add(seq, made_ns)

    def proves(self, identity: Identity) -> bool:
        """Whether a message is there for certain; one that tells too little never is."""
        times = self._proved.get(identity.gid)
        if times is None or not identity.is_whole:
            return False
        return times.holds(identity.seq, identity.source_time_ns)

    def claims(self, identity: Identity) -> bool:
        """Whether a record says that it is that message, be it true or not."""
        found = (self._proved.get(identity.gid), self._claimed.get(identity.gid))
        return any(times.has(identity.seq) for times in found if times is not None)

    def first(self, gid: bytes) -> int | None:
        """The lowest number of a publisher that is there for certain."""
        times = self._proved.get(gid)
        return None if times is None else times.first


def make_loop_check(bridge: str, ros_topic: str) -> Callable[[HeaderList], bool]:
    """Make the function that tells whether a record has come from a ROS topic by this bridge.

    Published there, it would come again, and so for ever. A copied header elsewhere means nothing.
    """
    origin, topic = ('bridge.origin', bridge.encode()), ('ros.topic', ros_topic.encode())
    return lambda headers: origin in headers and topic in headers


def guard_loops(
    bridge: str, route: KafkaToRosRoute, check: CheckHeaders
) -> tuple[Callable[[HeaderList], bool], CheckHeaders]:
    """Make what a route to ROS asks of the headers of a record, so that nothing goes round.

    Args:
        bridge: Its name.
        route: The route; its `skip_own` says whether what would go round is skipped.
        check: What else of the headers refuses a record.

    Returns:
        What tells whether to skip a record, and what refuses one.
    """
    ros_topic = route.ros_topic
    goes_round = make_loop_check(bridge, ros_topic)
    if route.skip_own:
        return goes_round, check

    def check_all(headers: HeaderList) -> None:
        if goes_round(headers):
            raise LoopError(
                f'it came from {ros_topic} by this bridge (bridge.origin: {bridge}) and would be '
                'published there again; let a program that writes new records leave bridge.origin '
                'out, or skip what a mirror brings back by skip_own: true on the route'
            )
        check(headers)

    return lambda _: False, check_all
