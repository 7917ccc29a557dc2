"""What a route from ROS has taken and not ended yet."""

import sys
from collections import deque
from collections.abc import Sequence

from ros2_kafka_bridge.endpoints import Message, Outgoing

_ENTRY_BYTES = 400  # of bookkeeping for each entry, so that small messages count too


class Entry:
    """One message on its way.

    Args:
        number: Given by the route, ascending.
        record: What is to be produced.
        message: What it was made of; it is not kept.
        taken_s: When that was taken, by the monotonic clock.
    """

    produced_s: float  # when the producer took it last

    __slots__ = (
        'alone', 'dead', 'gid', 'in_line', 'made_ns', 'number', 'on_disk', 'produced_s', 'record',
        'refused', 'seq', 'size_bytes', 'taken_bytes', 'taken_s',
    )  # fmt: skip

    def __init__(self, number: int, record: Outgoing, message: Message, taken_s: float) -> None:
        self.number = number
        self.record = record
        cdr, self.gid, self.seq, self.made_ns = message
        self.taken_bytes = len(cdr)
        self.taken_s = taken_s
        self.size_bytes = len(record.value or b'') + _ENTRY_BYTES
        self.alone = False  # goes in a request of its own
        self.dead = False  # goes to the dead letters
        self.refused = False  # ends the route, and goes nowhere
        self.in_line = False  # of the producer; others still have to be written to disk
        self.on_disk = False


class Window:
    """The entries of a route, by number; those of `pending` wait for the producer to take them.

    Args:
        max_entries: How many may be in flight.
        max_bytes: How large they may be together.
    """

    def __init__(self, max_entries: int, max_bytes: int) -> None:
        self.entries: dict[int, Entry] = {}
        self.pending: deque[Entry] = deque()
        self.size_bytes = 0
        self.max_entries = max_entries
        self.max_bytes = max_bytes
        self.stop_at = sys.maxsize  # neither this number nor one behind it goes on to Kafka
        self._number = 0  # of the newest

    def __len__(self) -> int:
        return len(self.entries)

    def count_from(self, number: int) -> None:
        """Give no number again, up to this one."""
        self._number = max(self._number, number)

    def hold(self, record: Outgoing, message: Message, taken_s: float) -> Entry:
        """Make the next entry; the arguments are its own."""
        self._number += 1
        entry = Entry(self._number, record, message, taken_s)
        self.entries[entry.number] = entry
        self.size_bytes += entry.size_bytes
        return entry

    def put(self, entry: Entry) -> None:
        """Take in an entry that was on disk."""
        self.entries[entry.number] = entry
        self.size_bytes += entry.size_bytes

    def remove(self, entry: Entry) -> None:
        """Forget an entry."""
        del self.entries[entry.number]
        self.size_bytes -= entry.size_bytes

    def remove_all(self, entries: Sequence[Entry]) -> None:
        """Forget entries."""
        held = self.entries
        for entry in entries:
            del held[entry.number]
        self.size_bytes -= sum([entry.size_bytes for entry in entries])

    def drop_oldest(self) -> list[Entry]:
        """Forget what is too much of that which waits; returns it."""
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
        """How many more entries may be in flight; 0 also where they are too large together."""
        if self.size_bytes >= self.max_bytes:
            return 0
        return max(0, self.max_entries - len(self.entries))

    def ascending(self) -> list[Entry]:
        """The entries in the order of taking."""
        return [self.entries[number] for number in sorted(self.entries)]
