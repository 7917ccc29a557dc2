"""What a route from ROS has taken and not ended yet."""

import sys
import time
from collections import deque
from collections.abc import Iterable

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.spool.store import Row

_ENTRY_BYTES = 400  # of bookkeeping for each entry, so that small messages count too


class Entry:
    """One message on its way."""

    __slots__ = (
        'alone', 'dead', 'gid', 'in_line', 'number', 'on_disk', 'record', 'refused', 'seq',
        'size_bytes',
    )  # fmt: skip

    def __init__(self, number: int, record: Outgoing, gid: bytes, seq: int) -> None:
        self.number = number
        self.record = record
        self.gid = gid
        self.seq = seq
        self.size_bytes = len(record.value or b'') + _ENTRY_BYTES
        self.alone = False  # goes in a request of its own
        self.dead = False  # goes to the dead letters
        self.refused = False  # ends the route, and goes nowhere
        self.in_line = False  # of the producer; others still have to be written to disk
        self.on_disk = False

    def row(self) -> Row:
        """What of it is written to disk."""
        return Row(self.number, time.time_ns(), self.dead, self.gid, self.seq, self.record)


def from_row(row: Row) -> Entry:
    """An entry that was on disk."""
    entry = Entry(row.number, row.record, row.gid, row.seq)
    entry.dead, entry.on_disk = row.dead, True
    return entry


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

    def __len__(self) -> int:
        return len(self.entries)

    def put(self, entry: Entry) -> None:
        """Take in an entry."""
        self.entries[entry.number] = entry
        self.size_bytes += entry.size_bytes

    def remove(self, entry: Entry) -> None:
        """Forget an entry."""
        del self.entries[entry.number]
        self.size_bytes -= entry.size_bytes

    def remove_all(self, entries: Iterable[Entry]) -> None:
        """Forget entries."""
        for entry in entries:
            del self.entries[entry.number]
            self.size_bytes -= entry.size_bytes

    @property
    def room(self) -> int:
        """How many more entries may be in flight; 0 also where they are too large together."""
        if self.size_bytes >= self.max_bytes:
            return 0
        return max(0, self.max_entries - len(self.entries))

    def ascending(self) -> list[Entry]:
        """The entries in the order of taking."""
        return [self.entries[number] for number in sorted(self.entries)]
