"""A route that has nothing to do costs little."""

import pytest
from support.worlds.clocks import Clock

from ros2_kafka_bridge.route.idling import Idling


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr('time.monotonic', clock.monotonic)
    return clock


def test_waits_are_short_for_a_while_after_work_and_long_then(clock: Clock) -> None:
    idling = Idling(0.005)
    idling.note_work()
    for _ in range(2):
        assert (idling.is_calm, idling.wait_s(busy=False)) == (False, 0.1)
        clock.now_s += 1.49
        assert (idling.is_calm, idling.wait_s(busy=False)) == (False, 0.1)
        clock.now_s += 0.02
        assert (idling.is_calm, idling.wait_s(busy=False)) == (True, 5.0)
        idling.note_work()


def test_with_something_in_flight_a_wait_is_as_short_as_asked_for(clock: Clock) -> None:
    idling = Idling(0.005)
    idling.note_work()
    clock.now_s += 60
    assert idling.wait_s(busy=True) == 0.005
    assert idling.wait_s(busy=False) == 0.1, 'that was work'
