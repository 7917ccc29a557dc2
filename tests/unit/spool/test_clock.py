"""A spool while the clock of the machine is set: only what has waited for too long is too old."""

import itertools
import time
from collections.abc import Sequence
from typing import Any

import pytest
from support.worlds.pipeline_with_spool import House, Make, go_on

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.spool.ages import Older
from ros2_kafka_bridge.spool.rows import Row
from ros2_kafka_bridge.spool.store import Spool

HOUR_S = 3600.0
DAY_S = 24 * HOUR_S


class Clocks:
    """The clocks of a machine: `wait` moves all of them, `jump` only the time of day."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._waited_s = self._jumped_s = 0.0
        time_ns, monotonic, clock_gettime_ns = time.time_ns, time.monotonic, time.clock_gettime_ns
        monkeypatch.setattr(
            time, 'time_ns', lambda: time_ns() + int(1e9 * (self._waited_s + self._jumped_s))
        )
        monkeypatch.setattr(time, 'monotonic', lambda: monotonic() + self._waited_s)
        monkeypatch.setattr(
            time,
            'clock_gettime_ns',
            lambda clock: clock_gettime_ns(clock) + int(1e9 * self._waited_s),
        )

    def wait(self, seconds: float) -> None:
        self._waited_s += seconds

    def jump(self, seconds: float) -> None:
        self._jumped_s += seconds


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    return Clocks(monkeypatch)


def held_back(house: Make) -> House:
    """A route whose first message is in flight; others than that wait on disk for a minute."""
    h = house({'max_age_s': 60.0}, max_in_flight=1, away=True)
    h.take(1, 2, 3)
    return h


@pytest.mark.parametrize('jump_s', [HOUR_S, DAY_S, 50 * 365 * DAY_S, -HOUR_S, -DAY_S])
def test_what_waits_grows_neither_older_nor_younger_when_the_clock_is_set(
    house: Make, clocks: Clocks, jump_s: float
) -> None:
    h = held_back(house)
    clocks.jump(jump_s)
    clocks.wait(30)
    h.take(4)
    assert (h.on_disk(), h.count('dropped')) == ([1, 2, 3, 4], 0)
    clocks.wait(40)
    h.steps()
    assert (h.on_disk(), h.count('dropped')) == ([1, 4], 2)
    go_on(h)
    assert h.numbers() == [1, 4]


def test_every_step_of_the_clock_counts_for_what_was_written_before_it_alone(
    house: Make, clocks: Clocks
) -> None:
    h = held_back(house)
    for number, jump_s in enumerate((HOUR_S, -2 * HOUR_S, 0.5, 0.5, 0.5, DAY_S), 4):
        clocks.jump(jump_s)
        clocks.wait(20)
        h.take(number)
    assert (h.on_disk(), h.count('dropped')) == ([1, 6, 7, 8, 9], 4)


def test_what_an_earlier_life_has_left_is_judged_by_the_clock_that_this_one_began_with(
    house: Make, clocks: Clocks
) -> None:
    h = held_back(house)
    h.crash()
    clocks.wait(30)
    again = house({'max_age_s': 60.0}, max_in_flight=1, away=True)
    clocks.jump(DAY_S)
    again.steps()
    assert again.count('dropped') == 0
    clocks.wait(40)
    again.steps()
    assert again.count('dropped') == 2


def test_how_long_a_message_was_in_the_bridge_does_not_change_with_the_clock(
    house: Make, clocks: Clocks
) -> None:
    h = house(max_in_flight=1, away=True)
    h.take(1, 2, 3)
    clocks.jump(DAY_S)
    clocks.wait(10)
    go_on(h)
    h.pipeline._take_snapshot()
    assert 30 <= h.pipeline.snapshot.measures.in_bridge.sum_s < 40


def test_without_an_age_limit_an_outage_of_days_costs_nothing_and_the_last_needs_no_other(
    house: Make, clocks: Clocks
) -> None:
    h = house(max_in_flight=2, away=True)
    h.take(*range(1, 11))
    clocks.wait(9 * DAY_S)
    h.steps()
    assert not h.source.waiting
    go_on(h)
    assert h.numbers() == list(range(1, 11))
    assert (h.count('taken'), h.count('confirmed'), h.count('dropped')) == (10, 10, 0)


def test_what_was_dropped_before_the_disk_refused_is_counted(
    house: Make, clocks: Clocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = held_back(house)
    clocks.jump(DAY_S)
    h.take(4)
    clocks.wait(61)
    drop_older, calls = Spool.drop_older, itertools.count(1)

    def refuses_once(spool: Spool, after: int, older: Older) -> Any:
        if next(calls) == 2:
            raise TransportError('the disk is full')
        return drop_older(spool, after, older)

    monkeypatch.setattr(Spool, 'drop_older', refuses_once)
    h.steps()
    assert (h.on_disk(), h.count('dropped')) == ([1, 4], 2)
    clocks.wait(1)
    h.steps()
    assert (h.on_disk(), h.count('dropped')) == ([1], 3)


def test_a_disk_that_takes_long_is_no_step_of_the_clock(
    house: Make, clocks: Clocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'max_age_s': 60.0}, max_in_flight=1, away=True)
    append = Spool.append

    def slow(spool: Spool, rows: Sequence[Row]) -> int:
        first = append(spool, rows)
        clocks.wait(30)
        return first

    monkeypatch.setattr(Spool, 'append', slow)
    h.take(1, 2)
    monkeypatch.setattr(Spool, 'append', append)
    h.give(3)
    clocks.wait(31)
    h.steps()
    assert (h.on_disk(), h.count('dropped')) == ([1, 3], 1)


def test_what_an_earlier_life_took_in_1970_waits_from_the_beginning_of_this_one(
    house: Make, clocks: Clocks
) -> None:
    to_1970_s = 20.0 - time.time()
    clocks.jump(to_1970_s)
    h = held_back(house)
    h.crash()
    clocks.wait(30)
    clocks.jump(-to_1970_s)
    again = house({'max_age_s': 60.0}, max_in_flight=1, away=True)
    again.steps()
    clocks.wait(50)
    again.steps()
    assert again.count('dropped') == 0, 'nobody knows that they are old'
    clocks.wait(20)
    again.steps()
    assert again.count('dropped') == 2
