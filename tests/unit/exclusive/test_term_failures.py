"""A route that fails while a bridge has its turn: kept, given away, or ended."""

from collections.abc import Callable
from typing import NoReturn

import pytest
from support.worlds.clocks import Clock
from support.worlds.exclusive_route import (
    House,
    MemoryLock,
    MemoryPipeline,
    fail,
    turn,
    until_asked,
)

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Measures, State
from ros2_kafka_bridge.route.status import totals
from ros2_kafka_bridge.threads.stop import Stop

pytestmark = pytest.mark.usefixtures('quick')


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in ('running.route_runner', 'exclusive.lease'):
        monkeypatch.setattr(f'ros2_kafka_bridge.{module}.time', clock)
    return clock


def fails(house: House, times: int, note: Callable[[], object] = lambda: None) -> list[object]:
    """Run a route that fails so often, and is then stopped; returns what each try has noted."""
    tries: list[object] = []

    def run(stop: Stop) -> None:
        tries.append(note())
        if len(tries) <= times:
            fail(stop)
        house.runner.stop.ask()

    house.pipelines = [MemoryPipeline(1, run)]
    house.run()
    return tries


def test_a_route_that_fails_keeps_its_turn_while_it_is_tried_again() -> None:
    house, lock = turn('ours', wanted=True)
    tries = fails(house, 2, lambda: house.open)
    assert tries == [1, 1, 1], 'it is the same pipeline, with its ROS endpoint open'
    assert lock.said == ['closed']


def test_a_route_that_fails_for_long_goes_to_a_bridge_that_stands_by(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease._FAILING_S', 0.0)
    house, lock = turn('ours', wanted=True)

    def look(_: MemoryLock) -> None:
        if lock.said:
            assert house.snapshot.reason == 'no permission'
            house.runner.stop.ask()

    house.pipelines = [MemoryPipeline(3, fail, left=1)]
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert lock.said == ['closed', 'closed']
    assert 'left to a bridge that stands by, 1 message given up' in caplog.text
    assert (house.snapshot.in_flight, house.snapshot.given_up) == (0, 1)
    assert '3 taken, 2 confirmed, 0 dead-lettered, 1 given up' in totals(house.snapshot)


def test_a_route_that_gets_on_between_its_failures_is_not_given_away(clock: Clock) -> None:
    house, lock = turn('ours', wanted=True)
    # Less than it may fail for, and more in sum; one is confirmed each time.
    fails(house, 4, lambda: clock.sleep(20.0))
    assert lock.said == ['closed']


@pytest.mark.parametrize(
    ('well_s', 'given_away'), [(3600.0, False), (170.0, True)], ids=['an hour', 'three minutes']
)
def test_a_route_without_traffic_is_given_away_for_its_last_failures_only(
    monkeypatch: pytest.MonkeyPatch, clock: Clock, *, well_s: float, given_away: bool
) -> None:
    house, lock = turn('ours', wanted=True)
    tries: list[int] = []

    def fail_often(stop: Stop) -> None:
        tries.append(1)
        if len(tries) > 4:
            house.runner.stop.ask()
            return
        clock.now_s += well_s if len(tries) == 2 else 0.0
        fail(stop)

    def stop_once_given_away(lock: MemoryLock) -> None:
        if lock.said:
            house.runner.stop.ask()

    monkeypatch.setattr(MemoryLock, 'check', stop_once_given_away)
    house.pipelines = [MemoryPipeline(0, fail_often)]
    house.run()
    assert lock.said == ['closed'] * (2 if given_away else 1)


def test_a_route_that_is_tried_again_is_one_that_has_failed_until_it_tells_more() -> None:
    house = House(MemoryLock('ours'))
    seen: list[tuple[State, str, bool | None]] = []

    def look() -> None:
        now = house.snapshot
        seen.append((now.state, now.reason, now.measures.kafka_up))

    def fail_twice(stop: Stop) -> None:
        pipeline.snapshot = pipeline.snapshot._replace(measures=Measures(kafka_up=False))
        look()
        if len(seen) < 3:
            fail(stop)
        house.runner.stop.ask()
        look()

    pipeline = MemoryPipeline(0, fail_twice)
    house.pipelines = [pipeline]
    house.run()
    failed = (State.FAILED, 'no permission; tried again now', None)
    assert seen == [(State.STOPPED, '', None), failed, failed, (State.STOPPED, '', None)]


def test_what_failed_in_an_earlier_term_is_not_shown_as_tried_again() -> None:
    house = House(MemoryLock('ours no ours'))
    seen: list[State] = []
    tries: list[int] = []

    def fail_once_then_wait(stop: Stop) -> None:
        tries.append(1)
        if len(tries) < 2:
            fail(stop)
        until_asked(stop)

    def look(_: Stop) -> None:
        house.runner.use(None)  # as while it is made
        seen.append(house.snapshot.state)
        house.runner.stop.ask()

    house.pipelines = [MemoryPipeline(1, fail_once_then_wait), MemoryPipeline(1, look)]
    house.run()
    assert seen == [State.STARTING]


def test_a_route_that_fails_stays_where_no_other_bridge_stands_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease._FAILING_S', 0.0)
    house, lock = turn('ours')
    fails(house, 4)
    assert lock.said == ['closed']


def test_a_drain_that_gives_up_after_the_turn_is_over_does_not_end_the_route() -> None:
    house = House(MemoryLock('ours no no ours'))

    def give_up(stop: Stop) -> None:
        until_asked(stop)
        raise RouteError('gave up 2 messages', final=True)

    house.pipelines = [MemoryPipeline(9, give_up, left=2), MemoryPipeline(1, house.stop)]
    house.run()
    assert not house.runner.final
    assert house.told == 0
    assert (house.snapshot.taken, house.snapshot.in_flight, house.snapshot.given_up) == (10, 0, 2)


def test_a_route_that_has_failed_for_good_leaves_it_to_another() -> None:
    def end(_: Stop) -> None:
        raise RouteError('stopped, as on_error says', final=True)

    house = House(MemoryLock('ours'), MemoryPipeline(1, end))
    house.run()
    assert house.runner.final
    assert house.told == 1
    assert house.snapshot.state == State.FAILED
    assert house.lock.said == ['closed']


def test_a_drain_that_gives_up_at_a_stop_ends_the_route_and_is_no_failure_for_good() -> None:
    """The process ends with an error, and whoever restarts it may run the route again."""
    house = House(MemoryLock('ours'))

    def give_up(stop: Stop) -> None:
        house.runner.stop.ask()
        until_asked(stop)
        raise RouteError('gave up 2 messages', final=True)

    house.pipelines = [MemoryPipeline(9, give_up, left=2)]
    house.run()
    assert house.runner.final
    assert not house.runner.for_good
    assert house.told == 0
    assert (house.snapshot.state, house.snapshot.final) == (State.FAILED, False)
    assert house.snapshot.reason == 'gave up 2 messages'


def test_a_lock_that_cannot_be_had_is_a_failure_that_is_tried_again() -> None:
    lock = MemoryLock('ours')
    lock.problems = [RouteError('the topic is not there')]
    house = House(lock)
    house.pipelines = [MemoryPipeline(1, house.stop)]
    house.run()
    assert lock.said == ['closed', 'closed']
    assert house.snapshot.confirmed == 1


def test_a_stop_in_a_try_to_make_a_route_is_no_failure_for_good() -> None:
    """Nothing of it is in flight: a stop between two tries is none, either."""
    house = House(MemoryLock('ours'))

    def make(*_: object, **_named: object) -> NoReturn:
        house.runner.stop.ask()
        raise RouteError('it cannot be made')

    house.make = make  # type: ignore[method-assign]
    house.run()
    assert not house.runner.final
