"""A route that runs by a lock stops when the bridge does, or when the lock is lost."""

import pytest
from fake_waits import let_waits_pass

from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.turns.term import Standby, Term


class MemoryLock:
    """A lock in memory."""

    def __init__(self, *, wanted: bool = False) -> None:
        self.held = True
        self.lost = False  # which only a poll tells
        self.left = False
        self.wanted = wanted
        self.polls = 0

    def poll(self, timeout_s: float) -> None:
        assert timeout_s == 0.0
        assert not self.left, 'nobody asks for a lock that was left'
        self.polls += 1
        self.held = not self.lost

    def has_standby(self) -> bool:
        return self.wanted

    def close(self) -> None:
        self.held = False
        self.left = True


class Clock:
    """What stops and terms take for the module `time`; it goes on only when it is told to."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def time_ns(self) -> int:
        return round(self.now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr('ros2_kafka_bridge.turns.overlap.time', clock)
    monkeypatch.setattr('ros2_kafka_bridge.turns.term.time', clock)
    monkeypatch.setattr('ros2_kafka_bridge.threads.stop.time', clock)
    let_waits_pass(monkeypatch, clock.sleep)
    return clock


class MemorySuccessor:
    """Another bridge in memory."""

    def __init__(self, *, needed: bool = True) -> None:
        self.needed = needed
        self.come = False
        self.may_read: bool | None = None

    def note_readers(self, *, may_read: bool) -> None:
        self.may_read = may_read

    def is_needed(self) -> bool:
        return self.needed

    def has_come(self) -> bool:
        return self.come


def test_a_term_stops_with_the_bridge() -> None:
    stop = Stop()
    term = Term(stop, MemoryLock(), MemorySuccessor())
    assert not term.look()
    assert (term.asked, term.at_once, term.over) == (False, False, False)
    stop.ask()
    assert term.look()
    assert (term.asked, term.at_once, term.over) == (True, False, False)
    stop.ask()
    assert term.at_once
    assert term.wait(60)


def test_a_term_is_over_once_its_lock_was_lost_also_if_it_comes_back() -> None:
    lock = MemoryLock()
    term = Term(Stop(), lock, MemorySuccessor(needed=False))
    lock.lost = True
    assert term.wait(60)
    lock.held, lock.lost = True, False
    assert term.look()
    assert (term.asked, term.over, term.at_once) == (True, True, False)


@pytest.mark.usefixtures('clock')
def test_guarantee_8_a_term_that_is_over_runs_on_until_the_successor_reads_and_is_known() -> None:
    """As where Kafka gives the route to another, though this bridge lives and takes."""
    lock, successor = MemoryLock(), MemorySuccessor()
    term = Term(Stop(), lock, successor)
    assert not term.wait(0.3)
    lock.lost = True
    assert not term.wait(0.3)
    assert term.over
    assert not term.asked, 'the other one has not subscribed yet'
    polls = lock.polls
    successor.come = True
    assert not term.wait(3.0), 'not every publisher sends to it yet'
    assert lock.polls > polls + 10, 'a client that nobody polls is put out of its group'
    assert term.wait(60)


@pytest.mark.usefixtures('clock')
def test_a_lock_that_comes_back_before_the_drain_has_begun_lets_the_term_go_on() -> None:
    """As where the other bridge has died meanwhile: nobody else reads."""
    lock, successor = MemoryLock(), MemorySuccessor()
    term = Term(Stop(), lock, successor)
    lock.lost = True
    assert not term.wait(0.3)
    assert term.over
    assert successor.may_read
    lock.lost = False
    assert not term.wait(20)
    assert not term.over
    lock.lost = True
    assert not term.wait(19), 'it is waited for anew'
    assert term.wait(2)


def test_a_stop_reads_on_for_its_successor_however_long_kafka_takes_to_tell(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = MemoryLock(wanted=True)

    def tell_late() -> bool:
        clock.sleep(4.9)
        return True

    monkeypatch.setattr(lock, 'has_standby', tell_late)
    stop = Stop()
    term = Term(stop, lock, MemorySuccessor())
    stop.ask()
    assert not term.look()
    left_s = clock.now_s
    assert term.wait(60)
    assert clock.now_s - left_s > 4.5


def test_a_term_that_is_over_is_no_end_until_the_bridge_stops() -> None:
    stop, lock = Stop(), MemoryLock()
    term = Term(stop, lock, MemorySuccessor(needed=False))
    lock.lost = True
    assert term.wait(60)
    assert not term.is_end
    stop.ask()
    assert term.is_end


def test_a_term_that_is_over_waits_for_its_successor_for_a_while_only(clock: Clock) -> None:
    lock = MemoryLock()
    term = Term(Stop(), lock, MemorySuccessor())
    lock.lost = True
    assert term.wait(60)
    assert 1020 <= clock.now_s < 1021


@pytest.mark.parametrize('stops', [False, True])
def test_a_successor_that_may_have_come_unseen_is_waited_for_as_one_that_has_come_last(
    clock: Clock, *, stops: bool
) -> None:
    """Not every publisher may send to it yet; a discovery server, for one, does not show it."""
    stop, lock = Stop(), MemoryLock(wanted=True)
    term = Term(stop, lock, MemorySuccessor())
    lock.lost = not stops
    if stops:
        stop.ask()
    assert not term.wait(13.0)
    assert term.wait(60)
    assert clock.now_s < 1021


def test_a_second_stop_ends_a_term_that_is_over_and_runs_on(clock: Clock) -> None:
    stop, lock = Stop(), MemoryLock()
    term = Term(stop, lock, MemorySuccessor())
    lock.lost = True
    assert not term.wait(0.3)
    stop.ask()
    assert not term.look()
    stop.ask()
    assert term.look()
    assert clock.now_s < 1001


def test_a_wait_in_a_term_ends_in_time_and_listens_meanwhile(clock: Clock) -> None:
    lock = MemoryLock()
    assert not Term(Stop(), lock, MemorySuccessor()).wait(0.3)
    assert clock.now_s == pytest.approx(1000.3)
    assert lock.polls >= 3


def test_a_drain_listens_too(clock: Clock) -> None:
    lock = MemoryLock()
    term = Term(Stop(), lock, MemorySuccessor())
    for _ in range(300):
        assert not term.look()
        clock.sleep(0.001)
    assert 3 <= lock.polls <= 4, 'and the hot loop pays nothing for it'


def test_a_stop_runs_on_until_the_successor_reads_and_is_known(clock: Clock) -> None:
    stop, lock, successor = Stop(), MemoryLock(wanted=True), MemorySuccessor()
    term = Term(stop, lock, successor)
    stop.ask()
    assert not term.look()
    assert not lock.held, 'it goes to the successor first'
    assert not term.wait(0.3)
    successor.come = True
    assert not term.wait(3.0), 'not every publisher sends to it yet'
    assert term.wait(60)
    assert clock.now_s < 1004
    assert not term.over


@pytest.mark.parametrize('missing', ['wanted', 'needed'])
def test_a_stop_waits_for_no_successor_where_none_is_there_or_needed(missing: str) -> None:
    stop, lock = Stop(), MemoryLock(wanted=missing != 'wanted')
    stop.ask()
    assert Term(stop, lock, MemorySuccessor(needed=missing != 'needed')).look()
    assert lock.held


def test_a_term_that_is_over_runs_on_for_nobody_where_no_message_would_be_lost() -> None:
    """As where all publishers are TRANSIENT_LOCAL: the other one gets their history."""
    lock, successor = MemoryLock(), MemorySuccessor(needed=False)
    term = Term(Stop(), lock, successor)
    lock.lost = successor.come = True
    assert term.look()


def test_a_stop_waits_for_its_successor_for_a_while_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.turns.term._COMING_S', 0.2)
    stop = Stop()
    stop.ask()
    assert Term(stop, MemoryLock(wanted=True), MemorySuccessor()).wait(60)


def test_a_second_stop_waits_for_nobody() -> None:
    stop = Stop()
    term = Term(stop, MemoryLock(wanted=True), MemorySuccessor())
    stop.ask()
    assert not term.look()
    stop.ask()
    assert term.look()
    assert term.at_once


def test_a_question_does_not_act() -> None:
    """Only who looks or listens polls the lock, leaves it, and asks for the successor."""
    stop, lock, successor = Stop(), MemoryLock(wanted=True), MemorySuccessor()
    stop.ask()
    term, standby = Term(stop, lock, successor), Standby(stop, lock)
    for _ in range(3):
        assert (term.asked, term.at_once, term.is_end, term.over) == (False, False, True, False)
        assert (standby.asked, standby.at_once, standby.is_end) == (True, False, True)
    assert lock.polls == 0
    assert not lock.left
    assert successor.may_read is None


def test_who_listens_learns_that_the_lock_was_lost_and_leaves_none(clock: Clock) -> None:
    stop, lock = Stop(), MemoryLock(wanted=True)
    term = Term(stop, lock, MemorySuccessor())
    stop.ask()
    term.listen()
    assert not lock.left
    assert not term.over
    lock.lost = True
    clock.sleep(0.2)
    term.listen()
    assert term.over
    assert not term.asked


def test_what_a_bridge_does_while_it_stands_by_ends_with_its_turn_or_the_bridge(
    clock: Clock,
) -> None:
    stop, lock = Stop(), MemoryLock()
    lock.held, lock.lost = False, True
    standby = Standby(stop, lock)
    for _ in range(300):
        assert not standby.look()
        clock.sleep(0.001)
    assert 3 <= lock.polls <= 4, 'as often as in a term'
    assert not standby.wait(1.0)
    lock.lost = False
    assert standby.wait(1.0)
    assert standby.is_end
    lock.lost = True
    clock.sleep(0.2)
    assert not standby.look()
    stop.ask()
    assert standby.look()
    assert not standby.at_once
    stop.ask()
    assert standby.at_once
