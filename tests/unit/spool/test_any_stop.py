"""Whatever happens to a bridge with a spool, nothing goes past what stops its route."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.worlds.pipeline_with_spool import Broker, House, come_back, make_room
from support.worlds.spool_worlds import (
    BATCH,
    KINDS,
    LARGE,
    LONGEST_BYTES,
    Event,
    Given,
    does,
    is_full,
    numbers,
    small_and_quick,
    stop,
)

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.flight.stage import REFUSED

if TYPE_CHECKING:
    from ros2_kafka_bridge.route.flight.messages import MessageEntry

STOPPING = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(['good', 'good', 'bad', 'long', 'long']), st.integers(1, 3)),
        st.tuples(st.just('good'), st.integers(1, 20)),
        st.tuples(st.just('steps'), st.integers(1, 3)),
        st.tuples(st.sampled_from(['away', 'back', 'deaf', 'fail', 'mend']), st.just(0)),
        st.tuples(st.sampled_from(['full', 'not full', 'late', 'refuse']), st.integers(1, 3)),
        st.tuples(st.sampled_from(['stop', 'crash', 'deaf', 'mend']), st.just(0)),
    ),
    min_size=8,
    max_size=40,
)


class Strict(Broker):
    """A client that refuses what is too long, until somebody has mended that."""

    def __init__(self, mended: set[int], room: int) -> None:
        super().__init__(room=room)
        self._mended = mended

    def produce(self, record: Outgoing, token: 'MessageEntry') -> bool:
        self.limit_bytes = LARGE if numbers([record])[0] in self._mended else LONGEST_BYTES
        return super().produce(record, token)


class StoppingWorld:
    """A route that ends where it cannot go on (`on_error: stop`), and its next lives."""

    def __init__(self, place: Path, mode: str, window: int) -> None:
        self._place, self._mode, self._window = place, mode, window
        self._given = Given()
        self._mended: set[int] = set()
        self._gone: set[int] = set()  # with a life: it was in memory alone
        self._arrived: list[int] = []
        self._begin()

    def _begin(self) -> None:
        self.house = House(
            self._place, {'mode': self._mode}, sink=Strict(self._mended, self._window),
            max_in_flight=self._window, drain_s=0.0, on_error='stop',
        )  # fmt: skip

    @property
    def arrived(self) -> list[int]:
        return self._arrived + numbers(self.house.sink.records)

    @property
    def _refused(self) -> set[int]:
        """What the route may not go past."""
        return (self._given.of['bad'] | self._given.of['long']) - self._mended - self._gone

    def happens(self, what: str, how: int) -> None:
        try:
            if what in KINDS:
                self._given.give(self.house, what, how)
            elif what == 'mend':
                self._mend()
            elif what == 'stop':
                self._next_life(stop(self.house))
            elif what == 'crash':
                self._next_life(None)
            else:
                does(self.house, what, how)
        except RouteError as error:
            self._has_stopped(error)
        self._look()

    def _mend(self) -> None:
        """Let a run fail, and somebody mend what is too long meanwhile."""
        self.house.fail_and_run_again()
        ends = {e.seq for e in self.house.pipeline._flight if e.stage is REFUSED}
        self._mended |= self._given.of['long'] - ends

    def _look(self) -> None:
        assert len(self.house.pipeline._flight) <= self._window + BATCH
        first = list(dict.fromkeys(self.arrived))
        assert first == sorted(first), 'in order'
        assert not first or first[-1] < min(self._refused, default=self._given.number + 1)

    def _has_stopped(self, error: RouteError) -> None:
        """All before what was refused is in Kafka; what is behind it is kept, or that is said."""
        assert error.final
        assert 'stopped, as on_error says' in str(error)
        at = min(self._refused)
        assert set(range(1, at)) <= {*self.arrived} | self._gone, 'all before it has arrived'
        self.house.check_balance()
        assert not self.house._opened.__exit__(RouteError, error, None)
        self._next_life(str(error))
        self._mended.add(at)

    def _next_life(self, told: str | None) -> None:
        """Begin again; what the last life has told is None where it was killed."""
        house = self.house
        house.spool.open()
        taken = self._given.all - {message.seq for message in house.source.waiting}
        gone = taken - {row.seq for row in house.spool.read(0, 10**6, 1 << 40)}
        gone -= {*self.arrived} | self._gone
        innocent = gone - self._refused
        if told is not None or self._mode == 'always':
            assert is_full(house) or not innocent, 'what has room on disk is kept'
        if told is not None and innocent:
            assert 'given up' in told or 'gave up' in told
        house.crash()
        self._gone |= gone
        self._arrived, waiting = self.arrived, house.source.waiting
        self._begin()
        self.house.source.waiting.extend(waiting)

    def ends(self) -> None:
        """Let all go on until nothing is left; each life may stop at one message."""
        self.happens('good', 1)
        for _ in range(2000):
            come_back(self.house)
            make_room(self.house)
            self.happens('steps', 1)
            house = self.house
            waits = house.pipeline._flight or house.pipeline._spooling.waiting
            if not waits and not house.source.waiting:
                break
        else:
            pytest.fail('something stands for ever')
        assert self._given.all <= {*self.arrived} | self._gone
        stop(self.house)


@settings(max_examples=50)
@given(events=STOPPING, mode=st.sampled_from(['when_away', 'always']), window=st.integers(1, 12))
def test_whatever_happens_nothing_goes_past_what_stops_the_route(
    events: list[Event], mode: str, window: int
) -> None:
    with small_and_quick() as place:
        world = StoppingWorld(place, mode, window)
        for event in events:
            world.happens(*event)
        world.ends()
