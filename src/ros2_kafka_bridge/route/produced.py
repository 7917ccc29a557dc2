"""Which messages are in Kafka already, from before a restart or from another bridge."""

import logging
import time
from collections.abc import Iterable
from typing import Final, Protocol

from ros2_kafka_bridge.dedup import Numbers
from ros2_kafka_bridge.endpoints import Message, Offer
from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError

FIRST_RECORDS: Final = 10_000
MAX_RECORDS: Final = 1_000_000
_FIRST_S: Final = 60.0
_FURTHER_S: Final = 30.0
_LETTERS_S: Final = 5.0
_SKEW_NS: Final = 60_000_000_000  # between the clocks of a publisher and of what writes to Kafka


class TopicTail(Protocol):
    """The end of a topic, read backwards (`kafka.tail.KafkaTail`)."""

    topic: str
    records: int
    numbers: dict[bytes, Numbers]

    @property
    def complete(self) -> bool:
        """Whether the topic holds nothing before what was read."""
        ...

    @property
    def partitions(self) -> int:
        """How many partitions the topic has."""
        ...

    @property
    def since_ns(self) -> float:
        """All records from that time on were read."""
        ...

    def read(self, records: int, within_s: float) -> None:
        """Read so many records of each partition: the last ones, then those before them."""


class Produced:
    """Tells which messages Kafka holds, where publishers send their history (TRANSIENT_LOCAL).

    It reads the last 10,000 records of each partition, and further back, twice as far each time,
    while a message comes that may lie before them: up to a million records or 30 s in all. Of the
    dead letters it reads the last 10,000, for 5 s at most: a repeated one does no harm.

    Args:
        tail: Of the topic that the route writes.
        letters: The end of its dead-letter topic, with what the route has refused.
        log: Where to say how far was read.
    """

    def __init__(
        self, tail: TopicTail, letters: TopicTail, log: logging.LoggerAdapter[logging.Logger]
    ) -> None:
        self._tail = tail
        self._letters = letters
        self._log = log
        self._looked = False
        self._looked_ns = 0
        self._looked_at_letters = False
        self._ends = False  # nothing is read any further
        self._spent_s = 0.0
        self._others: dict[bytes, Numbers] = {}

    def look(self, offer: Offer) -> None:
        """Read the end of the topic, if a publisher may send its history again.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read.
        """
        if offer.durability == 'transient_local' and not self._looked:
            self.look_at_end()
            self._looked = True
            self._looked_ns = time.time_ns()

    def look_at_end(self) -> None:
        """Read the end of the topic, for `holds`.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read.
        """
        if not self._tail.partitions:
            self._tail.read(FIRST_RECORDS, _FIRST_S)

    def holds(self, gid: bytes, seq: int) -> bool:
        """Whether a message is in the part of the topic that was read."""
        numbers = self._tail.numbers.get(gid)
        return numbers is not None and seq in numbers

    def holds_letter(self, gid: bytes, seq: int, made_ns: int) -> bool:
        """Whether a message that is refused now was made a dead letter before.

        Args:
            gid: Of its publisher.
            seq: Its number.
            made_ns: When it was published, since 1970.
        """
        if not self._looked or made_ns > self._looked_ns + _SKEW_NS:
            return False  # it is no part of a history
        if not self._looked_at_letters:
            self._looked_at_letters = True
            self._look_at_letters()
        numbers = self._letters.numbers.get(gid)
        return numbers is not None and seq in numbers

    def _look_at_letters(self) -> None:
        try:
            self._letters.read(FIRST_RECORDS, _LETTERS_S)
        except BridgeError as error:
            self._log.info('%s, so a dead letter of before may come again', error)

    def add(self, numbers: Iterable[tuple[bytes, int]]) -> None:
        """Count further messages, by publisher and number, as being there (those of a spool)."""
        for gid, seq in numbers:
            self._others.setdefault(gid, Numbers(MAX_RECORDS)).add(seq)

    def contains(self, message: Message) -> bool:
        """Whether a message is there already; may read further back for it."""
        if self._others and message.seq in self._others.get(message.gid, ()):
            return True
        if not self._looked:
            return False
        found = self.holds(message.gid, message.seq)
        while not found and not self._ends and self._may_be_further_back(message):
            self._read_further()
            found = self.holds(message.gid, message.seq)
        return found

    def _may_be_further_back(self, message: Message) -> bool:
        """Whether a record of the message, if there is one, lies before those that were read."""
        tail = self._tail
        numbers = tail.numbers.get(message.gid)
        if numbers is not None and message.seq >= numbers.first and tail.partitions == 1:
            return False  # those of one publisher are in their order there
        if tail.complete:
            return False
        # It was produced after it was published: one that is younger than all that was not read
        # is not there. A clock that is ahead says nothing.
        is_ahead = message.source_time_ns > time.time_ns() + _SKEW_NS
        return is_ahead or message.source_time_ns - _SKEW_NS < tail.since_ns

    def _read_further(self) -> None:
        tail, began_s = self._tail, time.monotonic()
        problem = ''
        try:
            tail.read(self._step(), _FURTHER_S - self._spent_s)
        except TransportError as error:
            problem = f' ({error})'
        except RouteError as error:
            problem, self._ends = f' ({error})', True
        self._spent_s += time.monotonic() - began_s
        self._ends = self._ends or tail.records >= MAX_RECORDS or self._spent_s >= _FURTHER_S
        if not problem:
            self._log.info(
                'looked through the last %d records of %s for what is there already (%.1f s)',
                tail.records, tail.topic, self._spent_s,
            )  # fmt: skip
        if self._ends and not tail.complete:
            self._log.warning(
                'looks no further back than %d records of %s%s: what lies before them may be '
                'repeated; a reader tells by ros.gid and ros.seq',
                tail.records, tail.topic, problem,
            )  # fmt: skip

    def _step(self) -> int:
        """How many records of each partition to read next: as many as were read so far."""
        tail = self._tail
        records = min(tail.records, MAX_RECORDS - tail.records) // tail.partitions
        return max(FIRST_RECORDS, records)
