"""Whatever happens to a bridge with a spool, what is refused ends once, and holds up nothing."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds.pipeline_with_spool import Broker, House, come_back, make_room
from support.worlds.spool_worlds import (
    BATCH,
    KINDS,
    LARGE,
    LONGEST_BYTES,
    SMALL,
    Event,
    Given,
    does,
    is_full,
    numbers,
    small_and_quick,
    stop,
)

LETTER_IN_FRONT: Any = {
    'events': [('long', 1), ('good', 1), ('stop', 0)], 'mode': 'when_away', 'window': 2,
    'max_bytes': 6_000, 'drops': False, 'letters': 'stand',
}  # fmt: skip
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just('good'), st.integers(1, 20)),
        st.tuples(st.sampled_from(KINDS), st.integers(1, 3)),
        st.tuples(st.just('steps'), st.integers(1, 5)),
        st.tuples(st.sampled_from(['away', 'back', 'deaf', 'fail', 'stop', 'crash']), st.just(0)),
        st.tuples(st.sampled_from(['full', 'not full', 'late']), st.integers(1, 9)),
        st.tuples(st.just('refuse'), st.integers(1, 3)),
        st.tuples(st.sampled_from(['letters stand', 'letters fail', 'letters go']), st.just(0)),
    ),
    max_size=40,
)


class World:
    """Lives of a bridge one after the other, and what has become of each message."""

    def __init__(
        self, place: Path, mode: str, window: int, max_bytes: int, *, drops: bool
    ) -> None:
        self._place, self._spool = place, {'mode': mode, 'max_bytes': max_bytes}
        self._window, self._drops = window, drops
        self._given = Given()
        self._repeats = False
        self._maybe_lost: set[int] = set()
        self._arrived: list[int] = []
        self._letters: list[int] = []
        self._dropped = 0
        self._begin()

    def _begin(self) -> None:
        self.house = House(
            self._place, self._spool, sink=Broker(limit_bytes=LONGEST_BYTES),
            max_in_flight=self._window, drain_s=0.0,
            when_full='drop_oldest' if self._drops else 'wait',
        )  # fmt: skip

    def happens(self, what: str, how: int) -> None:
        if what in KINDS:
            self._given.give(self.house, what, how)
        elif what in {'stop', 'crash'}:
            self._next_life(what)
        else:
            does(self.house, what, how)
        self._look()

    def _look(self) -> None:
        self.house.check_balance()
        most = self._window + BATCH + self._window * self._drops
        assert len(self.house.pipeline._flight) <= most, 'it cannot all be in memory'
        first = list(dict.fromkeys(self.arrived))
        assert first == sorted(first), 'in order'
        assert self._repeats or len(first) == len(self.arrived), 'each once'
        assert not self._given.of['good'] & {*self.letters}, 'the innocent are no letters'
        assert {*first} <= self._given.of['good'], 'what is refused is not in Kafka'

    @property
    def arrived(self) -> list[int]:
        return self._arrived + numbers(self.house.sink.records)

    @property
    def letters(self) -> list[int]:
        return self._letters + numbers(self.house.letters.records)

    @property
    def dropped(self) -> int:
        return self._dropped + self.house.count('dropped')

    def _next_life(self, end: str) -> None:
        house = self.house
        if end == 'crash':
            self._crash(house)
        else:
            told = stop(house)
            lost = {entry.seq for entry in house.pipeline._flight}
            assert told or not lost, 'what is given up is said'
            assert is_full(house) or not lost, 'what has room on disk is not given up'
            self._maybe_lost |= lost
        self._arrived, self._letters = self.arrived, self.letters
        self._dropped, waiting = self.dropped, house.source.waiting
        self._begin()
        self.house.source.waiting.extend(waiting)

    def _crash(self, house: House) -> None:
        if house.sink.away:
            house.steps(2)  # the first take shows that there is something to keep
        held = {entry.seq for entry in house.pipeline._flight}
        on_disk = {row.seq for row in house.spool.read(0, 10**6, 1 << 40)}
        is_kept = house.sink.away or self._spool['mode'] == 'always'
        assert held <= on_disk or is_full(house) or not is_kept
        self._maybe_lost |= held - on_disk
        self._repeats = True
        house.crash()

    def _until_quiet(self) -> None:
        for _ in range(2000):
            self.house.steps(1)
            house = self.house
            quiet = not house.pipeline._flight and not house.pipeline._spooling.waiting
            if quiet and not house.source.waiting:
                return
        pytest.fail('something stands for ever')

    def letters_stand(self, how: str) -> None:
        """Nobody takes a letter: what is good goes on, as far as there is room beside them."""
        come_back(self.house)
        make_room(self.house)
        self.happens(f'letters {how}', 0)
        self.house.steps(200)
        left = self._given.all - {*self.arrived, *self.letters} - self._maybe_lost
        left -= {message.seq for message in self.house.source.waiting}
        standing = [*self.house.pipeline._flight]
        if len(standing) < self._window:
            missing = self._given.of['good'] & left
            assert len(missing) <= self.dropped, 'a letter holds up what is good'
        self._look()

    def ends(self, how: str) -> None:
        """Let the letters stand once more, then all go on, and count."""
        self.letters_stand(how)
        self.happens('letters go', 0)
        self._until_quiet()
        self._next_life('stop')
        ended = {*self.arrived, *self.letters}
        missing = self._given.all - ended
        if not self._repeats:
            assert len({*self.letters}) == len(self.letters), 'each is one letter'
            assert len(missing - self._maybe_lost) <= self.dropped <= len(missing)
        assert len(missing - self._maybe_lost) <= self.dropped, 'what did not come is said'
        assert self._drops or not self.dropped
        newest = self._given.number
        assert not newest or newest in ended | self._maybe_lost, 'the newest is not dropped'
        stop(self.house)


@settings(max_examples=80)
@given(
    events=EVENTS,
    mode=st.sampled_from(['when_away', 'always']),
    window=st.integers(1, 12),
    max_bytes=st.sampled_from([SMALL, LARGE]),
    drops=st.booleans(),
    letters=st.sampled_from(['stand', 'fail']),
)
@example(**LETTER_IN_FRONT)
def test_whatever_happens_what_is_refused_ends_once_and_holds_up_nothing(
    events: list[Event], mode: str, window: int, max_bytes: int, letters: str, *, drops: bool
) -> None:
    with small_and_quick() as place:
        world = World(place, mode, window, max_bytes, drops=drops)
        for event in events:
            world.happens(*event)
        world.ends(letters)
