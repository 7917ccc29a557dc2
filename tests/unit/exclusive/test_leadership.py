"""A route that one of several bridges runs: what each does before its turn, in it, and after."""

import gc
import logging
import weakref
from typing import TYPE_CHECKING, Any, cast

import pytest
from support.patience import eventually
from support.worlds.exclusive_route import House, MemoryLock, MemoryPipeline, turn, until_asked

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.exclusive.beside import beside
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.wiring import Wiring

pytestmark = pytest.mark.usefixtures('quick')


def test_a_bridge_that_stands_by_delivers_what_it_has_on_disk_from_before() -> None:
    house, lock = turn('theirs theirs theirs theirs ours')
    house.pipelines = [MemoryPipeline(2, house.stop)]
    delivered: list[bool] = []
    house.for_backlog = MemoryPipeline(3, lambda _: delivered.append(lock.held))
    house.run()
    assert delivered == [False], 'once, and before its turn'
    assert house.runner.snapshot().confirmed == 5
    assert house.runner.snapshot().balanced


def test_a_backlog_that_ends_for_good_while_another_bridge_runs_the_route_is_tried_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    house = House(MemoryLock('theirs theirs theirs theirs ours theirs theirs ours'))
    terms: list[bool] = []

    def refuse(_: Stop) -> None:
        house.for_backlog = None
        raise RouteError('stopped, as on_error says', final=True)

    def hand_over(stop: Stop) -> None:
        terms.append(house.runner.final)
        until_asked(stop)

    def end(_: Stop) -> None:
        terms.append(house.runner.final)
        house.runner.stop.ask()

    house.for_backlog = MemoryPipeline(3, refuse, left=1)
    house.pipelines = [MemoryPipeline(2, hand_over), MemoryPipeline(2, end)]
    house.run()
    assert 'failed: stopped, as on_error says; tried again in' in caplog.text
    assert terms == [False, False]
    assert not house.runner.final
    assert house.told == 0
    assert (house.snapshot.taken, house.snapshot.given_up) == (7, 1)


def test_a_bridge_stands_by_until_it_is_its_turn_and_counts_across_its_terms() -> None:
    house, lock = turn('no no ours no ours')
    seen: list[tuple[State, int, int]] = []

    def look(stop: Stop) -> None:
        seen.append((house.snapshot.state, house.snapshot.taken, house.open))
        until_asked(stop)

    def look_and_stop(_: Stop) -> None:
        seen.append((house.snapshot.state, house.snapshot.taken, house.open))
        house.runner.stop.ask()

    house.pipelines = [MemoryPipeline(5, look), MemoryPipeline(7, look_and_stop)]
    house.run()
    assert seen == [(State.STOPPED, 5, 1), (State.STOPPED, 12, 1)]
    assert (house.snapshot.taken, house.snapshot.confirmed) == (12, 12)
    assert not lock.held


def test_a_bridge_that_stands_by_says_why_it_waits(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    house, lock = turn('no no no')
    reasons: list[str] = []

    def look(_: MemoryLock) -> None:
        reasons.append(house.snapshot.reason)
        lock.away = 'Kafka is away: no broker answers' if len(reasons) == 2 else ''
        if len(reasons) == 4:
            house.runner.stop.ask()

    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert reasons[1:] == [
        'asks Kafka which bridge runs this route',
        'Kafka is away: no broker answers',
        'stands by: another bridge runs this route',
    ]
    assert caplog.text.count('stands by') == 1


def test_a_hand_over_has_no_limit_until_the_bridge_stops_and_none_at_once_before() -> None:
    """What is in flight is waited for as long as this bridge lives."""
    house = House(MemoryLock('ours no'))
    seen: list[tuple[bool, bool]] = []

    def drain(stop: Stop) -> None:
        until_asked(stop)
        seen.append((stop.is_limited, stop.at_once))
        for passed_on in (lambda: stop.is_limited, lambda: stop.at_once):
            house.runner.stop.ask()
            eventually(passed_on, 10)
            seen.append((stop.is_limited, stop.at_once))

    house.pipelines = [MemoryPipeline(1, drain)]
    house.run()
    assert seen == [(False, False), (True, False), (True, True)]


def test_a_stop_reaches_a_backlog_that_is_being_delivered() -> None:
    house = House(MemoryLock('theirs theirs'))
    seen: list[tuple[bool, bool]] = []

    def deliver(stop: Stop) -> None:
        for passed_on in (lambda: stop.is_limited, lambda: stop.at_once):
            house.runner.stop.ask()
            eventually(passed_on, 10)
            seen.append((stop.is_limited, stop.at_once))

    house.for_backlog = MemoryPipeline(1, deliver)
    house.run()
    assert seen == [(True, False), (True, True)]


def test_the_turn_of_a_bridge_ends_the_delivery_of_its_backlog() -> None:
    house, lock = turn(
        'theirs theirs theirs ours', MemoryPipeline(2, lambda _: house.runner.stop.ask())
    )
    delivering: list[bool] = []

    def deliver(stop: Stop) -> None:
        delivering.append(lock.held)
        until_asked(stop)
        delivering.append(lock.held)

    house.for_backlog = MemoryPipeline(3, deliver)
    house.run()
    assert delivering == [False, True]
    assert house.snapshot.confirmed == 5


@pytest.mark.parametrize('where', ['route', 'lock'])
def test_a_bug_in_either_thread_ends_the_bridge_and_leaves_no_route_running(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    house = House(MemoryLock('ours'))
    ended: list[bool] = []

    def run(stop: Stop) -> None:
        if where == 'route':
            raise ZeroDivisionError
        monkeypatch.setattr(MemoryLock, 'poll', lambda *_: 1 // 0)
        until_asked(stop)
        ended.append(True)

    house.pipelines = [MemoryPipeline(1, run)]
    house.bridge._keep_running(house.runner, cast('Wiring', house), lambda _: None)
    assert house.bridge._crashed
    assert house.bridge.stop.asked
    assert 'a bug of the bridge ended this route' in caplog.text
    assert 'ZeroDivisionError' in caplog.text
    assert ended == ([] if where == 'route' else [True])
    assert house.open == 0
    assert not house.lock.held


def test_a_bug_of_the_lock_ends_the_route_at_once_where_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(MemoryLock('ours'))

    def run(stop: Stop) -> None:
        monkeypatch.setattr(MemoryLock, 'poll', lambda *_: 1 // 0)
        until_asked(stop)
        for _ in range(2):
            house.runner.stop.ask()
        eventually(lambda: stop.at_once, 10)

    house.pipelines = [MemoryPipeline(1, run)]
    house.bridge._keep_running(house.runner, cast('Wiring', house), lambda _: None)
    assert house.bridge._crashed


def test_an_error_that_was_raised_again_is_held_by_nobody() -> None:
    """It would hold what its frames do: a batch of messages, for one."""

    def raise_it(_: Stop) -> None:
        batch = Batch()
        batches.append(weakref.ref(batch))
        raise RouteError('no permission')

    batches: list[weakref.ref[Batch]] = []
    gc.disable()
    try:
        with pytest.raises(RouteError), beside(raise_it, Stop(), 'orders'):
            pass
        assert batches[0]() is None
    finally:
        gc.enable()


class Batch:
    """What can be held weakly."""


def test_a_failure_is_shown_until_kafka_has_told_and_until_the_route_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A person who looks meanwhile is to see it."""
    lock = MemoryLock()
    lock.problems = [RouteError('the topic is not there')]
    house = House(lock, MemoryPipeline(1, lambda _: house.runner.stop.ask()))
    reasons: list[str] = []

    def look(_: MemoryLock) -> None:
        reasons.append(house.snapshot.reason)
        lock.answers = ['ours']

    def make(*arguments: Any, **named: Any) -> MemoryPipeline:
        reasons.append(house.snapshot.reason)
        return made(*arguments, **named)

    made, house.make = house.make, make  # type: ignore[method-assign]
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert set(reasons) == {'the topic is not there'}


def test_a_route_that_another_goes_on_with_shows_its_failure_until_kafka_has_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house, lock = turn('ours no')
    reasons: list[str] = []

    def give_up(stop: Stop) -> None:
        until_asked(stop)
        lock.joined = False
        raise RouteError('gave up 2 messages', final=True)

    def look(_: MemoryLock) -> None:
        if house.runner.failures.times:
            reasons.append(house.snapshot.reason)
            house.runner.stop.ask()

    house.pipelines = [MemoryPipeline(9, give_up, left=2)]
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert reasons == ['gave up 2 messages']
