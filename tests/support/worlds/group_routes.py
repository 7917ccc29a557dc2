"""A route from Kafka whose records end when a world says so."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from support.worlds.kafka import Told

from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.records import RecordEntry, RecordFlight


def settle(source: KafkaSource, positions: Mapping[int, int]) -> None:
    """Tell a source how far its partitions have come."""
    source.advance(positions)


class Witness(Protocol):
    """Who looks at what a route does."""

    def handed_out(self, record: Told, kept: int) -> None:
        """A record has come; what is before `kept` was lost, and had ended before."""

    def ended(self, number: int, offset: int) -> None:
        """A record has ended."""

    def hands_over(self, owed: Mapping[int, int]) -> None:
        """The group is to get these offsets before another gets their partitions."""

    def is_told(self, owed: Mapping[int, int], when: str) -> None:
        """The group is to have got these offsets."""


class Route:
    """Takes what its source hands out, and lets it end when it is told to.

    Args:
        witness: Who looks at that.
        source: Of its records; it may be opened for it alone.
    """

    def __init__(self, witness: Witness, source: KafkaSource) -> None:
        self.finishes = 0  # so many records end while a partition is handed over
        self.kept: dict[int, int] = {}  # how far those had come that were lost
        self._source = source
        self._witness = witness
        self._taken: dict[int, list[int]] = {}  # what was handed out, by partition
        self._flight = RecordFlight(10**6, 10**9)

    def open(self, number: int) -> set[int]:
        """Which offsets of a partition have not ended."""
        return {it.offset for it in self._flight if it.partition == number}

    @property
    def is_empty(self) -> bool:
        return not self._flight

    def come(self) -> dict[int, int]:
        """How far each partition has come, as far as anything of it has ended."""
        come = {}
        for number, offsets in self._taken.items():
            open_ = self.open(number)
            if ended := [it for it in offsets if it < min(open_, default=it + 1)]:
                come[number] = ended[-1] + 1
        return come

    def poll(self, limit: int) -> int:
        return self._take(self._source.poll(limit, 0.01))

    def stay(self) -> int:
        return self._take(self._source.stay())

    def _take(self, found: Sequence[Record]) -> int:
        for record in found:
            assert isinstance(record, Told)
            self._witness.handed_out(record, self.kept.get(record.partition(), 0))
            self._taken.setdefault(record.partition(), []).append(record.at)
            self._flight.take([RecordEntry(record, 0.0)], record.partition())
        return len(found)

    def end(self, count: int, seed: int) -> None:
        """Let some end: the first in flight where the seed is even, or any."""
        for turn in range(count):
            if entries := [*self._flight]:
                entry = entries[seed % 2 * (seed + turn * 7) % len(entries)]
                self._flight.end([entry], Outcome.CONFIRMED)
                self._witness.ended(entry.partition, entry.offset)
        self._settle()

    def end_all(self) -> None:
        self.end(len(self._flight), 0)

    def _settle(self) -> None:
        if self._flight.settled():
            settle(self._source, self._flight.positions())

    def close(self) -> bool:
        """End a run of the route; tells whether the group has got all of it."""
        self._settle()
        come = self.come()
        self._taken = {number: [at - 1] for number, at in come.items()}  # the rest goes back
        self._flight.give_back([*self._flight])
        self._flight.forget_all()
        is_told = self._source.commit_now(1.0)
        if is_told:  # of what was not handed over meanwhile
            here = {number: at for number, at in come.items() if number in self._taken}
            self._witness.is_told(here, 'at a stop')
        self._taken = {}
        self._source.close()
        return is_told

    # What the source says

    def revoked(self, partitions: frozenset[int]) -> None:
        self.end(self.finishes, 0)
        self._witness.hands_over({n: at for n, at in self.come().items() if n in partitions})
        self._forget(partitions)
        for number in partitions:
            self.kept.pop(number, None)

    def lost(self, partitions: frozenset[int]) -> None:
        self._settle()
        self.kept |= {n: at for n, at in self.come().items() if n in partitions}
        self._forget(partitions)

    def _forget(self, partitions: frozenset[int]) -> None:
        self._flight.give_back(self._flight.of(partitions))
        self._flight.forget(partitions)
        for number in partitions:
            self._taken.pop(number, None)

    def detached(self, partitions: frozenset[int]) -> None:
        raise AssertionError(f'{partitions} are said to be of a topic that is gone')
