"""Where the partitions of a topic stand: what was read, what has ended, what the group was told.

A source keeps its offsets nowhere else: who reads, commits, joins, measures the lag or looks for a
beginning asks here.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from ros2_kafka_bridge.kafka.topic_id import TopicId


class _HasOffset(Protocol):
    """A record as far as it is looked at here."""

    def partition(self) -> int | None:
        """Number of its partition."""
        ...

    def offset(self) -> int | None:
        """Its offset in the partition."""
        ...


class Committed(NamedTuple):
    """What a group has got of a partition.

    Args:
        offset: Of the next record to read.
        of: The topic that it is of; None where whoever has committed it did not say so.
    """

    offset: int
    of: TopicId | None


@dataclass(slots=True)
class Partition:
    """Where one partition stands. All are offsets; None where that is not known.

    Args:
        number: Of the partition in its topic.
        committed: What the group has, as it has told or been told.
        position: Of the next record to read, were the route to begin again: all before it in
            the order of consumption have ended.
        read: Behind the last record that was handed out.
        end: There is nothing left to read before it. Marks of transactions have offsets, too, and
            are no records.
        told_end: Where it ended when the broker was asked last.
        wanted: Of the first record that was deleted before it was read, until one behind it is.
        of: The topic that these offsets are of.
    """

    number: int
    committed: int | None = None
    position: int | None = None
    read: int | None = None
    end: int | None = None
    told_end: int | None = None
    wanted: int | None = None
    of: TopicId | None = None

    @property
    def next(self) -> int | None:
        """The next record to read, as far as anybody knows."""
        return self.committed if self.position is None else self.position

    @property
    def reached(self) -> int | None:
        """How far it was read."""
        known = (self.committed, self.position, self.read, self.end)
        return max((offset for offset in known if offset is not None), default=None)

    def advance(self, position: int) -> None:
        """Note that all before `position` have ended."""
        self.position = position
        self._skip()

    def reach_end(self, end: int) -> None:
        """Note that there is nothing left before `end`.

        Where nothing was handed out yet, there was no record up to there: the group is told, or
        marks of transactions would be a lag for ever.
        """
        self.end = end
        if self.position is None:
            self.position = end
        self._skip()

    def _skip(self) -> None:
        """Move the position behind what is no record, where all that was handed out has ended.

        What was given back has not: the end lies behind that, too.
        """
        if self.end is None or self.position is None:
            return
        if self.read is None or self.read <= self.position:
            self.position = max(self.position, self.end)


class Partitions:
    """The partitions that a source has, and how far those had come that it has lost."""

    def __init__(self) -> None:
        self.have_metadata = True  # what is committed; False where a broker takes none so long
        self._here: dict[int, Partition] = {}
        self._lost: dict[int, Partition] = {}

    def __contains__(self, number: object) -> bool:
        return number in self._here

    def __iter__(self) -> Iterator[Partition]:
        return iter(self._here.values())

    def __len__(self) -> int:
        return len(self._here)

    def __getitem__(self, number: int) -> Partition:
        return self._here[number]

    def get(self, number: int | None) -> Partition | None:
        """Where one stands; None where it is not here."""
        return None if number is None else self._here.get(number)

    @property
    def numbers(self) -> frozenset[int]:
        """Which are here."""
        return frozenset(self._here)

    @property
    def are_lost(self) -> bool:
        """Whether some were lost of which something was read, and are not here again."""
        return bool(self._lost)

    @property
    def owe_lost(self) -> bool:
        """Whether of a lost one the group has not got how far it had come."""
        return any(partition.position != partition.committed for partition in self._lost.values())

    @property
    def are_cut_off(self) -> bool:
        """Whether records of some are missing, and nothing was read behind them yet."""
        return any(partition.wanted is not None for partition in self)

    @property
    def positions(self) -> dict[int, int]:
        """The position of each where that is known."""
        return {p.number: p.position for p in self if p.position is not None}

    @property
    def news(self) -> dict[int, int]:
        """The positions that the group has not got."""
        return {n: at for n, at in self.positions.items() if at != self._here[n].committed}

    @property
    def reached(self) -> dict[int, int]:
        """How far each was read where that is known."""
        return {p.number: p.reached for p in self if p.reached is not None}

    def metadata(self, number: int) -> str:
        """What is committed beside an offset; of one that is not here, that of the others."""
        known = self._here.get(number) or next(iter(self), None)
        if known is None or known.of is None or not self.have_metadata:
            return ''
        return known.of.metadata

    # What comes and goes

    def assign(self, numbers: Iterable[int]) -> None:
        """Begin with partitions of which nothing is known."""
        for number in numbers:
            self._here.setdefault(number, Partition(number))

    def reset(self, number: int) -> None:
        """Forget what is known of one that stays."""
        self._here[number] = Partition(number, of=self._here[number].of)

    def begin_anew(self, of: TopicId | None) -> None:
        """Forget all that is known of those that are here: another topic has them now."""
        for number in self._here:
            self._here[number] = Partition(number, of=of)

    def forget(self, numbers: Iterable[int]) -> None:
        """Forget partitions that were handed over."""
        for number in numbers:
            self._here.pop(number, None)

    def lose(self, numbers: Iterable[int]) -> None:
        """Forget partitions, but for how far the route had come."""
        for number in numbers:
            partition = self._here.pop(number, None)
            if partition is not None and partition.position is not None:
                self._lost[number] = partition

    def resume(self, told: Mapping[int, Committed]) -> dict[int, int]:
        """Note what the group has got; go on with those that were lost if nobody has read on.

        Args:
            told: What the group has got of partitions that are here or back.

        Returns:
            The positions of those that go on.
        """
        self.note_committed({number: it.offset for number, it in told.items()})
        back = {number: self._lost.pop(number) for number in told if number in self._lost}
        resumed = {
            number: lost.position
            for number, lost in back.items()
            if lost.position is not None
            and lost.of == self._here[number].of
            and (lost.committed or 0) <= told[number].offset < lost.position
        }
        self.advance(resumed)
        return resumed

    def forget_lost(self, numbers: Iterable[int]) -> None:
        """Forget lost ones that are back."""
        for number in numbers:
            self._lost.pop(number, None)

    def clear(self) -> None:
        """Forget all."""
        self._here.clear()
        self._lost.clear()

    # What is read, ends and is committed

    def hand_out(self, records: Sequence[_HasOffset]) -> None:
        """Note records that go to the route now, in the order of reading."""
        last = {record.partition() or 0: record for record in records}
        for number, record in last.items():
            if (partition := self._here.get(number)) is not None:
                if partition.position is None:
                    partition.position = _first(records, number)
                partition.read = (record.offset() or 0) + 1

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note positions: all before them have ended."""
        for number, position in positions.items():
            if (partition := self._here.get(number)) is not None:
                partition.advance(position)

    def reach_end(self, number: int, end: int) -> None:
        """Note that there is nothing left before `end`."""
        if (partition := self._here.get(number)) is not None:
            partition.reach_end(end)

    def note_committed(self, offsets: Mapping[int, int]) -> None:
        """Note what the group has got; an answer may come when another reads on already."""
        for number, offset in offsets.items():
            if (partition := self._here.get(number)) is not None:
                partition.committed = offset


def _first(records: Sequence[_HasOffset], number: int) -> int:
    """The offset of the first of them in a partition."""
    return next(record.offset() or 0 for record in records if (record.partition() or 0) == number)
