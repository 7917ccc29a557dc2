"""What a route from Kafka has in flight: a ring for each partition, which tells how far it is.

An entry that ends leaves its ring at once. What is before it there, or the head, then stands for
it, too (`end`): so the position of a head never passes what has not ended, in whatever order
entries end. What was delivered behind one that stays is not held, but counts with the size of
that: it bounds how much would come again after a crash.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.flight import ENTRY_BYTES, Entry, Flight, Ring
from ros2_kafka_bridge.route.flight.stage import REFUSED, SENT

# They cost nothing when they are read again: nobody gets them.
_PASSED_OVER = frozenset({Outcome.DROPPED, Outcome.SKIPPED})


class RecordEntry(Entry):
    """One record on its way; it holds nothing of the record that is not counted as its size.

    Args:
        record: What was taken; it is not kept, unless it becomes a dead letter.
        taken_s: When it was taken, by the monotonic clock.
    """

    expires_s: float  # by the clock since boot; only where records age
    made_ms: int  # since 1970, by the record or its publisher; not above 0 where that is unknown
    published_s: float  # by the monotonic clock; only where the oldest are dropped

    __slots__ = (
        'cdr', 'expires_s', 'made_ms', 'offset', 'partition', 'published_s', 'value_bytes',
    )  # fmt: skip

    def __init__(self, record: Record, taken_s: float) -> None:
        value = record.value()
        self.partition = record.partition() or 0
        self.offset = record.offset() or 0
        self.end = self.offset + 1
        self.value_bytes = size_bytes = 0 if value is None else len(value)
        self.size_bytes = size_bytes + ENTRY_BYTES
        self.taken_s = taken_s
        self.cdr = b''


class RecordFlight(Flight[RecordEntry]):
    """The flight of a route from Kafka.

    An entry that must end the route lets neither itself nor one behind it go on to ROS: they are
    read again. The route ends once all before it have ended.

    Args:
        max_entries: As of `Flight`.
        max_bytes: As of `Flight`.
        drops: As of `Flight`.
    """

    def __init__(self, max_entries: int, max_bytes: int, *, drops: bool = False) -> None:
        super().__init__(max_entries, max_bytes, drops=drops)
        self.failure: RouteError | None = None  # what ends the route
        self._refused = 0
        self._detached: list[Ring] = []  # of topics that are gone: there is no position to tell

    def take_records(self, entries: Sequence[RecordEntry]) -> None:
        """Hold more, in the order of reading."""
        of_each: dict[int, list[RecordEntry]] = {}
        for entry in entries:
            of_each.setdefault(entry.partition, []).append(entry)
        for number, of_one in of_each.items():
            self.take(of_one, number)

    def __iter__(self) -> Iterator[RecordEntry]:
        """Those that have not ended; of each partition in the order of taking."""
        return chain(super().__iter__(), self._of(self._detached))

    @property
    def value_bytes(self) -> int:
        """How large the values of its records were."""
        return sum(entry.value_bytes for entry in self)

    # What ends

    def end(self, entries: Sequence[RecordEntry], outcome: Outcome) -> None:
        """End entries that wait in no lane."""
        comes_again = outcome not in _PASSED_OVER
        letters, size_bytes = self.letters, 0
        for entry in entries:
            previous, following = entry.previous, entry.next
            previous.end = entry.end
            previous.next, following.previous = following, previous
            del entry.previous, entry.next  # who keeps it keeps none that came behind it
            entry.stage = outcome
            if entry.lane is letters:
                self.letter_bytes -= entry.size_bytes
            size_bytes += entry.size_bytes
            if comes_again and isinstance(previous, RecordEntry):
                self.grow(previous, previous.size_bytes + entry.size_bytes)
        self.size_bytes -= size_bytes
        self._open -= len(entries)
        self._ended += entries

    def positions(self) -> dict[int, int]:
        """The next offset to read of the partitions that have moved since the last call."""
        moved = {}
        for number, ring in self._rings.items():
            if ring.end != ring.reported:
                ring.reported = moved[number] = ring.end
        return moved

    # The end of a route

    def refuse(self, entry: RecordEntry, failure: RouteError) -> None:
        """Let the route end at an entry, once all before it have ended."""
        entry.stage = REFUSED
        self.failure = failure
        self._refused += 1

    @property
    def failure_in_front(self) -> RouteError | None:
        """What ends the route, once all before it have ended."""
        return self.failure if self._refused == self._open else None

    # What is given back to Kafka, or cannot be

    def detach(self, partitions: frozenset[int]) -> None:
        """Let entries go their way without moving a position: their topic is gone."""
        rings = [self._rings.pop(number) for number in partitions & self._rings.keys()]
        self._detached = [ring for ring in self._detached + rings if ring.next is not ring]

    def of(self, partitions: frozenset[int]) -> list[RecordEntry]:
        """The entries of these partitions, as far as anybody could read them again."""
        rings = [self._rings[number] for number in partitions & self._rings.keys()]
        return [*self._of(rings)]

    def has_sent(self, partitions: frozenset[int]) -> bool:
        """Whether something of these partitions was published and has not ended."""
        return any(e.stage is SENT and e.lane is self.lane for e in self.of(partitions))

    def unsent(self) -> list[RecordEntry]:
        """The entries that wait for ROS, and those behind them: they are read again with them."""
        found = []
        for ring in self._rings.values():
            entries = self._of([ring])
            for entry in entries:
                if self._waits(entry):
                    found += [entry, *entries]
        return found + [entry for entry in self._of(self._detached) if self._waits(entry)]

    def _waits(self, entry: RecordEntry) -> bool:
        return entry.lane is self.lane and entry.stage is not SENT

    def give_back(self, entries: Sequence[RecordEntry]) -> int:
        """Let go of entries without a position for them: they are read again.

        Returns:
            How many are not, for their topic is gone.
        """
        gone = {*self._of(self._detached)}.intersection(entries) if self._detached else set()
        self._refused -= sum(entry.stage is REFUSED for entry in entries)
        self._leave(entries, Outcome.RETURNED)
        if not self._refused:
            self.failure = None  # whoever reads again what was to end the route meets it anew
        return len(gone)

    def forget(self, partitions: frozenset[int]) -> None:
        """Know no position of these partitions any more; nothing of them is in flight."""
        for number in partitions:
            self._rings.pop(number, None)

    def forget_all(self) -> None:
        """Begin anew: nothing is in flight."""
        self._rings.clear()
        self._detached.clear()

    @staticmethod
    def _of(rings: Iterable[Ring]) -> Iterator[RecordEntry]:
        return chain.from_iterable(rings)  # type: ignore[arg-type]
