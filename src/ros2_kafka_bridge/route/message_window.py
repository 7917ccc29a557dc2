"""What a route from ROS has taken and not ended yet."""

import sys
from collections import deque
from collections.abc import Sequence

from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.route.place import ASIDE, PENDING, REFUSED, SENT
from ros2_kafka_bridge.route.rejections import Rejection

_ENTRY_BYTES = 400  # of bookkeeping for each entry, so that small messages count too


class MessageEntry:
    """One message on its way.

    Args:
        number: Given by the route, ascending.
        record: What is to be produced.
        message: What it was made of; it is not kept.
        taken_s: When that was taken, by the monotonic clock.
    """

    produced_s: float  # when the producer took it last

    __slots__ = (
        'gid', 'is_letter', 'is_on_disk', 'made_ns', 'number', 'place', 'produced_s', 'record',
        'seq', 'size_bytes', 'taken_bytes', 'taken_s',
    )  # fmt: skip

    def __init__(self, number: int, record: Outgoing, message: Message, taken_s: float) -> None:
        self.number = number
        self.record = record
        cdr, self.gid, self.seq, self.made_ns = message
        self.taken_bytes = len(cdr)
        self.taken_s = taken_s
        self.size_bytes = len(record.value or b'') + _ENTRY_BYTES
        self.place = ASIDE
        self.is_letter = False  # goes to the dead letters
        self.is_on_disk = False  # as well

    @property
    def is_in_line(self) -> bool:
        """Whether it is on its way to Kafka; a spool has to write the others first."""
        return self.place is PENDING or self.place is SENT


class MessageWindow:
    """The entries of a route, by number; those of `pending` wait for the producer to take them.

    An entry that must end the route lets neither itself nor one behind it go on to Kafka, but for
    what the producer has already. The route ends once all before it have ended.

    Args:
        max_entries: How many may be in flight.
        max_bytes: How large they may be together.
        drops: Whether the oldest that wait are dropped where they are too many.
    """

    def __init__(self, max_entries: int, max_bytes: int, *, drops: bool = False) -> None:
        self.entries: dict[int, MessageEntry] = {}
        self.pending: deque[MessageEntry] = deque()
        self.size_bytes = 0
        self.max_entries = max_entries
        self.max_bytes = max_bytes
        self._drops = drops
        self.failure: Rejection | None = None  # what ends the route
        self.ends_at = sys.maxsize  # number of that entry
        self._number = 0  # of the newest

    def __len__(self) -> int:
        return len(self.entries)

    def count_from(self, number: int) -> None:
        """Give no number again, up to this one."""
        self._number = max(self._number, number)

    def add(self, record: Outgoing, message: Message, taken_s: float) -> MessageEntry:
        """Make the next entry; the arguments are its own."""
        self._number += 1
        entry = MessageEntry(self._number, record, message, taken_s)
        self.entries[entry.number] = entry
        self.size_bytes += entry.size_bytes
        return entry

    def put_back(self, entry: MessageEntry) -> None:
        """Take in an entry that was on disk."""
        self.entries[entry.number] = entry
        self.size_bytes += entry.size_bytes

    def remove(self, entry: MessageEntry) -> None:
        """Forget an entry."""
        del self.entries[entry.number]
        self.size_bytes -= entry.size_bytes

    def remove_all(self, entries: Sequence[MessageEntry]) -> None:
        """Forget entries."""
        held = self.entries
        for entry in entries:
            del held[entry.number]
        self.size_bytes -= sum([entry.size_bytes for entry in entries])

    def drop_oldest(self) -> list[MessageEntry]:
        """Forget what is too much of that which waits, where that is meant; returns it."""
        if not self._drops:
            return []
        pending, dropped = self.pending, []
        while len(pending) > 1 and (
            len(pending) > self.max_entries or self.size_bytes > self.max_bytes
        ):
            entry = pending.popleft()
            self.remove(entry)
            dropped.append(entry)
        return dropped

    @property
    def room(self) -> int:
        """How many more may be taken; 0 also where those in flight are too large together."""
        if self._drops:
            return 0 if self.size_bytes > self.max_bytes else sys.maxsize
        if self.size_bytes >= self.max_bytes:
            return 0
        return max(0, self.max_entries - len(self.entries))

    def ascending(self) -> list[MessageEntry]:
        """The entries in the order of taking."""
        return [self.entries[number] for number in sorted(self.entries)]

    # The end of a route

    def end_at(self, entry: MessageEntry, failure: Rejection) -> None:
        """Let the route end at an entry, once all before it have ended."""
        entry.place = REFUSED
        if entry.number < self.ends_at:
            self.ends_at, self.failure = entry.number, failure
            pending = self.pending
            while pending and pending[-1].number > entry.number:
                pending.pop().place = ASIDE

    def wait_again(self, entries: Sequence[MessageEntry]) -> None:
        """Put back in front, in their order, what the producer could not deliver for now."""
        for entry in entries:
            entry.place = PENDING if self.may_go_on(entry) else ASIDE
        self.pending.extendleft(e for e in reversed(entries) if e.place is PENDING)

    def may_go_on(self, entry: MessageEntry) -> bool:
        """Whether an entry comes before what ends the route."""
        return entry.number < self.ends_at
