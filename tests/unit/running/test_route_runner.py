"""One route in a running bridge: what is said of it while it runs, fails, and is tried again."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
from support.worlds.exclusive_route import House, MemoryLock, Told

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Counters, Outcome, State
from ros2_kafka_bridge.running.route_runner import Conditions, RouteRunner
from ros2_kafka_bridge.running.route_status import Shown
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Pipeline

pytestmark = pytest.mark.usefixtures('quick')


def test_what_waits_on_disk_is_counted_once_across_terms() -> None:
    house = House(MemoryLock())
    first, second = Counters('orders'), Counters('orders')
    first.taken, second.taken = 10, 4  # four of them found on disk
    first.end(Outcome.CONFIRMED, 6)
    second.end(Outcome.CONFIRMED, 4)

    house.runner.use(cast('Any', Told(first.snapshot(0, spooled=4))))
    house.runner.forget_pipeline()
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


class Tries:
    """A route of which each try does the next of some things; the last ends it."""

    def __init__(self, runner: RouteRunner, *tries: Callable[[], object]) -> None:
        self.telling = SimpleNamespace(is_asked=False)
        self.counters = Counters('orders')
        self.snapshot = self.counters.snapshot(0)
        self._runner = runner
        self._tries: list[Callable[[], object]] = [*tries, lambda: None]

    def run_all(self, conditions: Conditions | None = None) -> None:
        """Let the route run until none is left."""
        self._runner.run(Stop(), lambda *_: cast('Pipeline', self), conditions)

    def run(self, _stop: Stop, _pause: Pause) -> None:
        self._tries.pop(0)()


class Answers:
    """The conditions of a route, as a test says."""

    def __init__(
        self,
        may_run: Callable[[Pipeline], bool] = lambda _: True,
        is_ours: Callable[[], bool] = lambda: True,
        is_kept: Callable[[], bool] = lambda: True,
    ) -> None:
        self._may_run = may_run
        self.is_ours = is_ours
        self.is_kept = is_kept

    def may_run(self, pipeline: Pipeline, _stop: Stop) -> bool:
        return self._may_run(pipeline)


def fail() -> None:
    raise RouteError('topic not.there does not exist')


def fail_for_good() -> None:
    raise RouteError('stopped, as on_error says', final=True)


def test_a_route_that_waits_says_why_it_has_failed_until_it_has_confirmed_something() -> None:
    runner = House(MemoryLock()).runner
    reasons: list[str] = []

    def wait_and_carry() -> None:
        tries.counters.tell('', 'the window is full')
        for _ in range(2):
            tries.snapshot = tries.counters.snapshot(0)
            reasons.append(runner.snapshot().reason)
            tries.counters.taken += 1
            tries.counters.end(Outcome.CONFIRMED)

    tries = Tries(runner, fail, wait_and_carry)
    tries.run_all()
    assert reasons == [
        'the window is full; has failed before: topic not.there does not exist',
        'the window is full',
    ]


def test_errors_of_all_that_ran_a_route_are_counted_and_kept() -> None:
    runner = House(MemoryLock()).runner
    Tries(runner, fail, fail, fail).run_all()
    runner.forget_pipeline()
    runner.begin_anew()
    Tries(runner, fail).run_all()
    runner.note_failure(RouteError('no such lock'))
    measures = runner.snapshot().measures
    assert measures.errors == {'RouteError': 5}
    assert {(it.text, it.times) for it in measures.troubles} == {
        ('topic not.there does not exist', 4),
        ('no such lock', 1),
    }


def test_a_thread_that_waits_on_purpose_shows_no_beat(monkeypatch: pytest.MonkeyPatch) -> None:
    runner = House(MemoryLock()).runner
    beats: list[bool] = []

    def look() -> None:
        beats.append(runner.snapshot().beat_s > 0)

    def look_and_fail() -> None:
        look()
        fail()

    look()
    monkeypatch.setattr(Stop, 'wait', lambda *_: look())  # before it is tried again
    Tries(runner, look_and_fail, look).run_all()
    assert beats == [False, True, False, True]
    runner.stop.ask()
    look()
    assert not beats[-1]


@pytest.mark.parametrize('ours', [True, False])
def test_a_failure_is_for_good_only_where_no_other_bridge_goes_on(*, ours: bool) -> None:
    runner = House(MemoryLock()).runner
    told: list[bool] = []
    runner.tell_final = lambda: told.append(runner.snapshot().final)
    Tries(runner, fail_for_good).run_all(Answers(is_ours=lambda: ours))
    assert (runner.final, runner.for_good) == (ours, ours)
    assert told == [True] * ours


def test_a_route_that_is_not_kept_is_not_tried_again_and_what_it_holds_is_counted() -> None:
    runner = House(MemoryLock()).runner
    answers = iter([True, False])

    def take_and_fail() -> None:
        tries.counters.taken += 3
        tries.snapshot = tries.counters.snapshot(3)
        fail()

    tries = Tries(runner, fail, take_and_fail, pytest.fail)
    tries.run_all(Answers(is_kept=lambda: next(answers)))
    assert (runner.failures.times, runner.final) == (2, False)
    runner.forget_pipeline()
    assert (runner.snapshot().given_up, runner.snapshot().in_flight) == (3, 0)


def test_what_may_not_run_yet_is_made_and_does_not_run() -> None:
    runner = House(MemoryLock()).runner
    tries = cast('Pipeline', Tries(runner, pytest.fail))
    waits = Answers(may_run=lambda pipeline: pipeline is not tries)
    runner.run(Stop(), lambda *_: tries, waits)
    assert runner.pipeline is tries


def test_a_route_takes_only_while_what_runs_it_is_at_work() -> None:
    """Whoever waits for what it takes must not wait for one that is made, awaited, or failed."""
    runner = House(MemoryLock()).runner
    taking: list[bool] = []

    def look(*_: object) -> bool:
        taking.append(runner.takes)
        return True

    def look_and_fail() -> None:
        look()
        fail()

    def make(*_: object) -> Pipeline:
        look()
        return cast('Pipeline', Tries(runner, look_and_fail, look))

    look()
    runner.run(Stop(), make, Answers(may_run=look))
    assert taking == [False, False, False, True, False, True]


def test_what_somebody_else_says_of_a_route_counts_until_it_runs_or_fails() -> None:
    runner = House(MemoryLock()).runner
    waits = Shown(State.WAITING, 'its turn has come')
    shown: list[str] = []

    def look() -> None:
        shown.append(runner.snapshot().reason)

    def make(*_: object) -> Pipeline:
        look()
        return cast('Pipeline', Tries(runner, look))

    runner.show(waits)
    runner.run(Stop(), make)
    runner.forget_pipeline()
    runner.show(waits)
    runner._fail(RouteError('no spool'), ours=True)
    look()
    assert shown == ['its turn has come', '', 'no spool']


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
