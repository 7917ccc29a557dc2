"""A route that bridges run in turn: what a bridge does when its turn comes, goes, or fails."""

import logging
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self, cast

import pytest

from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError, RouteError, SpoolInUseError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.protocol.worker import Event
from ros2_kafka_bridge.route.counters import Counters, Outcome, Snapshot, State
from ros2_kafka_bridge.route.status import totals
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.turns.term import Term

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.successor import RosSuccessor
    from ros2_kafka_bridge.wiring import Wiring


IN_USE = SpoolInUseError(4711, Path('/var/spool/pair.orders.spool.lock'))


class MemoryLock:
    """A lock in memory: `answers` says at each poll whose it is."""

    def __init__(self, answers: str = '') -> None:
        self.answers = answers.split()
        self.held = self.joined = self.wanted = False
        self.away = ''
        self.problems: list[BridgeError] = []
        self.said: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        if self.problems:
            raise self.problems.pop(0)

    def poll(self, timeout_s: float) -> None:
        assert timeout_s >= 0
        if self.answers:
            self.joined, self.held = True, self.answers.pop(0) == 'ours'

    def check(self) -> None:
        pass

    def is_wanted(self) -> bool:
        return self.wanted

    def close(self) -> None:
        self.held = self.joined = False
        self.said.append('closed')


class MemoryDirection:
    """A direction that takes some messages, does what it is told, and confirms all but some."""

    def __init__(self, taken: int, then: Callable[[Stop], None], left: int = 0) -> None:
        self._counters = Counters('orders')
        self.snapshot = self._counters.snapshot(0)
        self._taken, self._then, self._left = taken, then, left

    def deliver_backlog(self, stop: Stop) -> None:
        self.run(stop)

    def run(self, stop: Stop, _pause: Pause | None = None) -> None:
        self._counters.taken += self._taken
        self._counters.end(Outcome.CONFIRMED, self._taken - self._left)
        self._counters.tell_end()
        self.snapshot = self._counters.snapshot(self._left)
        self._then(stop)


class Told:
    """A direction that shows a snapshot and does nothing."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot


class Nobody:
    """A successor where none is needed."""

    def is_needed(self, *, may_read: bool) -> bool:
        del may_read
        return False

    def has_come(self) -> bool:
        return False


class House:
    """A bridge with one route, whose terms are these directions, one after the other."""

    def __init__(self, lock: MemoryLock, *directions: MemoryDirection) -> None:
        content = {
            'name': 'pair',
            'kafka': {'bootstrap.servers': 'localhost:1'},
            'routes': [
                {
                    'name': 'orders',
                    'from': {'ros': '/orders'},
                    'to': {'kafka': 'orders'},
                    'format': 'cdr',
                    'exclusive': True,
                    'drain_s': 0,
                }
            ],
        }
        self.bridge = Bridge(Config.model_validate(content))
        [self.lane] = self.bridge._lanes
        assert isinstance(self.lane.lock, GroupLock)
        self.lane.lock = cast('GroupLock', lock)
        self.lock = lock
        self.directions = list(directions)
        self.for_backlog: MemoryDirection | None = None
        self.in_use: SpoolInUseError | None = None
        self.claims_until_free = 0
        self.claims: list[int] = []  # ROS endpoints at each
        self.reasons: list[str] = []  # what the route said then
        self.open = 0  # ROS endpoints
        self.told = 0

    def make(self, *arguments: Any) -> MemoryDirection:
        self.open += 1
        arguments[-1].callback(self._close)
        return self.directions.pop(0)

    def make_for_backlog(self, *_: Any) -> MemoryDirection | None:
        return self.for_backlog

    def successor(self, _: Any) -> 'Nobody':
        return Nobody()

    def is_spool_in_use(self, _: Any) -> bool:
        return self.in_use is not None

    def claim_spool(self, _: Any) -> None:
        self.claims.append(self.open)
        self.reasons.append(self.snapshot.reason)
        if self.in_use is not None or len(self.claims) < self.claims_until_free:
            raise IN_USE

    def _close(self) -> None:
        self.open -= 1

    def run(self) -> None:
        self.bridge._keep_running(self.lane, cast('Wiring', self), self._tell)
        assert self.open == 0
        assert not self.bridge._crashed

    def _tell(self, _event: Event) -> None:
        self.told += 1

    def stop(self, _: Stop) -> None:
        self.lane.stop.ask()

    @property
    def snapshot(self) -> Snapshot:
        [snapshot] = self.bridge.snapshots()
        assert snapshot.balanced
        return snapshot


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.threads.backoff._FIRST_S', 0.01)


def until_asked(stop: Stop) -> None:
    assert stop.wait(10)


def fail(_: Stop) -> None:
    raise RouteError('no permission')


def test_a_bridge_that_stands_by_delivers_what_it_has_on_disk_from_before() -> None:
    lock = MemoryLock('theirs theirs theirs theirs ours')
    house = House(lock)
    house.directions.append(MemoryDirection(2, house.stop))
    delivered: list[bool] = []
    house.for_backlog = MemoryDirection(3, lambda _: delivered.append(lock.held))
    house.run()
    assert delivered == [False], 'once, and before its turn'
    assert house.lane.snapshot().confirmed == 5
    assert house.lane.snapshot().balanced


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
        terms.append(house.lane.final)
        until_asked(stop)

    def end(_: Stop) -> None:
        terms.append(house.lane.final)
        house.lane.stop.ask()

    house.for_backlog = MemoryDirection(3, refuse, left=1)
    house.directions = [MemoryDirection(2, hand_over), MemoryDirection(2, end)]
    house.run()
    assert 'failed: stopped, as on_error says; tried again in' in caplog.text
    assert terms == [False, False]
    assert not house.lane.final
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
        house.lane.stop.ask()

    house.directions = [MemoryDirection(5, look), MemoryDirection(7, look_and_stop)]
    house.run()
    assert seen == [(State.STOPPED, 5, 1), (State.STOPPED, 12, 1)]
    assert (house.snapshot.taken, house.snapshot.confirmed) == (12, 12)
    assert not lock.held


def test_a_bridge_that_stands_by_says_why_it_waits(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    lock = MemoryLock('no')
    house = House(lock)
    house.lane.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.reason == 'asks Kafka which bridge runs this route'
    house.lane.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.state == State.WAITING
    assert house.snapshot.reason == 'stands by: another bridge runs this route'
    assert caplog.text.count('stands by') == 1
    lock.away = 'Kafka is away: no broker answers'
    house.lane.wait_for_turn(cast('GroupLock', lock))
    assert house.snapshot.reason == lock.away


def test_a_route_that_fails_keeps_its_turn_while_it_is_tried_again() -> None:
    lock = MemoryLock('ours')
    lock.wanted = True
    house = House(lock)
    tries: list[int] = []

    def fail_twice(stop: Stop) -> None:
        tries.append(house.open)
        if len(tries) < 3:
            fail(stop)
        house.lane.stop.ask()

    house.directions = [MemoryDirection(1, fail_twice)]
    house.run()
    assert tries == [1, 1, 1], 'it is the same direction, with its ROS endpoint open'
    assert lock.said == ['closed']


def test_a_route_that_fails_for_long_goes_to_a_bridge_that_stands_by(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._FAILING_S', 0.0)
    lock = MemoryLock('ours')
    lock.wanted = True
    house = House(lock)

    def look(_: MemoryLock) -> None:
        if lock.said:
            assert house.snapshot.reason == 'no permission'
            house.lane.stop.ask()

    house.directions = [MemoryDirection(3, fail, left=1)]
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert lock.said == ['closed', 'closed']
    assert 'left to a bridge that stands by, 1 message given up' in caplog.text
    assert (house.snapshot.in_flight, house.snapshot.given_up) == (0, 1)
    assert '3 taken, 2 confirmed, 0 dead-lettered, 1 given up' in totals(house.snapshot)


def test_a_route_that_gets_on_between_its_failures_is_not_given_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._FAILING_S', 0.02)
    lock = MemoryLock('ours')
    lock.wanted = True
    house = House(lock)
    tries: list[int] = []

    def get_on_and_fail(stop: Stop) -> None:
        tries.append(1)
        if len(tries) < 5:
            fail(stop)
        house.lane.stop.ask()

    house.directions = [MemoryDirection(1, get_on_and_fail)]  # one confirmed each time
    house.run()
    assert lock.said == ['closed']


@pytest.mark.parametrize(
    ('well_s', 'given_away'), [(3600.0, False), (170.0, True)], ids=['an hour', 'three minutes']
)
def test_a_route_without_traffic_is_given_away_for_its_last_failures_only(
    monkeypatch: pytest.MonkeyPatch, *, well_s: float, given_away: bool
) -> None:
    now_s = 1000.0
    monkeypatch.setattr(
        'ros2_kafka_bridge.turns.lane.time', SimpleNamespace(monotonic=lambda: now_s)
    )
    lock = MemoryLock('ours')
    lock.wanted = True
    lane = House(lock).lane
    term = Term(lane.stop, cast('GroupLock', lock), cast('RosSuccessor', None))
    lock.poll(0.0)
    lane.begin()
    lane.fail(RouteError('Kafka is away'), term)
    assert not lane.give_away(term)
    lane.begin()
    now_s += well_s
    lane.fail(RouteError('Kafka is away'), term)
    assert lane.give_away(term) is given_away


def test_a_route_that_fails_stays_where_no_other_bridge_stands_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._FAILING_S', 0.0)
    lock = MemoryLock('ours')
    house = House(lock)
    tries: list[int] = []

    def fail_often(stop: Stop) -> None:
        tries.append(1)
        if len(tries) < 5:
            fail(stop)
        house.lane.stop.ask()

    house.directions = [MemoryDirection(1, fail_often)]
    house.run()
    assert lock.said == ['closed']


def test_a_drain_that_gives_up_after_the_turn_is_over_does_not_end_the_route() -> None:
    house = House(MemoryLock('ours no no ours'))

    def give_up(stop: Stop) -> None:
        until_asked(stop)
        raise RouteError('gave up 2 messages', final=True)

    house.directions = [MemoryDirection(9, give_up, left=2), MemoryDirection(1, house.stop)]
    house.run()
    assert not house.lane.final
    assert house.told == 0
    assert (house.snapshot.taken, house.snapshot.in_flight, house.snapshot.given_up) == (10, 0, 2)


def test_a_route_that_has_failed_for_good_leaves_it_to_another() -> None:
    def end(_: Stop) -> None:
        raise RouteError('stopped, as on_error says', final=True)

    house = House(MemoryLock('ours'), MemoryDirection(1, end))
    house.run()
    assert house.lane.final
    assert house.told == 1
    assert house.snapshot.state == State.FAILED
    assert house.lock.said == ['closed']


def test_a_drain_that_gives_up_at_a_stop_ends_the_route_and_is_no_failure_for_good() -> None:
    """The process ends with an error, and whoever restarts it may run the route again."""
    house = House(MemoryLock('ours'))

    def give_up(stop: Stop) -> None:
        house.lane.stop.ask()
        until_asked(stop)
        raise RouteError('gave up 2 messages', final=True)

    house.directions = [MemoryDirection(9, give_up, left=2)]
    house.run()
    assert house.lane.final
    assert not house.lane.for_good
    assert house.told == 0
    assert (house.snapshot.state, house.snapshot.final) == (State.FAILED, False)
    assert house.snapshot.reason == 'gave up 2 messages'


def test_a_lock_that_cannot_be_had_is_a_failure_that_is_tried_again() -> None:
    lock = MemoryLock('ours')
    lock.problems = [RouteError('the topic is not there')]
    house = House(lock)
    house.directions = [MemoryDirection(1, house.stop)]
    house.run()
    assert lock.said == ['closed', 'closed']
    assert house.snapshot.confirmed == 1


def test_what_waits_on_disk_is_counted_once_across_terms() -> None:
    house = House(MemoryLock())
    first, second = Counters('orders'), Counters('orders')
    first.taken, second.taken = 10, 4  # four of them found on disk
    first.end(Outcome.CONFIRMED, 6)
    second.end(Outcome.CONFIRMED, 4)

    house.lane.use(cast('Any', Told(first.snapshot(0, spooled=4))))
    house.lane.end_term()
    assert (house.snapshot.taken, house.snapshot.spooled) == (10, 4)
    house.lane.use(cast('Any', Told(second.snapshot(0))))
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
    house.lane.use(cast('Any', Told(counters.snapshot(0))))
    house.lane.fail(RouteError('topic not.there does not exist'), house.lane.stop)
    assert house.lane.snapshot().state is State.FAILED
    house.lane.begin_run()
    assert house.lane.snapshot().reason == (
        'the window is full; has failed before: topic not.there does not exist'
    )
    counters.taken += 1
    counters.end(Outcome.CONFIRMED)
    house.lane.use(cast('Any', Told(counters.snapshot(0))))
    assert house.lane.snapshot().reason == 'the window is full'


def test_errors_of_all_turns_are_counted_and_kept() -> None:
    house = House(MemoryLock())
    for _ in range(3):
        house.lane.fail(RouteError('no such topic'), house.lane.stop)
    house.lane.end_term()
    house.lane.begin_term()
    house.lane.fail(RouteError('no such topic'), house.lane.stop)
    measures = house.lane.snapshot().measures
    assert measures.errors == {'RouteError': 4}
    [trouble] = measures.troubles
    assert (trouble.text, trouble.times) == ('no such topic', 4)


def test_a_thread_that_waits_on_purpose_shows_no_beat() -> None:
    house = House(MemoryLock())
    assert house.lane.snapshot().beat_s == 0, 'it waits for its type'
    house.lane.use(cast('Any', Told(Counters('orders').snapshot(0))))
    assert house.lane.snapshot().beat_s > 0
    house.lane.fail(RouteError('no such topic'), house.lane.stop)
    assert house.lane.snapshot().beat_s == 0
    house.lane.begin_run()
    assert house.lane.snapshot().beat_s > 0
    house.lane.stop.ask()
    assert house.lane.snapshot().beat_s == 0


def test_a_route_that_waits_for_its_type_says_that_it_is_paused() -> None:
    house = House(MemoryLock())
    assert house.lane.snapshot().state is State.STARTING
    assert house.bridge.pause('orders')
    assert not house.bridge.pause('unknown')
    assert house.bridge.paused == {'orders'}
    assert house.lane.snapshot().state is State.PAUSED
    assert house.bridge.resume('orders')
    assert house.bridge.paused == frozenset()
    assert house.lane.snapshot().state is State.STARTING


# Two bridges of one machine, and the spool that both use


def test_a_bridge_that_stands_by_leaves_the_spool_to_the_process_that_uses_it(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stays among those that want the route: leaving them would keep it from taking over."""
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._BACKLOG_S', 0.0)
    lock = MemoryLock('theirs theirs theirs theirs ours')
    house = House(lock)
    house.directions.append(MemoryDirection(2, house.stop))
    house.in_use = IN_USE
    looked = 0

    def look(_: MemoryLock) -> None:
        nonlocal looked
        looked += 1
        assert lock.said == []
        if len(lock.answers) == 1:
            assert house.snapshot.reason == 'stands by: another bridge runs this route'
            house.in_use = house.for_backlog = None

    house.for_backlog = MemoryDirection(0, fail)
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert looked == 5
    assert 'failed' not in caplog.text
    assert house.snapshot.confirmed == 2


def test_a_bridge_that_cannot_deliver_its_backlog_stands_by_and_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lock = MemoryLock('theirs theirs theirs theirs ours')
    house = House(lock)
    house.directions.append(MemoryDirection(2, house.stop))
    house.for_backlog = MemoryDirection(0, fail)
    reasons: set[str] = set()

    def look(_: MemoryLock) -> None:
        assert lock.said == [], 'it is still one of those that stand by'
        reasons.add(house.snapshot.reason)

    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert (
        'stands by: another bridge runs this route; what this one has on disk is not delivered: '
        'no permission'
    ) in reasons
    assert house.snapshot.confirmed == 2


def test_guarantee_8_a_turn_waits_until_the_bridge_before_has_put_the_spool_away(
    caplog: pytest.LogCaptureFixture,
) -> None:
    lock = MemoryLock('ours')
    house = House(lock)
    house.directions.append(MemoryDirection(2, house.stop))
    house.claims_until_free = 4
    house.run()
    assert house.claims == [1, 1, 1, 1], 'the ROS endpoint is open: the other one sees it'
    assert house.reasons[1:] == 3 * [
        'its turn has come, but process 4711 still has the spool /var/spool/pair.orders.spool.lock'
    ]
    assert house.snapshot.confirmed == 2
    assert 'failed' not in caplog.text


def test_guarantee_8_a_turn_without_the_spool_goes_back_to_a_bridge_that_stands_by(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has the spool may still run the route, and be held back by an endpoint that is idle."""
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._SPOOL_S', 0.0)
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane.OVERLAP_S', 0.0)
    lock = MemoryLock('ours')
    house = House(lock, MemoryDirection(0, fail))
    house.in_use = IN_USE
    waits: list[int] = []

    def is_wanted(_: MemoryLock) -> bool:
        waits.append(house.open)
        return True

    monkeypatch.setattr(MemoryLock, 'is_wanted', is_wanted)

    def look(_: MemoryLock) -> None:
        if lock.said:
            assert house.open == 0
            house.lane.stop.ask()

    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert lock.said == ['closed', 'closed']
    assert 'what the reader here holds may be lost: left to a bridge that stands by' in caplog.text
    assert len(waits) == 2, 'one that went on just now needs a while'


def test_a_turn_without_the_spool_is_kept_where_no_other_bridge_stands_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane._SPOOL_S', 0.0)
    monkeypatch.setattr('ros2_kafka_bridge.turns.lane.OVERLAP_S', 0.0)
    lock = MemoryLock('ours')
    house = House(lock)
    house.directions.append(MemoryDirection(2, house.stop))
    house.claims_until_free = 6
    house.run()
    assert set(house.claims) == {1}
    assert lock.said == ['closed']
    assert house.snapshot.confirmed == 2
