"""Whatever happens to records on their way to ROS: each ends once, in order, within its bounds.

The world is what a route sees of it: partitions that are handed over, lost and made anew, readers
that acknowledge, stand still and leave, dead letters that are taken or not. What is asserted is
seen at the ends of the route, and by its counters.
"""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds import flights
from support.worlds.pipeline_to_ros import MINE, House

from ros2_kafka_bridge import kafka_to_ros
from ros2_kafka_bridge.route import pieces, publishing, readiness
from ros2_kafka_bridge.testing.memory import MemoryMessageSink, MemoryRecord, Readers
from ros2_kafka_bridge.threads.stop import Stop

PARTITIONS = (0, 1)
BATCH = 3
LARGEST_BYTES = 4_000
ENTRY_BYTES = 400  # which an entry counts at least

Event = tuple[str, int]
WRITES = ('good', 'good', 'bad', 'own', 'burst', 'burst of bad')
TURNS = ('revoke', 'lose', 'make anew')
READERS = ('reader goes', 'reader comes', 'reader comes', 'reader changes')
EVENTS = st.lists(
    st.tuples(st.sampled_from(WRITES), st.sampled_from(PARTITIONS))
    | st.tuples(st.sampled_from(TURNS), st.sampled_from(PARTITIONS))
    | st.tuples(st.sampled_from(('step', 'acknowledge')), st.integers(1, 5))
    | st.tuples(st.sampled_from(READERS), st.just(0))
    | st.tuples(st.sampled_from(('letters stand', 'letters go', 'rest', 'stop')), st.just(0)),
    min_size=20,
    max_size=80,
)


@dataclass
class Robots(MemoryMessageSink):
    """Readers that have what they have acknowledged.

    Args:
        have: What that is.
        turns: Behind how many publications something of a partition may come again.
    """

    have: set[bytes] = field(default_factory=set)
    turns: dict[int, list[int]] = field(
        default_factory=lambda: {number: [0] for number in PARTITIONS}
    )

    def readers(self) -> Readers:
        told = super().readers()
        if not told.lost:
            since_loss = self.published[len(self.published) - self._since_loss :]
            self.have.update(since_loss[: told.confirmed])
        return told

    def lose_reader(self) -> None:
        super().lose_reader()
        for partition in PARTITIONS:
            self.turn(partition)

    def turn(self, partition: int) -> None:
        self.turns[partition].append(len(self.published))

    def look_at_order(self) -> None:
        """From one turn to the next, each record of a partition is published once, in order."""
        for partition, turns in self.turns.items():
            for begin, end in pairwise([*turns, len(self.published)]):
                marks = [value.split()[1] for value in self.published[begin:end]]
                here = [[int(it) for it in re.split(rb'[.:]', mark)] for mark in marks]
                mine = [it for it in here if it[0] == partition]
                assert all(one < other for one, other in pairwise(mine)), mine


class World:
    """A topic with its records, lives of a route that reads it, and robots behind it."""

    def __init__(self, *, drops: bool) -> None:
        self._when_full = 'drop_oldest' if drops else 'wait'
        self.topic: dict[int, list[bytes]] = {number: [] for number in PARTITIONS}
        self.made = dict.fromkeys(PARTITIONS, 0)  # how often a partition was made anew
        self.owed: set[bytes] = set()  # of topics that are gone
        self.ended: set[bytes] = set()  # as others see it
        self.dropped = 0
        self.newest = b''  # of what was read last
        self._begin(Robots(room=4, matched=0, acknowledging=False), {})

    def _begin(self, sink: Robots, committed: dict[int, int]) -> None:
        self.sink = sink
        self.house = House(
            self.sink, when_full=self._when_full, max_in_flight=4,
            max_in_flight_bytes=LARGEST_BYTES, drain_s=0.0, skip_own=True,
        )  # fmt: skip
        self.house.letters.answering = False
        self.house.source.committed.update(committed)
        for partition in PARTITIONS:
            self._give(partition, committed.get(partition, 0))

    def happens(self, what: str, how: int) -> None:
        match what:
            case 'good' | 'bad' | 'own':
                self._write(what, how)
            case 'burst' | 'burst of bad':
                for _ in range(12):
                    self._write('bad' if 'bad' in what else 'good', how)
            case 'revoke' | 'lose' | 'make anew':
                self._turn(what, how)
            case 'stop':
                self._next_life()
            case 'step':
                self.house.steps(how)
            case 'rest':
                self.house.rests(1)
            case _:
                self._others_do(what, how)
        self._look()

    def _others_do(self, what: str, how: int) -> None:
        if what == 'acknowledge':
            self.sink.acknowledge(how)
        elif what == 'reader comes':
            self.sink.matched = 1
        elif what.startswith('reader'):
            self.sink.matched = 0 if what == 'reader goes' else self.sink.matched
            self.sink.lose_reader()
        else:
            self.house.letters.answering = what == 'letters go'

    def _write(self, kind: str, partition: int) -> None:
        log = self.topic[partition]
        log.append(b'%s %d.%d:%d' % (kind.encode(), partition, self.made[partition], len(log)))
        self._give(partition, len(log) - 1)

    def _give(self, partition: int, first: int) -> None:
        for offset, value in enumerate(self.topic[partition][first:], first):
            headers = MINE if value.startswith(b'own') else None
            record = MemoryRecord(value, offset, partition, header_list=headers)
            self.house.source.waiting.append(record)
            self.newest = value

    def _turn(self, what: str, partition: int) -> None:
        """Let a partition go, and have it again at once, or the one that took its place."""
        source, one = self.house.source, frozenset({partition})
        unread = [it for it in source.waiting if it.partition_number == partition]
        for record in unread:
            source.waiting.remove(record)
        if what == 'make anew':
            source.make_anew(one)
            log = self.topic[partition]
            self.owed |= {*log[: len(log) - len(unread)]}
            self.topic[partition], self.made[partition] = [], self.made[partition] + 1
            source.committed.pop(partition, None)
        else:
            source.revoke(one) if what == 'revoke' else source.lose(one)
            self._give(partition, source.committed.get(partition, 0))
        self.sink.turn(partition)

    def _next_life(self) -> None:
        """Stop with what is in flight, and begin again."""
        self._stop()
        # What was of a topic that is gone is given up, which is said.
        gone = {value for value in self.owed - self.ended if not value.startswith(b'own')}
        given_up = self.house.pipeline.snapshot.given_up
        assert len(gone) - self.dropped <= given_up <= len(self.owed)
        self.owed -= gone
        sink = Robots(room=4, matched=self.sink.matched, acknowledging=False)
        self._begin(sink, self.house.source.committed)

    def _stop(self) -> None:
        stop = Stop()
        stop.ask()
        self.house.pipeline.run(stop)
        self._look()
        self.sink.look_at_order()
        snapshot = self.house.pipeline.snapshot
        assert snapshot.balanced
        assert not snapshot.in_flight
        self.dropped += snapshot.dropped

    def _look(self) -> None:
        """Compare what the route says with what others have."""
        letters = {record.value for record in self.house.letters.records if record.value}
        self.ended |= letters | {value.removeprefix(b'cdr:') for value in self.sink.have}
        self.house.check_balance()
        counters = self.house.pipeline.counters.snapshot(0)
        here = {**self.house.source.committed, **self.house.source.positions}
        assert all(end <= len(self.topic[number]) for number, end in here.items()), here
        read = {value for number, end in here.items() for value in self.topic[number][:end]}
        assert len(self._not_ended(read)) <= self.dropped + counters.dropped
        most = LARGEST_BYTES // ENTRY_BYTES + 1 + BATCH
        drops = self._when_full == 'drop_oldest'
        assert len(self.house.pipeline._flight) <= (2 * most if drops else most)
        assert drops or self._ahead(here) <= most

    def _ahead(self, positions: dict[int, int]) -> int:
        """How many records would be read again after a crash, and are not the bridge's own."""
        waiting = {record.value_bytes or b'' for record in self.house.source.waiting}
        behind = [log[positions.get(number, 0) :] for number, log in self.topic.items()]
        return len(self._not_own({value for log in behind for value in log} - waiting))

    @staticmethod
    def _not_own(values: set[bytes]) -> set[bytes]:
        return {value for value in values if not value.startswith(b'own')}

    def _not_ended(self, values: set[bytes]) -> set[bytes]:
        return self._not_own(values - self.ended)

    def ends(self) -> None:
        """Let much come while nobody reads, then all go on that stood still, and stop."""
        for event in (('reader goes', 0), ('burst', 0), ('step', 5)):
            self.happens(*event)
        self.sink.matched, self.sink.acknowledging = 1, True
        self.house.letters.answering = True
        for _ in range(1000):
            self.house.steps(1)
            if not self.house.source.waiting and not self.house.pipeline._flight:
                break
        else:
            pytest.fail('something stands for ever')
        self._look()
        self._stop()
        ends = {number: len(log) for number, log in self.topic.items()}
        assert {**dict.fromkeys(PARTITIONS, 0), **self.house.source.committed} == ends
        written = {value for log in self.topic.values() for value in log}
        assert len(self._not_ended(written | self.owed)) <= self.dropped
        assert not self._not_ended({self.newest} & written), 'the newest is not dropped'
        assert not self.house.pipeline.snapshot.given_up


@contextmanager
def small_and_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        flights.check_steps(patch)
        patch.setattr(readiness, 'SETTLE_S', 0.0)
        patch.setattr(publishing, '_ACKNOWLEDGED_BY_S', -1.0)
        patch.setattr(time, 'sleep', lambda _: None)
        patch.setattr(pieces, 'PIECE', BATCH)
        patch.setattr(kafka_to_ros, 'BATCH', BATCH)
        patch.setattr(kafka_to_ros, 'REVOKE_S', 0.0)
        patch.setattr(kafka_to_ros, 'COMMIT_S', 0.0)
        yield


NEW_BEHIND_OLD: list[Event] = [
    ('reader comes', 0), ('good', 0), ('good', 0), ('step', 2), ('make anew', 0), ('good', 0),
    ('step', 2), ('acknowledge', 2), ('step', 1),
]  # fmt: skip
"""What is in flight of a topic that is gone says nothing of the one in its place."""


@settings(max_examples=200)
@given(events=EVENTS, drops=st.booleans())
@example(events=NEW_BEHIND_OLD, drops=False)
def test_whatever_happens_each_record_ends_once_and_in_order(
    events: list[Event], *, drops: bool
) -> None:
    with small_and_quick():
        world = World(drops=drops)
        for event in events:
            world.happens(*event)
        world.ends()
