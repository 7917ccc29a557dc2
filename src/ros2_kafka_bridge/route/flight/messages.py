"""What a route from ROS has in flight: the line to Kafka, and the tail behind what is on disk."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, cast

from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.route.flight.flight import ENTRY_BYTES, Entry, Flight, Ring
from ros2_kafka_bridge.route.flight.stage import HELD, READY, REFUSED, SENT, STORED
from ros2_kafka_bridge.route.rejections import Rejection

LINE: Final = 0
"""The ring of what is, or was, on its way to Kafka."""

TAIL: Final = 1
"""The ring of what is behind all on disk, until it is there as well, or nothing is any more."""


class MessageEntry(Entry):
    """One message on its way.

    Args:
        record: What is to be produced.
        message: What it was made of; it is not kept.
        taken_s: When that was taken, by the monotonic clock.
        row: Its number in the spool; 0 where it is in memory alone.
    """

    produced_s: float  # when the producer took it last

    __slots__ = ('gid', 'goes_alone', 'made_ns', 'produced_s', 'row', 'seq', 'taken_bytes')

    def __init__(self, record: Outgoing, message: Message, taken_s: float, row: int = 0) -> None:
        self.record = record
        cdr, self.gid, self.seq, self.made_ns = message
        self.taken_bytes = len(cdr)
        self.taken_s = taken_s
        self.size_bytes = len(record.value or b'') + ENTRY_BYTES
        self.row = row
        self.goes_alone = False  # in a request of its own

    @property
    def is_in_line(self) -> bool:
        """Whether it is on its way to Kafka."""
        return self.stage is READY or self.stage is SENT


class MessageFlight(Flight[MessageEntry]):
    """The flight of a route from ROS.

    An entry that must end the route lets neither itself nor one behind it go on to Kafka, but for
    what the producer has already. The route ends once all before it have ended.

    Args:
        max_entries: As of `Flight`.
        max_bytes: As of `Flight`.
        drops: As of `Flight`.
    """

    def __init__(self, max_entries: int, max_bytes: int, *, drops: bool = False) -> None:
        super().__init__(max_entries, max_bytes, drops=drops)
        self.line_ends = False  # whether what ends the route is before all on disk
        self._rings[LINE], self._rings[TAIL] = self._line, self._tail = Ring(), Ring()
        self._failures: dict[MessageEntry, Rejection] = {}  # what ends the route

    @property
    def line(self) -> Iterator[MessageEntry]:
        """What is in the line, in the order of taking."""
        return cast('Iterator[MessageEntry]', iter(self._line))

    @property
    def tail(self) -> Iterator[MessageEntry]:
        """What is in the tail, in the order of taking."""
        return cast('Iterator[MessageEntry]', iter(self._tail))

    @property
    def fits(self) -> bool:
        """Whether no more is in flight than may be."""
        return self._open <= self.max_entries and not self.fills_window

    @property
    def room(self) -> int:
        """How many more may be taken; 0 also where those in flight are too large together."""
        if self.drops:
            return 0 if self.is_full else sys.maxsize
        if self.size_bytes >= self.max_bytes:
            return 0
        return max(0, self.max_entries - self._open)

    def ready(self, entries: Sequence[MessageEntry]) -> None:
        """Let entries of the line wait for their sink, but those behind what ends the route."""
        super().ready(entries)
        if self.line_ends:
            self._hold_behind_failure()

    def requeue(self, entries: Sequence[MessageEntry]) -> None:
        """Let entries of one lane wait again, in front of all others and in their order."""
        if len(entries) > 1:
            again = {*entries}
            entries = [entry for entry in self.line if entry in again]
        super().requeue(entries)
        self._hold_behind_failure()

    def begin_again(self, *, behind_disk: bool) -> None:
        """Let all go to Kafka again, or behind what is on disk: the sinks are new ones."""
        entries, head = [*self], self._tail if behind_disk else self._line
        for lane in (self.lane, self.letters):
            lane.ready.clear()
        for entry in entries:
            self._move(entry, head)
            if entry.stage is not REFUSED:
                entry.stage = HELD
                if not behind_disk:
                    super().ready([entry])
        self._hold_behind_failure()

    # The end of a route

    def refuse(self, entry: MessageEntry, failure: Rejection) -> None:
        """Let the route end at an entry, once all before it have ended."""
        entry.stage = REFUSED
        self._failures[entry] = failure
        self._hold_behind_failure()

    @property
    def ends(self) -> bool:
        """Whether there is something that ends the route."""
        return bool(self._failures)

    @property
    def failure_in_front(self) -> Rejection | None:
        """What ends the route, once all before it in memory have ended."""
        first = next(iter(self), None)
        return self._failures.get(first) if first is not None else None

    def _hold_behind_failure(self) -> None:
        if not self._failures:
            return
        is_behind = False
        for entry in self.line:
            is_behind = is_behind or entry.stage is REFUSED
            if is_behind and entry.stage is READY:
                entry.stage = HELD
        self.line_ends = is_behind
        self._keep_ready()

    # The way over the disk

    def hold_waiting(self) -> None:
        """Let what waits in memory alone, behind all that the sinks have, be written first."""
        ready = self.lane.ready
        while ready and ready[-1] is self._line.previous and not ready[-1].row:
            entry = ready.pop()
            entry.stage = HELD
            self._move(entry, self._tail, in_front=True)

    def move_to_line(self, entry: MessageEntry) -> None:
        """Let the first of the tail go to Kafka."""
        self._move(entry, self._line)
        self.ready([entry])

    def load(self, entry: MessageEntry, *, dead: bool) -> None:
        """Let what has waited on disk alone go to Kafka, or to the dead letters."""
        self.take([entry], LINE)
        if dead:
            self.divert(entry, entry.record)
        self.ready([entry])

    def unwritten_line(self) -> list[MessageEntry]:
        """What of the line is in memory alone; it is behind all that is on disk as well."""
        found, at = [], self._line.previous
        while isinstance(at, MessageEntry) and not at.row:
            found.append(at)
            at = at.previous
        return [entry for entry in reversed(found) if entry.stage is not REFUSED]

    def note_rows(self, entries: Iterable[MessageEntry], first: int) -> None:
        """Note that entries are on disk as well, in rows from that number on."""
        for row, entry in enumerate(entries, first):
            entry.row = row

    def store(self, entries: Sequence[MessageEntry]) -> None:
        """Leave entries to the disk, which has them, too."""
        self._leave(entries, STORED)
        for entry in entries:
            self._failures.pop(entry, None)
        self.line_ends = self.line_ends and self.ends

    def forget_rows(self) -> None:
        """Note that the disk has lost what is in flight, or has never had it."""
        for entry in self:
            entry.row = 0

    @staticmethod
    def _move(entry: MessageEntry, head: Ring, *, in_front: bool = False) -> None:
        """Put an entry at the end, or in front, of another ring."""
        entry.previous.next, entry.next.previous = entry.next, entry.previous
        previous = head if in_front else head.previous
        following = previous.next
        entry.previous, entry.next = previous, following
        previous.next = following.previous = entry
