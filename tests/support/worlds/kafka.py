"""One topic and one group in memory, as its brokers keep them: for worlds of a reader."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from confluent_kafka import OFFSET_INVALID, KafkaError

TOPIC = 't'
Offsets = Mapping[int, 'Stored']


class Stored(NamedTuple):
    """What the group has got of a partition."""

    offset: int
    metadata: str


class Place(NamedTuple):
    """A partition as an answer names it; confluent-kafka lets nobody else set its error."""

    topic: str
    partition: int
    offset: int = OFFSET_INVALID
    metadata: str | None = ''
    error: KafkaError | None = None


class Clock:
    """Time that passes where somebody waits, and no other; a look at it takes a moment, too."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        self.now_s += 1e-6
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@dataclass
class Log:
    """One partition: some of its offsets are records, the others marks or gone.

    Args:
        low: All before it were deleted.
        stable: Readers of what is committed get nothing behind it.
        high: Of the next record.
        records: Offsets that hold one, also of a transaction without an end.
        shown: Those that readers could get, ever.
        gone: Those of them that were deleted or compacted.
        deleted: Those of them that were deleted.
        passed: Those of them before which the group began.
        pending: Of a transaction without an end.
    """

    low: int = 0
    stable: int = 0
    high: int = 0
    records: list[int] = field(default_factory=list)
    shown: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)
    deleted: set[int] = field(default_factory=set)
    passed: set[int] = field(default_factory=set)
    pending: list[int] | None = None

    def append(self, count: int) -> list[int]:
        new = [*range(self.high, self.high + count)]
        self.records += new
        self.high += count
        self._show()
        return new

    def mark(self, count: int) -> None:
        self.high += count
        self._show()

    def begin(self, count: int) -> None:
        if self.pending is None:
            self.pending = []
            self.pending += self.append(count)

    def end(self, *, aborted: bool) -> None:
        if self.pending is not None:
            if aborted:
                self.records = [it for it in self.records if it not in self.pending]
            self.pending = None
            self.mark(1)

    def delete(self, count: int) -> None:
        self.low = max(self.low, min(self.low + count, self.stable))
        dead = {it for it in self.records if it < self.low}
        self.records = [it for it in self.records if it >= self.low]
        self.gone |= dead
        self.deleted |= dead

    def compact(self, which: int) -> None:
        if older := [it for it in self.records if it < self.stable - 1]:
            dead = older[which % len(older)]
            self.records.remove(dead)
            self.gone.add(dead)

    def _show(self) -> None:
        if self.pending is None:
            self.shown |= {it for it in self.records if it >= self.stable}
            self.stable = self.high


@dataclass(eq=False)
class Reading:
    """How far a client reads a partition that it has.

    Args:
        number: Of the partition.
        start: Where it begins; negative while that has to be asked for.
        at: The next offset to fetch.
        version: What was fetched under another does not count any more.
        ended: The end that was told last.
        is_stopped: It was told that there is nothing at this offset.
        low: Where the partition began when its beginning was asked for.
        is_gone: Its partition was taken away.
    """

    number: int
    start: int
    at: int
    version: int = 0
    ended: int | None = None
    is_stopped: bool = False
    low: int | None = None
    is_gone: bool = False

    def rewind(self) -> None:
        """Read again what was fetched and not handed out."""
        self.version += 1
        self.at, self.ended, self.is_stopped = self.start, None, False


@dataclass(frozen=True, eq=False)
class Told:
    """What a client hands out: a record, or what happens in their midst."""

    reading: Reading
    version: int
    at: int
    code: int | None = None

    def error(self) -> KafkaError | None:
        return None if self.code is None else KafkaError(self.code)

    def partition(self) -> int:
        return self.reading.number

    def offset(self) -> int | None:
        return self.at if self.at >= 0 else None

    def key(self) -> None:
        pass

    def value(self) -> bytes:
        return b'%d' % self.at

    def headers(self) -> None:
        pass

    def timestamp(self) -> tuple[int, int]:
        return 0, 0


class Gap(NamedTuple):
    """What a reader did not find any more.

    Args:
        number: Of the partition.
        wanted: The first offset that is gone.
        low: The first that was there.
        reached: The first of a record or an end behind it.
    """

    number: int
    wanted: int
    low: int
    reached: int


class Group:
    """The coordinator of a group in which one member is of interest.

    Args:
        on_commit: Told what this member is about to move an offset to.
    """

    def __init__(self, on_commit: Callable[[int, int], None]) -> None:
        self.offsets: dict[int, Stored] = {}
        self.share: frozenset[int] = frozenset()  # what that member is to have
        self.held: frozenset[int] = frozenset()  # what it has, as far as its session holds
        self.refusals: list[int] = []  # error codes for its next commits
        self.unsaid = 0  # so many of its next commits are done, and the answer is lost
        self.holds_answers = False
        self.has_refused = False
        self.takes_metadata = True
        self.life = 0  # of the member's session; another has another
        self.member: Any = None
        self._on_commit = on_commit

    def let_in(self, member: Any) -> None:
        self.life += 1
        self.member, self.held = member, frozenset()

    def give_up(self, member: Any) -> None:
        """Its session has ended, or it has left."""
        if self.member is member:
            self.member, self.held = None, frozenset()

    def take(self, member: Any, life: int, request: Offsets) -> KafkaError | None:
        """Take a commit; returns what is wrong with it."""
        error = None
        if self.member is not member or self.life != life:
            error = KafkaError(KafkaError.UNKNOWN_MEMBER_ID)
        elif not self.takes_metadata and any(stored.metadata for stored in request.values()):
            error = KafkaError(KafkaError.OFFSET_METADATA_TOO_LARGE)
        elif self.refusals:
            error = KafkaError(self.refusals.pop(0))
        if error is not None:
            self.has_refused = True
            return error
        for number, stored in request.items():
            self._on_commit(number, stored.offset)
        self.offsets |= request
        if self.unsaid:
            self.unsaid -= 1
            return KafkaError(KafkaError.REQUEST_TIMED_OUT)
        return None


class Kafka:
    """All that a client talks to."""

    def __init__(self, partitions: int, on_commit: Callable[[int, int], None]) -> None:
        self.clock = Clock()
        self.logs = [Log() for _ in range(partitions)]
        self.group = Group(on_commit)
        self.group.share = self.numbers
        self.is_away = False
        self.later: list[tuple[int, Callable[[], None]]] = []
        self.newest: Any = None  # of the bridge's clients: it has taken the place of the others
        self.gaps: list[Gap] = []
        self.on_assigned: Callable[[frozenset[int]], None] = lambda _: None
        self.on_handed_over: Callable[[frozenset[int]], None] = lambda _: None

    @property
    def numbers(self) -> frozenset[int]:
        return frozenset(range(len(self.logs)))

    def grow(self) -> None:
        """Add a partition, and give it to the bridge."""
        self.logs.append(Log())
        self.group.share |= {len(self.logs) - 1}

    def work(self) -> None:
        """Let happen what was to come while a client works."""
        due = [happens for steps, happens in self.later if steps <= 1]
        self.later = [(steps - 1, happens) for steps, happens in self.later if steps > 1]
        for happens in due:
            happens()
