"""What a route has taken and not ended yet, in the order of taking and in lanes."""

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Generic, TypeVar, cast

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.stage import HELD, READY, SENT, Stage

ENTRY_BYTES = 400
"""Of bookkeeping for each entry, so that small ones count, too."""


class Ring:
    """Open entries in the order of taking, linked in both directions; this head closes it."""

    __slots__ = ('end', 'next', 'previous', 'reported')

    def __init__(self) -> None:
        self.previous: Ring | Entry = self
        self.next: Ring | Entry = self
        self.end = self.reported = 0  # the position of what is read; not above 0 at the beginning

    def __iter__(self) -> Iterator['Entry']:
        at = self.next
        while at is not self:
            following = at.next  # the entry may leave meanwhile
            yield cast('Entry', at)
            at = following


class Entry:
    """One record or message in flight; changed by its flight alone.

    Attributes:
        stage: Where it is, and then what became of it.
        lane: In which it waits.
        record: What is to be produced; of a record to ROS, once it is a dead letter.
        size_bytes: What it is accounted for.
        taken_s: When it was taken, by the monotonic clock.
        end: Of a record, the position behind it, and behind what has ended after it.
        previous: In its ring.
        next: In its ring.
    """

    stage: Stage | Outcome
    lane: 'Lane[Any]'
    record: Outgoing
    size_bytes: int
    taken_s: float
    end: int
    previous: 'Ring | Entry'
    next: 'Ring | Entry'

    __slots__ = (
        'end', 'lane', 'next', 'previous', 'record', 'size_bytes', 'stage', 'taken_s',
    )  # fmt: skip

    @property
    def outcome(self) -> Outcome | None:
        """What became of it; None while it has not ended."""
        return self.stage if isinstance(self.stage, Outcome) else None


E = TypeVar('E', bound=Entry)


class Lane(Generic[E]):
    """What shares one order and one back-pressure, that of the sink behind it."""

    __slots__ = ('ready',)

    def __init__(self) -> None:
        self.ready: deque[E] = deque()


class Flight(Generic[E]):
    """Owns the entries of a route, and their stages.

    Args:
        max_entries: How many there may be.
        max_bytes: How large all may be together.
        drops: Whether the oldest that wait are dropped where they are too much. Then so much may
            be with the sink, and so much more, with what goes to the dead letters, may wait.
    """

    def __init__(self, max_entries: int, max_bytes: int, *, drops: bool = False) -> None:
        self.lane: Lane[E] = Lane()
        self.letters: Lane[E] = Lane()  # what goes to the dead letters
        self.size_bytes = 0
        self.letter_bytes = 0  # of it, what goes to the dead letters
        self.max_entries = max_entries
        self.max_bytes = max_bytes
        self.drops = drops
        self._rings: dict[int, Ring] = {}
        self._open = 0
        self._ended: list[E] = []

    def __len__(self) -> int:
        """How many have not ended, or were not told by `settled`."""
        return self._open + len(self._ended)

    def __iter__(self) -> Iterator[E]:
        """Those that have not ended; of each ring in the order of taking."""
        for ring in self._rings.values():
            yield from cast('Iterator[E]', iter(ring))

    def take(self, entries: Sequence[E], ring: int) -> None:
        """Hold more, in their order behind all others of their ring."""
        head = self._rings.get(ring)
        if head is None:
            head = self._rings[ring] = Ring()
        last, lane, size_bytes = head.previous, self.lane, 0
        for entry in entries:
            entry.stage = HELD
            entry.lane = lane
            entry.previous = last
            last.next = entry
            last = entry
            size_bytes += entry.size_bytes
        last.next, head.previous = head, last
        self.size_bytes += size_bytes
        self._open += len(entries)

    def grow(self, entry: E, size_bytes: int) -> None:
        """Count an entry as larger than it was."""
        more_bytes = size_bytes - entry.size_bytes
        self.size_bytes += more_bytes
        self.letter_bytes += more_bytes if entry.lane is self.letters else 0
        entry.size_bytes = size_bytes

    def divert(self, entry: E, letter: Outgoing) -> None:
        """Send an entry to the dead letters instead, once it is ready."""
        self.letter_bytes += entry.size_bytes if entry.lane is self.lane else 0
        entry.lane, entry.record = self.letters, letter

    # From a lane to its sink

    def ready(self, entries: Sequence[E]) -> None:
        """Let entries wait for their sink, in their order behind all others of their lane."""
        for entry in entries:
            entry.stage = READY
            entry.lane.ready.append(entry)

    def sent(self, lane: Lane[E], count: int) -> list[E]:
        """Note that the sink has the first of a lane; returns them."""
        pop = lane.ready.popleft
        sent = [pop() for _ in range(count)]
        for entry in sent:
            entry.stage = SENT
        return sent

    def hold_first(self, lane: Lane[E]) -> E:
        """Take the first of a lane out of its line; returns it."""
        entry = lane.ready.popleft()
        entry.stage = HELD
        return entry

    def requeue(self, entries: Sequence[E]) -> None:
        """Let entries of one lane, which were sent, wait again, in front of all others."""
        if not entries:
            return
        for entry in entries:
            entry.stage = READY
        entries[0].lane.ready.extendleft(reversed(entries))

    # What ends

    def confirm(self, entries: Iterable[E], outcome: Outcome) -> None:
        """End what the sink has delivered; what was given back meanwhile has left already."""
        self.end([entry for entry in entries if entry.stage is SENT], outcome)

    def end(self, entries: Sequence[E], outcome: Outcome) -> None:
        """End entries that wait in no lane."""
        self._unlink(entries, outcome)
        self._ended += entries

    def settled(self) -> list[E]:
        """What has ended since the last call."""
        ended, self._ended = self._ended, []
        return ended

    # What is too much

    @property
    def fills_window(self) -> bool:
        """Whether it is larger than it may be without dropping."""
        return self.size_bytes > self.max_bytes

    @property
    def is_full(self) -> bool:
        """Whether it is too large for one more; dropping makes room, but of no dead letter."""
        return self.fills_window and not (self.drops and self.letter_bytes <= self.max_bytes)

    def drop_oldest(self) -> list[E]:
        """Drop what waits for the sink and is too much, all but the newest; returns it."""
        ready = self.lane.ready
        if len(ready) <= self.max_entries and not self.fills_window:
            return []
        dropped = self.excess(ready, self.max_bytes - self.letter_bytes)
        for _ in dropped:
            ready.popleft()
        self.end(dropped, Outcome.DROPPED)
        return dropped

    def excess(self, waiting: Collection[E], most_bytes: int) -> list[E]:
        """Which of those that wait, the oldest, are too many or too large; never the newest."""
        too_many = len(waiting) - self.max_entries
        excess_bytes = sum(entry.size_bytes for entry in waiting) - most_bytes
        found: list[E] = []
        for entry in islice(waiting, max(0, len(waiting) - 1)):
            if too_many <= len(found) and excess_bytes <= 0:
                break
            found.append(entry)
            excess_bytes -= entry.size_bytes
        return found

    @property
    def pushes_out(self) -> bool:
        """Whether one more like the largest that waits would push out the oldest."""
        sizes = [entry.size_bytes for entry in self.lane.ready]
        if not self.drops or not sizes:
            return False
        waiting_bytes = self.letter_bytes + sum(sizes) + max(sizes)
        return len(sizes) >= self.max_entries or waiting_bytes > self.max_bytes

    def _leave(self, entries: Sequence[E], stage: Stage | Outcome) -> None:
        """Let go of entries that come again."""
        some_wait = any(entry.stage is READY for entry in entries)
        self._unlink(entries, stage)
        if some_wait:
            self._keep_ready()

    def _unlink(self, entries: Sequence[E], stage: Stage | Outcome) -> None:
        letters, size_bytes = self.letters, 0
        for entry in entries:
            previous, following = entry.previous, entry.next
            previous.next, following.previous = following, previous
            del entry.previous, entry.next  # who keeps it keeps none that came behind it
            entry.stage = stage
            size_bytes += entry.size_bytes
            if entry.lane is letters:
                self.letter_bytes -= entry.size_bytes
        self.size_bytes -= size_bytes
        self._open -= len(entries)

    def _keep_ready(self) -> None:
        """Take out of the lanes what is not ready any more."""
        for lane in (self.lane, self.letters):
            lane.ready = deque(entry for entry in lane.ready if entry.stage is READY)
