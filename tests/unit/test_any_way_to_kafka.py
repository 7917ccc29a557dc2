"""Whatever happens to messages on their way to Kafka: each ends once, in order, within its bounds.

The route of this world has no disk (`spool/test_any_backlog.py` has one): what waits is in memory.
"""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.worlds import flights
from support.worlds.pipeline_to_kafka import House
from support.worlds.pipeline_with_spool import Broker

from ros2_kafka_bridge import ros_to_kafka
from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.threads.stop import Stop

PUBLISHERS = (b'a', b'b')
BATCH = 3
MOST = 4
LARGEST_BYTES = 4_000
ENTRY_BYTES = 400  # which an entry counts at least

Event = tuple[str, int]
MESSAGES = ('good', 'good', 'bad', 'too large', 'burst', 'burst of bad')
EVENTS = st.lists(
    st.tuples(st.sampled_from(MESSAGES), st.sampled_from((0, 1)))
    | st.tuples(st.sampled_from(('step', 'refuse')), st.integers(1, 4))
    | st.tuples(st.sampled_from(('away', 'back', 'deaf', 'hears', 'rest', 'fail')), st.just(0))
    | st.tuples(st.sampled_from(('letters stand', 'letters go', 'stop')), st.just(0))
    | st.tuples(st.just('late'), st.integers(0, 3)),
    min_size=20,
    max_size=80,
)

WRONG: tuple[Event, ...] = (
    ('letters stand', 0), ('burst of bad', 0), ('burst of bad', 0), ('step', 12),
    ('quiet', 0),
    ('deaf', 0), ('good', 0), ('step', 1), ('late', 1), ('hears', 0), ('fail', 0),
    ('away', 0), ('burst', 0), ('step', 60),
)  # fmt: skip
"""Letters that nobody takes, a report that comes as the route fails, an outage."""


def numbers(records: Iterable[Outgoing]) -> list[int]:
    """The numbers of the messages that records, or dead letters, were made of."""
    return [int(str(dict(record.headers)['ros.seq'])) for record in records]


class World:
    """Two publishers that never repeat themselves, and a route that may end and run again."""

    def __init__(self, *, drops: bool) -> None:
        self._drops = drops
        self._by: list[bytes] = []  # the publisher of each message, whose number is its place
        self._good: set[int] = set()
        self._arrived: list[int] = []
        self._letters: list[int] = []
        self._dropped = 0
        self._begin([])

    def _begin(self, waiting: list[Message]) -> None:
        self.sink = Broker(room=MOST)
        self.house = House(
            sink=self.sink, when_full='drop_oldest' if self._drops else 'wait',
            max_in_flight=MOST, max_in_flight_bytes=LARGEST_BYTES, drain_s=2.0,
        )  # fmt: skip
        self.house.source.waiting.extend(waiting)
        self.house.begin()

    def happens(self, what: str, how: int) -> None:
        match what:
            case 'good' | 'bad' | 'too large':
                self._publish(what, PUBLISHERS[how])
            case 'burst' | 'burst of bad':
                for _ in range(12):
                    self._publish('bad' if 'bad' in what else 'good', PUBLISHERS[how])
            case 'step':
                self.house.steps(how)
            case 'rest':
                self.house.rests(1)
            case 'quiet':
                self._until_quiet()
            case 'fail':
                self.house.fail_and_run_again()
            case 'stop':
                self._next_life()
            case _:
                self._kafka_does(what, how)
        self._look()

    def _publish(self, kind: str, publisher: bytes) -> None:
        number = len(self._by)
        cdr = b'%s %d' % (kind.encode(), number)
        self._by.append(publisher)
        self._good |= {number} if kind == 'good' else set()
        self.house.source.waiting.append(Message(cdr, publisher, number, 0))

    def _kafka_does(self, what: str, how: int) -> None:
        if what in {'away', 'back'}:
            self.sink.away = 'Kafka is away' if what == 'away' else ''
            self.sink.answering = what == 'back'
        elif what in {'deaf', 'hears'}:
            self.sink.answering = what == 'hears' and not self.sink.away
        elif what == 'refuse':
            self.sink.refusals = how
        elif what == 'late':
            self.sink.delivered_at_close = how
        else:
            self.house.letters.answering = what == 'letters go'

    def _next_life(self) -> None:
        """Stop as a bridge does that has the time, then begin again."""
        self._recover()
        stop = Stop()
        stop.ask()
        self.house.pipeline._drain(stop)
        assert not self.house._opened.__exit__(None, None, None)
        snapshot = self.house.pipeline.snapshot
        assert snapshot.balanced
        assert not snapshot.in_flight
        assert not snapshot.given_up
        assert not self.house.source.waiting, 'a stop takes what was published'
        self._arrived += numbers(self.sink.records)
        self._letters += numbers(self.house.letters.records)
        self._dropped += snapshot.dropped
        self._begin([])

    def _until_quiet(self) -> None:
        self._recover()
        for _ in range(1000):
            self.house.steps(1)
            if not self.house.source.waiting and not self.house.pipeline._flight:
                return
        pytest.fail('something stands for ever')

    def _recover(self) -> None:
        self.sink.away, self.sink.answering = '', True
        self.house.letters.answering = True

    def _look(self) -> None:
        self.house.check_balance()
        held, is_sent = len(self.house.pipeline._flight), self.sink.load.queued
        largest = LARGEST_BYTES // ENTRY_BYTES + BATCH
        assert held <= (MOST + largest if self._drops else MOST)
        assert is_sent <= MOST
        arrived = [*self._arrived, *numbers(self.sink.records)]
        assert len({*arrived}) == len(arrived), 'each once'
        for publisher in PUBLISHERS:
            mine = [number for number in arrived if self._by[number] == publisher]
            assert mine == sorted(mine), 'in order'

    def ends(self) -> None:
        """Let everything go wrong once more, then all go on, and count."""
        for event in WRONG:
            self.happens(*event)
        assert not (self._drops and self.house.source.waiting), 'nobody is held back'
        self._until_quiet()
        self._next_life()
        ended, given = [*self._arrived, *self._letters], len(self._by)
        assert len({*ended}) == len(ended), 'it is in Kafka, or a letter'
        assert not self._good & {*self._letters}, 'the innocent are no letters'
        assert given - len(ended) == self._dropped * self._drops, 'what did not come is said'
        assert not given or given - 1 in ended, 'the newest is not dropped'


@contextmanager
def small_and_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        flights.check_steps(patch)
        patch.setattr(time, 'sleep', lambda _: None)
        patch.setattr(ros_to_kafka, 'BATCH', BATCH)
        yield


@settings(max_examples=200)
@given(events=EVENTS, drops=st.booleans())
def test_whatever_happens_each_message_ends_once_and_in_order(
    events: list[Event], *, drops: bool
) -> None:
    with small_and_quick():
        world = World(drops=drops)
        for event in events:
            world.happens(*event)
        world.ends()
