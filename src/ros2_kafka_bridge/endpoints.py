"""The four ends that a pipeline joins, as the pipeline sees them.

The real ones are in `kafka` and `ros`, memory ones in `testing`. All calls on an end come from
the thread of its route, also the calls back.
"""

from collections.abc import Iterable, Mapping, Sequence
from operator import methodcaller
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from ros2_kafka_bridge.errors import BridgeError

Token = TypeVar('Token')

HeaderList = list[tuple[str, str | bytes | None]]
"""Headers in their order; a name may come twice."""

# confluent-kafka returns a broken list together with an exception where the name of a header is
# not UTF-8. A call from Python's own byte code may overlook that; one from C never does.
_ASK: Final = methodcaller('headers')
_SOURCE_TIME: Final = 'ros.source_time_ns'
_MOST_DIGITS: Final = 19


class Record(Protocol):
    """A record as Kafka's client hands it over."""

    def partition(self) -> int | None:
        """Number of its partition."""

    def offset(self) -> int | None:
        """Its offset in the partition."""

    def key(self) -> bytes | None:
        """Its key."""

    def value(self) -> bytes | None:
        """Its value; None is a tombstone."""

    def headers(self) -> HeaderList | None:
        """Its headers; None where it has none."""

    def timestamp(self) -> tuple[int, int]:
        """Kind and milliseconds since 1970; kind 0 means that there is none."""


class HasHeaders(Protocol):
    """A record as far as it is looked at here."""

    def headers(self) -> Any:
        """Pairs of name and value, or None."""


def headers_of(record: HasHeaders) -> HeaderList | None:
    """Read its headers; None where the client cannot, for a name that is not UTF-8.

    Ask once for each record: the client keeps the broken list, and a look into it can end the
    process.
    """
    try:
        return _ASK(record) or []
    except (SystemError, UnicodeDecodeError):
        return None


def source_time_ns(headers: HeaderList) -> int:
    """When a ROS message was published, since 1970, as a bridge has noted it; 0 if none has."""
    for name, value in headers:
        if name == _SOURCE_TIME and value and len(value) <= _MOST_DIGITS and value.isdigit():
            return int(value)
    return 0


class Message(NamedTuple):
    """A message as ROS hands it over.

    Args:
        cdr: Its bytes; up to three bytes of padding may follow the message.
        gid: Of its publisher, 16 bytes; empty where the middleware does not tell.
        seq: Its number at its publisher, from 1; 0 where the middleware does not tell.
        source_time_ns: When it was published, since 1970.
    """

    cdr: bytes
    gid: bytes
    seq: int
    source_time_ns: int


class Outgoing(NamedTuple):
    """A record to be produced."""

    topic: str
    key: bytes | None
    value: bytes | None
    headers: HeaderList


class Rebalance(Protocol):
    """What a source of records calls while it is polled."""

    def revoked(self, partitions: frozenset[int]) -> None:
        """Finish what can be and `advance`, then forget these partitions: a commit follows."""

    def lost(self, partitions: frozenset[int]) -> None:
        """Forget these partitions, others may have them already."""

    def detached(self, partitions: frozenset[int]) -> None:
        """Keep what is in flight of these: their topic is gone, nobody can read it again."""


class Load(NamedTuple):
    """What a sink holds.

    Args:
        queued: Messages in the history of a writer, or the queue of a producer.
        limit: How many it may hold; None where that is not known.
    """

    queued: int = 0
    limit: int | None = None

    @classmethod
    def of_all(cls, loads: Iterable['Load']) -> 'Load':
        """Add up several."""
        queued, limits = zip(*loads, strict=True)
        return cls(sum(queued), None if None in limits else sum(limits))


class Matches(NamedTuple):
    """The endpoints of a ROS topic on the other side: those that match the route's, and others."""

    matched: int = 0
    mismatched: int = 0

    @classmethod
    def of_all(cls, each: Iterable['Matches']) -> 'Matches':
        """Add up several."""
        return cls(*map(sum, zip(*each, strict=True)))


class KafkaEnd(Protocol):
    """The end of a route that is in Kafka."""

    @property
    def away(self) -> str:
        """Why nothing can be read or produced just now; empty when all is well."""

    @property
    def reached(self) -> bool:
        """Whether Kafka has ever answered."""

    @property
    def answers(self) -> bool | None:
        """Whether it does now, though it may let nothing be read or produced; None: not heard."""


class RecordSource(KafkaEnd, Protocol):
    """The records of one topic, read as a member of a group.

    It keeps how far each partition has come, and hears of it by `advance`. Behind the last record
    there may be offsets that are no records (marks of transactions): it passes them by itself.
    """

    @property
    def held_back(self) -> str:
        """Why Kafka gives out nothing, though it is there; empty where it does."""

    @property
    def lost_upstream(self) -> int:
        """Records that the topic no longer held when the bridge came to read them."""

    @property
    def rebalances(self) -> int:
        """How often partitions came or went."""

    def open(self, rebalance: Rebalance) -> None:
        """Join the group."""

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Wait up to `timeout_s` for the first record, then return what is there."""

    def stay(self) -> Sequence[Record]:
        """Stay a member of the group without reading on; rarely a few records still come."""

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note the next offset to read of partitions: all before it have ended."""

    def commit(self) -> None:
        """Commit how far each partition has come, without waiting for it."""

    def commit_now(self, timeout_s: float) -> bool:
        """Commit and wait; False when it was not confirmed in time."""

    def lag(self) -> int | None:
        """How many records of the partitions come behind what has ended; None: not known."""

    def close(self) -> None:
        """Leave the group."""


class Reports(NamedTuple, Generic[Token]):
    """What became of produced records, by the tokens they were given."""

    confirmed: Sequence[Token]
    failed: Sequence[tuple[Token, BridgeError]]


class RecordSink(KafkaEnd, Protocol[Token]):
    """Where records are produced."""

    @property
    def load(self) -> Load:
        """What is on its way."""

    @property
    def round_trip_s(self) -> tuple[float, float] | None:
        """To the broker, 50th and 99th percentile of the last seconds; None where not known."""

    def open(self) -> None:
        """Make the client; it connects in the background."""

    def produce(self, record: Outgoing, token: Token) -> bool:
        """Hand over a record; False: the queue is full, nothing was taken.

        Raises:
            RecordTooLargeError: The client itself refuses the size.
        """

    def poll(self, timeout_s: float) -> Reports[Token]:
        """Wait up to `timeout_s` for delivery reports and return them."""

    def hurry(self) -> None:
        """Send at once what the client holds back to make a larger batch; may take a moment."""

    def close(self) -> Iterable[Token]:
        """Give up what is not delivered; return the tokens that were delivered meanwhile."""


class Offer(NamedTuple):
    """The part of a publisher's QoS that a subscription follows."""

    reliability: str
    durability: str


class MessageSource(Protocol):
    """The messages of ROS topics, of whatever publishers they have."""

    @property
    def lost_upstream(self) -> int:
        """Messages lost before the bridge could take them, by the gaps in their numbers."""

    @property
    def exhausted(self) -> bool:
        """Whether the last take has found nothing more to take."""

    @property
    def matches(self) -> Matches:
        """Its publishers, as far as the graph knows."""

    def open(self) -> None:
        """Subscribe."""

    def look(self) -> None:
        """Follow the publishers; a take does so, too."""

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Wait up to `timeout_s` for messages, then take at most `limit`."""

    def close(self) -> None:
        """Unsubscribe."""


class Readers(NamedTuple):
    """What a sink of messages knows about its readers.

    Args:
        matched: How many there are.
        come: How many have come since the sink was opened, whether they are there still or not.
        lost: Whether one has gone since the last look: publish again what is not confirmed.
        confirmed: How many of the messages published since the last loss are done with: all
            readers that acknowledge have them.
        acknowledged: Whether there is a reader that acknowledges, and the middleware tells.
        misread: Who would read the fields of what is published now into others, and what would
            help; empty where nobody does.
        foreign: Whether one is of another vendor of DDS than the bridge, or may be.
    """

    matched: int
    come: int
    lost: bool
    confirmed: int
    acknowledged: bool
    misread: str = ''
    foreign: bool = False


class MessageWriter(Protocol):
    """Where messages are published: one topic."""

    def publish(self, messages: Iterable[bytes]) -> int:
        """Publish in this order, as far as there is room; returns how many were taken."""

    def raise_failure(self) -> None:
        """Tell what has failed in the last publish.

        Raises:
            RouteError: ROS has failed; what was taken before that was returned.
        """

    def readers(self) -> Readers:
        """Look at the readers."""


class MessageSink(Protocol):
    """The topics that messages are published on."""

    @property
    def load(self) -> Load:
        """What their histories hold."""

    @property
    def matches(self) -> Matches:
        """Their subscribers, as far as the graph knows."""

    @property
    def reliable_subscribers(self) -> Sequence[str]:
        """Names of the nodes whose acknowledgements are waited for, as far as the graph knows."""

    def writer(self, topic: str) -> MessageWriter:
        """What publishes on one of them."""

    def open(self) -> None:
        """Make the publishers."""

    def close(self) -> None:
        """Destroy the publishers."""
