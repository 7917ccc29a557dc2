"""While two bridges read, the one that goes takes what the other may not have."""

from collections.abc import Mapping

import pytest
from support.worlds.clocks import Clock

from ros2_kafka_bridge.exclusive.handover_window import (
    KNOWN_S,
    MOST_AT_END_S,
    MOST_S,
    HandoverWindow,
)

BEGAN_S = 1000.0
BEFORE, AFTER = BEGAN_S - 60, BEGAN_S + KNOWN_S


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(BEGAN_S)
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.handover_window.time', clock)
    return clock


def lasts_s(
    clock: Clock,
    heard: Mapping[float, Mapping[bytes, float]],
    *,
    is_end: bool = True,
    held_up: range = range(0),
    taken_at_s: float = BEGAN_S,
) -> float:
    """How long a window lasts in which each publisher is heard at some moments, in seconds.

    Args:
        clock: The time.
        heard: After how many seconds -> publisher -> when what was heard was published.
        is_end: Whether the bridge stops.
        held_up: Seconds in which nothing could be taken.
        taken_at_s: When something could be taken last before it.
    """
    clock.now_s = BEGAN_S
    window = HandoverWindow(taken_at_s)
    for tick in range(1000):
        clock.now_s = BEGAN_S + tick / 10
        if window.is_over(is_end=is_end, takes=True):
            return tick / 10
        newest = heard.get(tick / 10, {})
        if tick // 10 not in held_up:
            window.note({gid: round(at_s * 1e9) for gid, at_s in newest.items()})
    raise AssertionError('it has no end')


def test_a_quiet_window_lasts_as_long_as_dds_may_take_to_make_the_other_known(
    clock: Clock,
) -> None:
    assert lasts_s(clock, {}) == pytest.approx(KNOWN_S, abs=0.2)


def test_a_window_of_a_publisher_that_goes_on_lasts_no_longer(clock: Clock) -> None:
    heard = {tick / 10: {b'a': BEGAN_S + tick / 10} for tick in range(1000)}
    assert lasts_s(clock, heard) == pytest.approx(KNOWN_S, abs=0.2)


def test_guarantee_8_what_a_publisher_sends_again_late_is_waited_for(clock: Clock) -> None:
    """Its heartbeat comes every 3 s; what was published before the other read comes by it."""
    heard = {3.0: {b'a': BEFORE}, 6.0: {b'a': BEFORE}, 8.0: {b'a': AFTER}}
    assert lasts_s(clock, heard) == pytest.approx(8.1, abs=0.2)


def test_each_publisher_has_to_be_heard_with_something_newer(clock: Clock) -> None:
    heard = {3.0: {b'a': BEFORE, b'b': BEFORE}, 5.0: {b'a': AFTER}, 6.0: {b'b': AFTER}}
    assert lasts_s(clock, heard) == pytest.approx(6.1, abs=0.2)


def test_a_publisher_that_falls_silent_is_waited_for_by_a_heartbeat(clock: Clock) -> None:
    assert lasts_s(clock, {3.0: {b'a': BEFORE}}) == pytest.approx(3.0 + KNOWN_S, abs=0.2)


def test_a_bridge_that_lives_waits_for_one_that_misses_heartbeats(clock: Clock) -> None:
    heard = {8.0: {b'a': BEFORE}, 14.0: {b'a': AFTER}}
    assert lasts_s(clock, heard, is_end=False) == pytest.approx(14.1, abs=0.2)


def test_what_was_published_before_dds_surely_knew_the_other_is_not_newer(clock: Clock) -> None:
    heard = {3.0: {b'a': AFTER - 0.1}, 6.0: {b'a': AFTER - 0.1}, 8.0: {b'a': AFTER}}
    assert lasts_s(clock, heard) == pytest.approx(8.1, abs=0.2)


def test_a_hold_up_counts_from_its_length_on_also_where_it_began_before(clock: Clock) -> None:
    """What found no room meanwhile comes again by a heartbeat after it."""
    assert lasts_s(clock, {}, held_up=range(2, 4)) == pytest.approx(4.0 + KNOWN_S, abs=0.2)
    before_s = BEGAN_S - 1.5
    last_s = lasts_s(clock, {}, held_up=range(1), taken_at_s=before_s)
    assert last_s == pytest.approx(1.0 + KNOWN_S, abs=0.2)


@pytest.mark.parametrize('first', [0, 1])
def test_nothing_is_heard_while_nothing_can_be_taken(clock: Clock, first: int) -> None:
    """As where the window is full, perhaps since before the other one read."""
    assert lasts_s(clock, {}, held_up=range(first, 5)) == pytest.approx(5.0 + KNOWN_S, abs=0.2)


@pytest.mark.parametrize(('is_end', 'most_s'), [(True, MOST_AT_END_S), (False, MOST_S)])
def test_a_window_has_an_end_also_where_a_publisher_is_always_behind(
    clock: Clock, *, is_end: bool, most_s: float
) -> None:
    heard = {tick / 10: {b'a': BEFORE} for tick in range(1000)}
    assert lasts_s(clock, heard, is_end=is_end) == pytest.approx(most_s, abs=0.2)


@pytest.mark.parametrize('takes', [False, True])
def test_a_window_of_which_nobody_is_told_lasts_longer_only_where_takes_are_held_up(
    clock: Clock, *, takes: bool
) -> None:
    """A route that has failed takes nothing: there it lasts as long as a quiet one."""
    window = HandoverWindow(BEGAN_S)
    clock.now_s += KNOWN_S - 0.1
    assert not window.is_over(is_end=True, takes=takes)
    clock.now_s += 0.2
    assert window.is_over(is_end=True, takes=takes) is not takes
    clock.now_s += MOST_AT_END_S - KNOWN_S
    assert window.is_over(is_end=True, takes=takes)
