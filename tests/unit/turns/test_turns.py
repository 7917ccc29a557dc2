"""A route that bridges run in turn: what a bridge does when its turn comes, goes, or fails."""

import logging
from typing import TYPE_CHECKING, Any, cast

import pytest
from turning import House, MemoryLock, MemoryPipeline, Told, until_asked

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Counters, Outcome, State
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.kafka.lock import GroupLock

pytestmark = pytest.mark.usefixtures('quick')


def test_a_bridge_that_stands_by_delivers_what_it_has_on_disk_from_before() -> None:
    lock = MemoryLock('theirs theirs theirs theirs ours')
    house = House(lock)
    house.pipelines.append(MemoryPipeline(2, house.stop))
    delivered: list[bool] = []
    house.for_backlog = MemoryPipeline(3, lambda _: delivered.append(lock.held))
    house.run()
    assert delivered == [False], 'once, and before its turn'
    assert house.runner.snapshot().confirmed == 5
    assert house.runner.snapshot().balanced


def test_a_backlog_that_ends_for_good_while_another_bridge_runs_the_route_is_tried_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    lock = MemoryLock('theirs theirs theirs theirs ours theirs theirs ours')
    house = House(lock)
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
    lock = MemoryLock('no no ours no ours')
    house = House(lock)
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


def test_a_bridge_that_stands_by_says_why_it_waits(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    lock = MemoryLock('no')
    house = House(lock)
    house.runner.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.reason == 'asks Kafka which bridge runs this route'
    house.runner.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.state == State.WAITING
    assert house.snapshot.reason == 'stands by: another bridge runs this route'
    assert caplog.text.count('stands by') == 1
    lock.away = 'Kafka is away: no broker answers'
    house.runner.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.reason == lock.away


def test_what_waits_on_disk_is_counted_once_across_terms() -> None:
    house = House(MemoryLock())
    first, second = Counters('orders'), Counters('orders')
    first.taken, second.taken = 10, 4  # four of them found on disk
    first.end(Outcome.CONFIRMED, 6)
    second.end(Outcome.CONFIRMED, 4)

    house.runner.use(cast('Any', Told(first.snapshot(0, spooled=4))))
    house.runner.end_term()
    assert (house.snapshot.taken, house.snapshot.spooled) == (10, 4)
    house.runner.use(cast('Any', Told(Counters('orders').snapshot(0))))
    assert (house.snapshot.taken, house.snapshot.spooled) == (6, None), 'not opened yet'
    house.runner.use(cast('Any', Told(second.snapshot(0, spooled=0))))
    assert (house.snapshot.taken, house.snapshot.confirmed, house.snapshot.spooled) == (10, 10, 0)


@pytest.mark.parametrize('counter', ['confirmed', 'spooled', 'in_flight', 'repeated'])
def test_a_counter_below_zero_is_never_balanced(counter: str) -> None:
    even = Counters('orders').snapshot(0)
    assert even.balanced
    below: dict[str, Any] = {'taken': 0 if counter == 'repeated' else -1, counter: -1}
    assert not even._replace(**below).balanced


def test_a_route_that_waits_says_why_it_has_failed_until_it_has_confirmed_something() -> None:
    house = House(MemoryLock())
    counters = Counters('orders')
    counters.tell('', 'the window is full')
    house.runner.use(cast('Any', Told(counters.snapshot(0))))
    house.runner.fail(RouteError('topic not.there does not exist'), house.runner.stop)
    assert house.runner.snapshot().state is State.FAILED
    house.runner.begin_run()
    assert house.runner.snapshot().reason == (
        'the window is full; has failed before: topic not.there does not exist'
    )
    counters.taken += 1
    counters.end(Outcome.CONFIRMED)
    house.runner.use(cast('Any', Told(counters.snapshot(0))))
    assert house.runner.snapshot().reason == 'the window is full'


def test_errors_of_all_turns_are_counted_and_kept() -> None:
    house = House(MemoryLock())
    for _ in range(3):
        house.runner.fail(RouteError('no such topic'), house.runner.stop)
    house.runner.end_term()
    house.runner.begin_term()
    house.runner.fail(RouteError('no such topic'), house.runner.stop)
    measures = house.runner.snapshot().measures
    assert measures.errors == {'RouteError': 4}
    [trouble] = measures.troubles
    assert (trouble.text, trouble.times) == ('no such topic', 4)


def test_a_thread_that_waits_on_purpose_shows_no_beat() -> None:
    house = House(MemoryLock())
    assert house.runner.snapshot().beat_s == 0, 'it waits for its type'
    house.runner.use(cast('Any', Told(Counters('orders').snapshot(0))))
    assert house.runner.snapshot().beat_s > 0
    house.runner.fail(RouteError('no such topic'), house.runner.stop)
    assert house.runner.snapshot().beat_s == 0
    house.runner.begin_run()
    assert house.runner.snapshot().beat_s > 0
    house.runner.stop.ask()
    assert house.runner.snapshot().beat_s == 0


def test_a_route_that_waits_for_its_type_says_that_it_is_paused() -> None:
    house = House(MemoryLock())
    assert house.runner.snapshot().state is State.STARTING
    assert house.bridge.pause('orders')
    assert not house.bridge.pause('unknown')
    assert house.bridge.paused == {'orders'}
    assert house.runner.snapshot().state is State.PAUSED
    assert house.bridge.resume('orders')
    assert house.bridge.paused == frozenset()
    assert house.runner.snapshot().state is State.STARTING
