"""What a route from Kafka has taken and not ended yet, in the order of consumption."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping

from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.place import ASIDE, PENDING, REFUSED, SENT

_ENTRY_BYTES = 400  # of bookkeeping for each entry, so that small records count too
_PASSED = frozenset({Outcome.DROPPED, Outcome.SKIPPED})


class RecordEntry:
    """One record on its way; it holds nothing of the record that is not counted as its size.

    Args:
        record: What was taken; it is not kept.
        value: Of the record.
        taken_s: When it was taken, by the monotonic clock.
    """

    expires_s: float  # by the clock since boot; only where records age
    made_ms: int  # since 1970, by the record or its publisher; not above 0 where that is unknown

    __slots__ = (
        'cdr', 'end', 'expires_s', 'made_ms', 'offset', 'outcome', 'partition', 'place',
        'size_bytes', 'taken_s', 'value_bytes',
    )  # fmt: skip

    def __init__(self, record: Record, value: bytes | None, taken_s: float) -> None:
        self.partition = record.partition() or 0
        self.offset = record.offset() or 0
        self.end = self.offset + 1  # of what is behind it and was dropped, too
        self.value_bytes = size_bytes = 0 if value is None else len(value)
        self.size_bytes = size_bytes + _ENTRY_BYTES
        self.taken_s = taken_s
        self.cdr = b''
        self.outcome: Outcome | None = None
        self.place = ASIDE


class RecordWindow:
    """The entries of a route; tells how far each partition has come as they leave.

    An entry waits in `pending` until the history takes it, then in `unconfirmed` until its readers
    have it. One that has ended leaves once all before it have: only then does its offset count.
    One that was passed over may leave sooner: what is before it in its partition counts for both.
    An entry that must end the route lets neither itself nor one behind it go on to ROS: they are
    read again. The route ends once all before it have ended.

    Args:
        max_entries: How many may wait, where the oldest are dropped.
        max_bytes: How large all may be together.
        advance: Told the next offset to read of partitions whose entries have left.
    """

    def __init__(
        self, max_entries: int, max_bytes: int, advance: Callable[[Mapping[int, int]], None]
    ) -> None:
        self.entries: deque[RecordEntry] = deque()
        self.pending: deque[RecordEntry] = deque()
        self.unconfirmed: deque[RecordEntry] = deque()
        self.failure: RouteError | None = None  # what ends the route
        self.size_bytes = 0
        self.max_entries = max_entries
        self.max_bytes = max_bytes
        self._advance = advance
        self._confirmed = 0  # of those published since a reader was lost last
        self._gone: set[RecordEntry] = set()  # of topics that are

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def is_full(self) -> bool:
        """Whether no more is to be read."""
        return self.size_bytes > self.max_bytes

    @property
    def value_bytes(self) -> int:
        """How large the values of its records were."""
        return sum(entry.value_bytes for entry in self.entries)

    def add(self, entry: RecordEntry) -> None:
        """Hold one more, which comes behind all others."""
        self.entries.append(entry)
        self.size_bytes += entry.size_bytes

    def grow(self, entry: RecordEntry) -> None:
        """Count a message that is larger than the value which it was made of."""
        self.size_bytes += len(entry.cdr) - entry.size_bytes
        entry.size_bytes = len(entry.cdr)

    def wait(self, entry: RecordEntry) -> None:
        """Let an entry wait for the history to take it, behind all others."""
        entry.place = PENDING
        self.pending.append(entry)

    # The end of a route

    def end_at(self, entry: RecordEntry, failure: RouteError) -> None:
        """Let the route end at an entry, once all before it have ended."""
        entry.place = REFUSED
        self.failure = failure

    @property
    def failure_in_front(self) -> RouteError | None:
        """What ends the route, once all before it have ended."""
        return self.failure if self.entries and self.entries[0].place is REFUSED else None

    # What the readers have

    def confirm(self, confirmed: int, outcome: Outcome) -> None:
        """End the oldest entries that were published.

        Args:
            confirmed: How many every reader has, of those published since one was lost last.
            outcome: What became of them.
        """
        unconfirmed = self.unconfirmed
        for _ in range(confirmed - self._confirmed):
            entry = unconfirmed.popleft()
            if entry.outcome is None:
                entry.outcome = outcome
        self._confirmed = confirmed

    def take_back(self) -> int:
        """Let what was published and not confirmed wait again; tells how many those are."""
        again = [entry for entry in self.unconfirmed if entry.outcome is None]
        self.unconfirmed.clear()
        self._confirmed = 0
        for entry in again:
            entry.place = PENDING
        self.pending.extendleft(reversed(again))
        return len(again)

    # What leaves

    def settle(self) -> list[RecordEntry]:
        """Let go of what has ended, and all before it has; their positions move on."""
        ended = self._settle_gone() if self._gone else []
        entries, before = self.entries, len(ended)
        while entries and entries[0].outcome is not None:
            ended.append(entries.popleft())
        if len(ended) > before:
            self._advance({entry.partition: entry.end for entry in ended[before:]})
            self.size_bytes -= sum([entry.size_bytes for entry in ended[before:]])
        return ended

    def _settle_gone(self) -> list[RecordEntry]:
        """Let go of what has ended of topics that are gone: there is no position to wait for."""
        ended = [entry for entry in self.entries if entry in self._gone and entry.outcome]
        self._gone.difference_update(ended)
        left = set(ended)
        self.entries = deque(entry for entry in self.entries if entry not in left)
        self.size_bytes -= sum([entry.size_bytes for entry in ended])
        return ended

    def drop_oldest(self) -> list[RecordEntry]:
        """Drop what waits and is too much; returns what has left.

        It leaves at once, also where others before it stay for long: there is no end to what
        comes behind a subscriber that does not take.
        """
        pending = self.pending
        is_too_much = self.is_full
        # The newest stays, also where what is published fills the window alone.
        while len(pending) > 1 and (len(pending) > self.max_entries or self.is_full):
            entry = pending.popleft()
            entry.outcome = Outcome.DROPPED
            self.size_bytes -= entry.size_bytes
            entry.size_bytes = 0
            is_too_much = True
        return self._close_up() if is_too_much else []

    def _close_up(self) -> list[RecordEntry]:
        """Let go of what was passed over; what is before it in its partition moves on for it."""
        kept: deque[RecordEntry] = deque()
        left: list[RecordEntry] = []
        last: dict[int, RecordEntry] = {}  # of each partition
        positions: dict[int, int] = {}
        for entry in self.entries:
            is_gone = entry in self._gone
            if entry.outcome not in _PASSED:
                kept.append(entry)
                if not is_gone:
                    last[entry.partition] = entry
                continue
            left.append(entry)
            if is_gone:
                continue
            if entry.partition in last:
                last[entry.partition].end = entry.end
            else:
                positions[entry.partition] = entry.end
        self._advance(positions)
        self.entries = kept
        self._gone.difference_update(left)
        self.size_bytes -= sum([entry.size_bytes for entry in left])
        return left

    # What is given back to Kafka, or cannot be

    def detach(self, partitions: frozenset[int]) -> None:
        """Let entries go their way without moving a position: their topic is gone."""
        self._gone.update(self.of(partitions))

    def of(self, partitions: frozenset[int]) -> list[RecordEntry]:
        """The entries of these partitions, as far as anybody could read them again."""
        here = [entry for entry in self.entries if entry.partition in partitions]
        return [entry for entry in here if entry not in self._gone] if self._gone else here

    def unpublished(self) -> list[RecordEntry]:
        """The entries that wait, and those behind them: they are read again with them."""
        if not self.pending and self.failure is None:
            return []
        holes: set[int] = set()
        found = []
        for entry in self.entries:
            waits = entry.outcome is None and entry.place is not SENT
            is_gone = entry in self._gone  # then none behind it has to come with it
            if waits and not is_gone:
                holes.add(entry.partition)
            if waits if is_gone else entry.partition in holes:
                found.append(entry)
        return found

    def give_back(self, entries: Iterable[RecordEntry]) -> int:
        """Let go of entries without a position for them: they are read again.

        Returns:
            How many are not, for their topic is gone.
        """
        gone = self._gone.intersection(entries)
        self._gone -= gone
        for entry in entries:
            entry.outcome = Outcome.RETURNED
            self.size_bytes -= entry.size_bytes
        self.entries = deque(e for e in self.entries if e.outcome is not Outcome.RETURNED)
        self.pending = deque(e for e in self.pending if e.outcome is None)
        if all(entry.place is not REFUSED for entry in self.entries):
            self.failure = None  # whoever reads again what was to end the route meets it anew
        return len(gone)

    def holds_unconfirmed(self, partitions: frozenset[int]) -> bool:
        """Whether something of these partitions was published and has not ended."""
        here = (entry for entry in self.unconfirmed if entry.partition in partitions)
        return any(entry.outcome is None and entry not in self._gone for entry in here)
