"""Which messages are in Kafka already, from before a restart or from another bridge."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Final, Protocol

from ros2_kafka_bridge.dedup import Numbers
from ros2_kafka_bridge.endpoints import Message, Offer, Record, headers_of
from ros2_kafka_bridge.errors import About, BridgeError, RouteError, TransportError
from ros2_kafka_bridge.logs.lines import Log, summed
from ros2_kafka_bridge.route.identity import Evidence, Identify, Identity

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

    @property
    def complete(self) -> bool:
        """Whether the topic holds nothing before what was read."""

    @property
    def partitions(self) -> int:
        """How many partitions the topic has."""

    @property
    def since_ns(self) -> float:
        """All records from that time on were read."""

    @property
    def is_cut(self) -> bool:
        """Whether the time was over before all that was asked for last was read."""

    def read(self, records: int, within_s: float, note: Callable[[Record], None]) -> None:
        """Read so many records of each partition: the last ones, then those before them."""


LetterIdentity = Callable[[Record], Identity | None]
"""Record of a dead-letter topic -> the message that the route has refused, if it tells one."""


class Produced:
    """Tells which messages Kafka holds, where publishers send their history (TRANSIENT_LOCAL).

    It reads the last 10,000 records of each partition, and further back, twice as far each time,
    while a message comes that may lie before them: up to a million records or 30 s in all. Of the
    dead letters it reads the last 10,000, for 5 s at most: a repeated one does no harm.

    A record counts only where it carries the whole identity of the message (`route.identity`).

    Args:
        tail: Of the topic that the route writes.
        letters: The end of its dead-letter topic, with what the route has refused.
        identify: Reads which message a record of the route carries.
        of_letter: Tells which message a letter is of.
        log: Where to say how far was read.
    """

    def __init__(
        self,
        tail: TopicTail,
        letters: TopicTail,
        identify: Identify,
        of_letter: LetterIdentity,
        log: Log,
    ) -> None:
        self.unproved = 0  # messages sent though a record had their number
        self._tail = tail
        self._letters = letters
        self._identify = identify
        self._of_letter = of_letter
        self._log = log
        self._occasional = summed(log)
        self._looked = False
        self._looked_ns = 0
        self._looked_at_letters = False
        self._ends = False  # nothing is read any further
        self._spent_s = 0.0
        self._in_topic = Evidence()
        self._refused = Evidence()
        self._on_disk: dict[bytes, Numbers] = {}
        self._on_disk_ns = 0  # when they were told

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
            self._in_topic = Evidence()  # without what a try before has read in part
            self._tail.read(FIRST_RECORDS, _FIRST_S, self._note)
            self._end_if_cut()

    def holds(self, identity: Identity) -> bool:
        """Whether a message is in the part of the topic that was read."""
        if self._in_topic.proves(identity):
            return True
        self._tell_if_claimed(identity)
        return False

    def holds_letter(self, identity: Identity) -> bool:
        """Whether a message that is refused now was made a dead letter before."""
        made_ns = identity.source_time_ns
        if not self._looked or not identity.is_whole or made_ns > self._looked_ns + _SKEW_NS:
            return False  # it is no part of a history
        if not self._looked_at_letters:
            self._looked_at_letters = True
            self._look_at_letters()
        return self._refused.proves(identity)

    def add(self, numbers: Iterable[tuple[bytes, int]]) -> None:
        """Count further messages, by publisher and number, as being there.

        They are those of a spool: what nobody else writes needs no more to be known by.
        """
        self._on_disk_ns = time.time_ns()
        for gid, seq in numbers:
            self._on_disk.setdefault(gid, Numbers(MAX_RECORDS)).add(seq)

    def not_there(self, messages: Sequence[Message]) -> Iterable[Message]:
        """Those that are not there yet; may read further back for them."""
        if not self._on_disk and not self._looked:
            return messages
        return (message for message in messages if not self.contains(message))

    def contains(self, message: Message) -> bool:
        """Whether a message is there already; may read further back for it."""
        if self._is_on_disk(message):
            return True
        if not self._looked:
            return False
        identity = Identity(message.gid, message.seq, message.source_time_ns)
        while not self._in_topic.proves(identity):
            if self._ends or not self._may_be_further_back(identity):
                self._tell_if_claimed(identity)
                return False
            self._read_further()
        return True

    def _end_if_cut(self) -> None:
        """Go on with what was read in time, and say so: else nothing would be taken for ever."""
        if self._tail.is_cut:
            self._ends = True
            self._log.warning(
                'the end of %s cannot be read within %.0f s: what of it was not read may be '
                'repeated; a reader tells by ros.gid and ros.seq',
                self._tail.topic, _FIRST_S,
            )  # fmt: skip

    def _is_on_disk(self, message: Message) -> bool:
        """Whether it was there when the spool was opened.

        What is younger is of a publisher that has come back with its old gid, and counts anew.
        """
        if message.source_time_ns > self._on_disk_ns + _SKEW_NS:
            return False
        return message.seq in self._on_disk.get(message.gid, ())

    def _note(self, record: Record, *, is_older: bool = False) -> None:
        identity = self._identify(headers_of(record) or [])
        if identity is not None:
            self._in_topic.note(identity, is_older=is_older)

    def _note_letter(self, record: Record) -> None:
        identity = self._of_letter(record)
        if identity is not None:
            self._refused.note(identity)

    def _look_at_letters(self) -> None:
        try:
            self._letters.read(FIRST_RECORDS, _LETTERS_S, self._note_letter)
        except BridgeError as error:
            self._log.info('%s, so a dead letter of before may come again', error)
        if self._letters.is_cut:
            told = (
                'the end of %s takes too long to read, so a dead letter of before may come again'
            )
            self._log.info(told, self._letters.topic)

    def _tell_if_claimed(self, identity: Identity) -> None:
        """Say where somebody has used the number of a message that is sent now."""
        if not self._in_topic.claims(identity):
            return
        topic, gid, seq = self._tail.topic, identity.gid.hex(), identity.seq
        if not identity.is_whole:
            self._occasional.warning(
                f'publisher {gid} sends no time with its messages: '
                'nothing proves which of its history are in Kafka, so that all of it is sent '
                'again at each start; a reader tells by ros.gid and ros.seq',
                kind='timeless',
                first=1,
            )
            return
        self.unproved += 1
        self._occasional.warning(
            f'a record of {topic} has ros.gid {gid} and ros.seq {seq}, and not all of '
            'ros.source_time_ns, ros.topic, bridge.origin and bridge.route of that message: it '
            'proves nothing, the message is sent',
            '; another route, a program that copies headers or an earlier version of the bridge '
            'has written it (docs/security.md: who may write there)',
            about=About(topic=topic, gid=gid, seq=seq),
            kind='unproved',
            first=1,
        )

    def _may_be_further_back(self, identity: Identity) -> bool:
        """Whether a record of the message, if there is one, lies before those that were read."""
        tail = self._tail
        if tail.complete or not identity.is_whole:
            return False
        first = self._in_topic.first(identity.gid)
        if first is not None and identity.seq >= first and tail.partitions == 1:
            return False  # those of one publisher are in their order there
        # It was produced after it was published: one that is younger than all that was not read
        # is not there. A clock that is ahead says nothing.
        made_ns = identity.source_time_ns
        is_ahead = made_ns > time.time_ns() + _SKEW_NS
        return is_ahead or made_ns - _SKEW_NS < tail.since_ns

    def _read_further(self) -> None:
        tail, began_s = self._tail, time.monotonic()
        problem = ''
        try:
            tail.read(self._step(), _FURTHER_S - self._spent_s, partial(self._note, is_older=True))
        except TransportError as error:
            problem = f' ({error})'
        except RouteError as error:
            problem, self._ends = f' ({error})', True
        self._spent_s += time.monotonic() - began_s
        self._ends = self._ends or tail.is_cut or tail.records >= MAX_RECORDS
        self._ends = self._ends or self._spent_s >= _FURTHER_S
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
