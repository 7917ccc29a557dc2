"""How long a route is taken on for beside the next bridge: its takes tell, where it takes."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from support.patience import eventually
from support.worlds.exclusive_route import IN_USE, House, MemoryLock, MemoryPipeline, Nobody

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.threads.stop import Stop

LATE_NS = 2000 * 10**9
QUIET_S, MOST_S = 10.0, 30.0


def never(_: Stop) -> None:
    raise AssertionError('it has no spool')


class Everywhere(Nobody):
    """A successor that is needed, and there."""

    def is_needed(self) -> bool:
        return True

    def has_come(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """What the leader takes for the module `time`; the route lets it go on."""
    clock = SimpleNamespace(now_s=1000.0)
    clock.monotonic = lambda: clock.now_s
    clock.time_ns = lambda: round(clock.now_s * 1e9)
    for module in ('term', 'handover_window'):
        monkeypatch.setattr(f'ros2_kafka_bridge.exclusive.{module}.time', clock)
    return clock


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch) -> House:
    """One whose bridge has its turn, and whose lock goes to another when the route asks for it."""
    house = House(MemoryLock('ours'))
    monkeypatch.setattr(house, 'successor', lambda _: Everywhere())
    return house


def lose_lock(house: House, clock: SimpleNamespace, go_on: Callable[[], None]) -> float:
    """Lose it, and go on as the leader looks, until the route is to drain; returns how long."""
    stop = house.runner.stop
    house.lock.answers = ['no']
    eventually(lambda: stop.wakeup.is_rung, 10)
    began_s = clock.now_s
    while stop.wakeup.is_rung:
        stop.wakeup.clear()
        clock.now_s += 0.9  # less than what counts as a hold-up
        go_on()
    return float(clock.now_s - began_s)


def test_a_route_that_hears_what_is_new_is_taken_on_for_as_long_as_a_quiet_one(
    house: House, clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Callable[[list[Message]], None]] = []
    lasted_s: list[float] = []
    make = house.make

    def make_and_listen(*arguments: Any, on_take: Any, **named: Any) -> MemoryPipeline:
        told.append(on_take)
        return make(*arguments, **named)

    def take(stop: Stop) -> None:
        def go_on() -> None:
            told[0]([Message(b'', b'publisher', 1, LATE_NS)])
            eventually(lambda: stop.asked or stop.wakeup.is_rung, 10)

        def until_drain() -> None:
            go_on()
            if stop.asked:
                stop.wakeup.clear()

        lasted_s.append(lose_lock(house, clock, until_drain))
        house.runner.stop.ask()

    monkeypatch.setattr(house, 'make', make_and_listen)
    house.pipelines = [MemoryPipeline(1, take)]
    house.run()
    assert QUIET_S <= lasted_s[0] < QUIET_S + 3


def test_a_route_that_waits_for_its_spool_is_not_waited_for_as_one_that_is_held_up(
    house: House, clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes nothing, and nothing else is to come of it."""
    began_s: list[float] = []

    def claim(_: object) -> None:
        if not began_s:
            house.lock.answers = ['no']
            eventually(lambda: house.runner.stop.wakeup.is_rung, 10)
            began_s.append(clock.now_s)
        clock.now_s += 0.9
        raise IN_USE

    def look(_: MemoryLock) -> None:
        if began_s:
            house.runner.stop.ask()

    monkeypatch.setattr(MemoryLock, 'check', look)
    monkeypatch.setattr(house, 'claim_spool', claim)
    house.pipelines = [MemoryPipeline(1, never)]
    house.run()
    assert QUIET_S <= clock.now_s - began_s[0] < QUIET_S + 5
