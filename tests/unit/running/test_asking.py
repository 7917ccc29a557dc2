"""Who asks for the counters of a route lets an idle one tell them, and disturbs no other."""

from typing import TYPE_CHECKING, cast

import pytest
from support.worlds.exclusive_route import House, MemoryLock, MemoryPipeline, until_asked

if TYPE_CHECKING:
    from ros2_kafka_bridge.wiring import Pipeline


@pytest.fixture
def house() -> House:
    return House(MemoryLock())


def test_an_ask_rings_an_idle_route_and_only_once_until_it_has_told(house: House) -> None:
    pipeline = MemoryPipeline(0, until_asked)
    house.runner.use(cast('Pipeline', pipeline))
    rung = house.runner.stop.wakeup
    for _ in range(2):
        house.runner.snapshot()
        assert rung.is_rung
        assert pipeline.telling.is_asked
        rung.clear()
        for _ in range(3):
            house.runner.snapshot()
        assert not rung.is_rung
        pipeline.telling.is_asked = False  # it has told


def test_an_ask_rings_no_route_that_nothing_runs(house: House) -> None:
    house.runner.snapshot()
    assert not house.runner.stop.wakeup.is_rung


@pytest.mark.parametrize('asked', [False, True])
def test_a_pause_and_its_end_ring_a_route(house: House, *, asked: bool) -> None:
    house.runner.pause.asked = not asked
    house.runner.ask_to_pause(asked=asked)
    assert house.runner.stop.wakeup.is_rung
