"""A route tells of itself each second while it works, and else as often as somebody asks."""

import logging
from typing import Any

import pytest

from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.route.telling import Telling
from ros2_kafka_bridge.testing.memory import MemoryRecordSink
from ros2_kafka_bridge.threads.pause import Pause

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


class House:
    """A route that tells of itself where it is time, and looks ten times a second."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.5  # a machine that has just been started
        monkeypatch.setattr('time.monotonic', lambda: self.now_s)
        sink: MemoryRecordSink[Any] = MemoryRecordSink()
        letters = DeadLetters[Any]('dead', sink, lambda: None, LOG)
        self.pause = Pause()
        self.telling = Telling(Counters('orders'), Meter(), letters)
        self._sink = sink

    def tells(self, for_s: float, *, is_calm: bool, asks: bool = False) -> int:
        """How often it tells in that time."""
        told = 0
        for _ in range(round(for_s * 10)):
            self.telling.is_asked = self.telling.is_asked or asks
            if self.telling.is_due(self.pause, is_calm=is_calm):
                self.telling.tell('', self._sink, self.pause)
                told += 1
            self.now_s += 0.1
        return told


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch) -> House:
    return House(monkeypatch)


@pytest.mark.parametrize('is_calm', [False, True])
def test_a_route_that_begins_tells_at_once(house: House, *, is_calm: bool) -> None:
    assert house.tells(0.1, is_calm=is_calm) == 1


@pytest.mark.parametrize('asks', [False, True])
def test_a_busy_route_tells_each_second_asked_or_not(house: House, *, asks: bool) -> None:
    assert 8 <= house.tells(10, is_calm=False, asks=asks) <= 10


def test_an_idle_route_that_nobody_asks_tells_each_ten_seconds(house: House) -> None:
    assert 9 <= house.tells(100, is_calm=True) <= 10


def test_an_idle_route_tells_once_when_it_is_asked_once(house: House) -> None:
    house.tells(3, is_calm=True)
    house.telling.is_asked = True
    assert house.tells(0.1, is_calm=True) == 1
    assert not house.telling.is_asked
    assert house.tells(5, is_calm=True) == 0


def test_an_idle_route_that_is_asked_all_the_time_tells_at_most_once_a_second(
    house: House,
) -> None:
    assert 8 <= house.tells(10, is_calm=True, asks=True) <= 10


def test_a_pause_and_its_end_are_told_at_once(house: House) -> None:
    house.tells(0.1, is_calm=True)
    for asked in (True, False):
        house.pause.asked = asked
        assert house.tells(0.9, is_calm=True) == 1
