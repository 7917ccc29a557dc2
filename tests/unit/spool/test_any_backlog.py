"""Whatever happens to a bridge with a spool, each message arrives in order."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.worlds import flights
from support.worlds.pipeline_with_spool import House, come_back, make_room
from support.worlds.spool_worlds import does

Event = tuple[str, int]
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just('give'), st.integers(1, 40)),
        st.tuples(st.just('steps'), st.integers(1, 5)),
        st.tuples(st.sampled_from(['away', 'back', 'deaf', 'fail', 'stop', 'crash']), st.just(0)),
        st.tuples(st.sampled_from(['full', 'not full', 'late']), st.integers(1, 9)),
        st.tuples(st.just('refuse'), st.integers(1, 3)),
    ),
    max_size=40,
)


@settings(max_examples=150)
@given(events=EVENTS, always=st.booleans(), window=st.integers(1, 12))
def test_whatever_happens_each_message_arrives_in_order(
    events: list[Event], window: int, *, always: bool
) -> None:
    with TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        flights.check_steps(patch)
        patch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
        world = World(Path(place), 'always' if always else 'when_away', window)
        for event in events:
            world.happens(*event)
        world.ends()


class World:
    """A publisher that never repeats itself, and lives of the bridge one after the other."""

    def __init__(self, place: Path, mode: str, window: int) -> None:
        self._place, self._mode, self._window = place, mode, window
        self._number = 0
        self._repeats = False
        self._maybe_lost: set[int] = set()
        self._arrived: list[int] = []
        self._house = self._begin()

    def _begin(self) -> House:
        return House(self._place, {'mode': self._mode}, max_in_flight=self._window, drain_s=0.0)

    def happens(self, what: str, count: int) -> None:
        house = self._house
        if what == 'give':
            house.give(*range(self._number + 1, self._number + count + 1))
            self._number += count
        elif what in {'stop', 'crash'}:
            self._next_life(what)
        else:
            does(house, what, count)

    def _next_life(self, end: str) -> None:
        house, waiting = self._house, list(self._house.source.waiting)
        if end == 'crash':
            self._repeats = True
            held = {int(entry.record.value or 0) for entry in house.pipeline._flight}
            on_disk = {int(r.record.value or 0) for r in house.spool.read(0, 10**6, 1 << 40)}
            was_full = 'append' in house.spool.__dict__
            assert self._mode == 'when_away' or was_full or held <= on_disk
            self._maybe_lost |= held - on_disk
            house.crash()
        else:
            make_room(house)
            house.drain()
            waiting = list(house.source.waiting)
        self._arrived += house.numbers()
        self._house = self._begin()
        self._house.source.waiting.extend(waiting)

    def ends(self) -> None:
        come_back(self._house)
        if self._mode == 'always':  # otherwise a disk that takes nothing holds up nothing
            make_room(self._house)
        for _ in range(100):
            self._house.steps(10)
            if not self._house.source.waiting:
                break
        self._house.until_all_confirmed()
        arrived = self._arrived + self._house.numbers()
        first = list(dict.fromkeys(arrived))
        assert set(range(1, self._number + 1)) - set(first) <= self._maybe_lost
        assert first == sorted(first)
        if not self._repeats:
            assert len(first) == len(arrived)
        self._house.drain()
