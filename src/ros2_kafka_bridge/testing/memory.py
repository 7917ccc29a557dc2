"""The four ends of the bridge in memory: a test drives a pipeline step by step with them.

What they take and give is handed on here, so that who uses them imports nothing that is private.
"""

import logging
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Generic

from ros2_kafka_bridge.endpoints import (
    HeaderList,
    Load,
    Matches,
    Message,
    Outgoing,
    Readers,
    Rebalance,
    Record,
    Reports,
    Token,
)
from ros2_kafka_bridge.errors import BridgeError, RecordTooLargeError
from ros2_kafka_bridge.kafka.offsets import Offsets

_LOG: Final = logging.LoggerAdapter(logging.getLogger(__name__), {})

__all__ = [
    'HeaderList',
    'Load',
    'Matches',
    'MemoryMessageSink',
    'MemoryMessageSource',
    'MemoryRecord',
    'MemoryRecordSink',
    'MemoryRecordSource',
    'Message',
    'Outgoing',
    'Readers',
    'Rebalance',
    'Record',
    'Reports',
]


@dataclass(frozen=True)
class MemoryRecord:
    """A record, as Kafka's client shows one."""

    value_bytes: bytes | None
    offset_number: int = 0
    partition_number: int = 0
    key_bytes: bytes | None = None
    header_list: HeaderList | None = None
    time_ms: int = 0

    def partition(self) -> int:
        """Number of its partition."""
        return self.partition_number

    def offset(self) -> int:
        """Its offset in the partition."""
        return self.offset_number

    def key(self) -> bytes | None:
        """Its key."""
        return self.key_bytes

    def value(self) -> bytes | None:
        """Its value; None is a tombstone."""
        return self.value_bytes

    def headers(self) -> HeaderList | None:
        """Its headers; None where it has none."""
        return self.header_list

    def timestamp(self) -> tuple[int, int]:
        """Kind and milliseconds since 1970; kind 0 means that there is none."""
        return (1, self.time_ms) if self.time_ms else (0, 0)


@dataclass
class MemoryRecordSource:
    """A `RecordSource` that hands out `waiting` and remembers what was committed.

    Args:
        waiting: What comes next.
        committed: The offset of each partition.
        ends: Of a partition that ends behind its last record, with marks of transactions.
    """

    waiting: deque[MemoryRecord] = field(default_factory=deque)
    committed: dict[int, int] = field(default_factory=dict)
    away: str = ''
    held_back: str = ''
    reached: bool = True
    answers: bool | None = True
    lost_upstream: int = 0
    ends: dict[int, int] = field(default_factory=dict)
    held: bool = False
    rebalances: int = 0
    rebalance: Rebalance | None = None
    _offsets: Offsets = field(default_factory=lambda: Offsets('memory', _LOG))

    @property
    def positions(self) -> dict[int, int]:
        """How far each partition has come."""
        return self._offsets.positions

    def open(self, rebalance: Rebalance) -> None:
        """Join."""
        self.rebalance = rebalance

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Hand out what waits."""
        del timeout_s
        self.held = False
        return self.hand_out(limit)

    def hand_out(self, limit: int) -> Sequence[Record]:
        """Hand out at most `limit` of what waits."""
        records = [self.waiting.popleft() for _ in range(min(limit, len(self.waiting)))]
        self._offsets.assign(record.partition_number for record in records)
        self._offsets.hand_out(records)
        if not self.waiting:
            for partition, end in self.ends.items():
                self._offsets.reach_end(partition, end)
        return records

    def stay(self) -> Sequence[Record]:
        """Note that nothing is to be read."""
        self.held = True
        return ()

    def lose(self, partitions: frozenset[int]) -> None:
        """Let another have partitions."""
        assert self.rebalance is not None, 'the source is open'
        self.rebalance.lost(partitions)
        self._offsets.forget(partitions)

    def revoke(self, partitions: frozenset[int]) -> None:
        """Hand partitions over."""
        assert self.rebalance is not None, 'the source is open'
        self.rebalance.revoked(partitions)
        self.commit()
        self._offsets.forget(partitions)

    def make_anew(self, partitions: frozenset[int]) -> None:
        """Let partitions be those of a topic that was deleted and made again."""
        assert self.rebalance is not None, 'the source is open'
        self.rebalance.detached(partitions)
        self._offsets.forget(partitions)

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note how far partitions have come."""
        self._offsets.advance(positions)

    def commit(self) -> None:
        """Remember how far all have come."""
        self.committed.update(self._offsets.uncommitted)
        self._offsets.note_committed(self.committed)

    def commit_now(self, timeout_s: float) -> bool:
        """Remember how far all have come."""
        del timeout_s
        self.commit()
        return True

    def lag(self) -> int:
        """Count what waits."""
        return len(self.waiting)

    def close(self) -> None:
        """Leave."""
        self.rebalance = None
        self._offsets.clear()


@dataclass
class MemoryRecordSink(Generic[Token]):
    """A `RecordSink` that confirms what it gets, unless `answering` is False.

    Args:
        limit_bytes: Values longer than this are refused by the client.
        errors: Value -> error that its delivery report brings, once for each time it is produced.
        room: Records that it takes before they are confirmed.
        delivered_at_close: How many of those in flight it delivers when it is closed.
    """

    limit_bytes: int = 1_000_000
    errors: dict[bytes | None, list[BridgeError]] = field(default_factory=dict)
    room: int = 1_000_000
    answering: bool = True
    away: str = ''
    reached: bool = True
    answers: bool | None = True
    is_open: bool = False
    hurried: int = 0
    delivered_at_close: int = 0
    records: list[Outgoing] = field(default_factory=list)
    _in_flight: list[tuple[Token, Outgoing]] = field(default_factory=list)

    @property
    def load(self) -> Load:
        """What is in flight."""
        return Load(len(self._in_flight), self.room)

    @property
    def round_trip_s(self) -> tuple[float, float] | None:
        """There is no broker."""
        return None

    def open(self) -> None:
        """Open."""
        self.is_open = True

    def produce(self, record: Outgoing, token: Token) -> bool:
        """Take a record, if there is room."""
        assert self.is_open, 'produced to a closed sink'
        size = len(record.value or b'')
        if size > self.limit_bytes:
            raise RecordTooLargeError(size, self.limit_bytes, 'message.max.bytes of the producer')
        if len(self._in_flight) >= self.room:
            return False
        self._in_flight.append((token, record))
        return True

    def poll(self, timeout_s: float) -> Reports[Token]:
        """Report on what is in flight."""
        del timeout_s
        if not self.answering:
            return Reports([], [])
        confirmed: list[Token] = []
        failed: list[tuple[Token, BridgeError]] = []
        for token, record in self._in_flight:
            if left := self.errors.get(record.value):
                failed.append((token, left.pop(0)))
            else:
                self.records.append(record)
                confirmed.append(token)
        self._in_flight.clear()
        return Reports(confirmed, failed)

    def hurry(self) -> None:
        """Count how often it was asked; nothing lingers here."""
        self.hurried += 1

    def close(self) -> Iterable[Token]:
        """Deliver `delivered_at_close` of what is in flight, and give up the rest."""
        delivered = self._in_flight[: self.delivered_at_close] if self.answering else []
        self._in_flight.clear()
        self.is_open = False
        self.records += [record for _, record in delivered]
        return [token for token, _ in delivered]


@dataclass
class MemoryMessageSource:
    """A `MessageSource` that hands out `waiting`."""

    waiting: deque[Message] = field(default_factory=deque)
    lost_upstream: int = 0
    matched: int = 1
    looked: int = 0
    closed: bool = False

    @property
    def matches(self) -> Matches:
        """Its publishers."""
        return Matches(self.matched)

    @property
    def exhausted(self) -> bool:
        """Whether nothing waits."""
        return not self.waiting

    def open(self) -> None:
        """Subscribe."""

    def look(self) -> None:
        """Note that it was asked to follow its publishers."""
        self.looked += 1

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Hand out what waits."""
        del timeout_s
        return [self.waiting.popleft() for _ in range(min(limit, len(self.waiting)))]

    def close(self) -> None:
        """Unsubscribe."""
        self.closed = True


@dataclass
class MemoryMessageSink:
    """A `MessageSink` of one topic, with a history of `room` messages.

    Args:
        matched: Readers that are there.
        acknowledging: Whether they acknowledge what is published.
        reliable_subscribers: Nodes whose acknowledgements it waits for.
        misread: Which of them would misread what is published.
        tells: Whether it is told what they have acknowledged.
    """

    room: int = 1_000_000
    matched: int = 1
    acknowledging: bool = True
    published: list[bytes] = field(default_factory=list)
    mismatched: int = 0
    reliable_subscribers: Sequence[str] = ()
    misread: str = ''
    tells: bool = True
    _come: int = 0
    _known: int = 0
    _since_loss: int = 0
    _confirmed: int = 0
    _lost: bool = False

    @property
    def load(self) -> Load:
        """What is not acknowledged."""
        return Load(self._since_loss - self._confirmed, self.room)

    @property
    def matches(self) -> Matches:
        """Its readers."""
        return Matches(self.matched, self.mismatched)

    def writer(self, topic: str) -> 'MemoryMessageSink':
        """What publishes on its topic."""
        del topic
        return self

    def open(self) -> None:
        """Make the publisher."""

    def publish(self, messages: Iterable[bytes]) -> int:
        """Take messages, as far as there is room."""
        count, room = 0, self.room - (self._since_loss - self._confirmed)
        for cdr in messages:
            if count >= room:
                break
            self.published.append(cdr)
            count += 1
        self._since_loss += count
        return count

    def raise_failure(self) -> None:
        """Tell of no failure."""

    def acknowledge(self, count: int) -> None:
        """Let the readers acknowledge the oldest `count` messages."""
        self._confirmed = min(self._since_loss, self._confirmed + count)

    def lose_reader(self) -> None:
        """Let a reader go away with what it has not acknowledged.

        Another one comes in its place, unless `matched` is lowered, too.
        """
        self._lost = True
        self._known -= 1
        self._since_loss = self._confirmed = 0

    def readers(self) -> Readers:
        """Look at the readers."""
        self._come += max(0, self.matched - self._known)
        self._known = self.matched
        if self._lost:
            self._lost = False
            return Readers(
                self.matched, self._come, lost=True, confirmed=0, acknowledged=False,
                misread=self.misread,
            )  # fmt: skip
        if self.acknowledging:
            self._confirmed = self._since_loss
        confirmed = self._confirmed
        return Readers(
            self.matched, self._come, lost=False, confirmed=confirmed, acknowledged=self.tells,
            misread=self.misread,
        )  # fmt: skip

    def close(self) -> None:
        """Destroy the publisher."""
