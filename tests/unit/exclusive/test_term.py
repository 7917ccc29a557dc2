"""What runs a route by a lock ends when the bridge does, or when the lock is lost: not earlier."""

import pytest
from support.worlds.clocks import Clock

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.exclusive.handover_window import MOST_AT_END_S, MOST_S
from ros2_kafka_bridge.exclusive.term import Term
from ros2_kafka_bridge.threads.stop import Stop


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


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.handover_window.time', clock)
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.term.time', clock)
    return clock


class Leader:
    """Takes the steps of a term, ten in a second."""

    def __init__(self, term: Term, clock: Clock) -> None:
        self.term = term
        self.clock = clock
        self.is_over = False

    def lasts(self, seconds: float) -> bool:
        """Take the steps of so many seconds; tells whether the term has lasted so long."""
        until_s = self.clock.now_s + seconds
        while not self.step() and self.clock.now_s < until_s:
            self.clock.sleep(0.1)
        return not self.is_over

    def step(self) -> bool:
        """Take one; tells whether the route is to drain."""
        self.is_over = self.term.step(takes=False)
        return self.is_over


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


def test_a_term_ends_with_the_bridge(clock: Clock) -> None:
    stop = Stop()
    leader = Leader(Term(stop, MemoryLock(), MemorySuccessor()), clock)
    assert leader.lasts(60)
    stop.ask()
    assert leader.step()
    assert not leader.term.is_lost


def test_a_term_is_over_once_its_lock_was_lost_also_if_it_comes_back(clock: Clock) -> None:
    lock = MemoryLock()
    leader = Leader(Term(Stop(), lock, MemorySuccessor(needed=False)), clock)
    lock.lost = True
    assert leader.step()
    lock.lost = False
    assert leader.step()
    assert leader.term.is_lost


def test_guarantee_8_a_term_that_is_over_runs_on_until_the_successor_reads_and_is_known(
    clock: Clock,
) -> None:
    """As where Kafka gives the route to another, though this bridge lives and takes."""
    lock, successor = MemoryLock(), MemorySuccessor()
    leader = Leader(Term(Stop(), lock, successor), clock)
    assert leader.lasts(0.3)
    lock.lost = True
    assert leader.lasts(0.3), 'the other one has not subscribed yet'
    assert leader.term.is_lost
    polls = lock.polls
    successor.come = True
    assert leader.lasts(3.0), 'not every publisher sends to it yet'
    assert lock.polls > polls + 10, 'a client that nobody polls is put out of its group'
    assert not leader.lasts(60)


def test_a_lock_that_comes_back_before_the_drain_has_begun_lets_the_term_go_on(
    clock: Clock,
) -> None:
    """As where the other bridge has died meanwhile: nobody else reads."""
    lock, successor = MemoryLock(), MemorySuccessor()
    leader = Leader(Term(Stop(), lock, successor), clock)
    lock.lost = True
    assert leader.lasts(0.3)
    assert leader.term.is_lost
    assert successor.may_read
    lock.lost = False
    assert leader.lasts(20)
    assert not leader.term.is_lost
    lock.lost = True
    assert leader.lasts(19), 'it is waited for anew'
    assert not leader.lasts(2)


def test_a_stop_reads_on_for_its_successor_however_long_kafka_takes_to_tell(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = MemoryLock(wanted=True)

    def tell_late() -> bool:
        clock.sleep(4.9)
        return True

    monkeypatch.setattr(lock, 'has_standby', tell_late)
    stop = Stop()
    leader = Leader(Term(stop, lock, MemorySuccessor()), clock)
    stop.ask()
    assert not leader.step()
    left_s = clock.now_s
    assert not leader.lasts(60)
    assert clock.now_s - left_s > 4.5


def test_a_term_that_is_over_waits_for_its_successor_for_a_while_only(clock: Clock) -> None:
    lock = MemoryLock()
    leader = Leader(Term(Stop(), lock, MemorySuccessor()), clock)
    lock.lost = True
    assert not leader.lasts(60)
    assert 1020 <= clock.now_s < 1021


@pytest.mark.parametrize('stops', [False, True])
def test_a_successor_that_may_have_come_unseen_is_waited_for_as_one_that_has_come_last(
    clock: Clock, *, stops: bool
) -> None:
    """Not every publisher may send to it yet; a discovery server, for one, does not show it."""
    stop, lock = Stop(), MemoryLock(wanted=True)
    leader = Leader(Term(stop, lock, MemorySuccessor()), clock)
    lock.lost = not stops
    if stops:
        stop.ask()
    assert leader.lasts(13.0)
    assert not leader.lasts(60)
    assert clock.now_s < 1021


def test_a_second_stop_ends_a_term_that_is_over_and_runs_on(clock: Clock) -> None:
    stop, lock = Stop(), MemoryLock()
    leader = Leader(Term(stop, lock, MemorySuccessor()), clock)
    lock.lost = True
    assert leader.lasts(0.3)
    stop.ask()
    assert not leader.step()
    stop.ask()
    assert leader.step()


def test_a_stop_runs_on_until_the_successor_reads_and_is_known(clock: Clock) -> None:
    stop, lock, successor = Stop(), MemoryLock(wanted=True), MemorySuccessor()
    leader = Leader(Term(stop, lock, successor), clock)
    stop.ask()
    assert not leader.step()
    assert lock.left, 'it goes to the successor first'
    assert leader.lasts(0.3)
    successor.come = True
    assert leader.lasts(3.0), 'not every publisher sends to it yet'
    assert not leader.lasts(60)
    assert clock.now_s < 1004
    assert not leader.term.is_lost


@pytest.mark.parametrize('missing', ['wanted', 'needed'])
def test_a_stop_waits_for_no_successor_where_none_is_there_or_needed(
    clock: Clock, missing: str
) -> None:
    stop, lock = Stop(), MemoryLock(wanted=missing != 'wanted')
    stop.ask()
    term = Term(stop, lock, MemorySuccessor(needed=missing != 'needed'))
    assert Leader(term, clock).step()
    assert lock.held


def test_a_term_that_is_over_runs_on_for_nobody_where_no_message_would_be_lost(
    clock: Clock,
) -> None:
    """As where all publishers are TRANSIENT_LOCAL: the other one gets their history."""
    lock, successor = MemoryLock(), MemorySuccessor(needed=False)
    lock.lost = successor.come = True
    assert Leader(Term(Stop(), lock, successor), clock).step()


def test_a_second_stop_waits_for_nobody(clock: Clock) -> None:
    stop = Stop()
    leader = Leader(Term(stop, MemoryLock(wanted=True), MemorySuccessor()), clock)
    stop.ask()
    assert not leader.step()
    stop.ask()
    assert leader.step()


def test_a_route_that_waits_for_long_is_woken_while_its_successor_reads(clock: Clock) -> None:
    """It tells what it has taken after each wait only, and these can be long."""
    stop, lock, successor = Stop(), MemoryLock(), MemorySuccessor()
    leader = Leader(Term(stop, lock, successor), clock)
    leader.step()
    assert not stop.wakeup.is_rung
    lock.lost = successor.come = True
    for _ in range(3):
        leader.step()
        assert stop.wakeup.is_rung
        stop.wakeup.clear()


@pytest.mark.parametrize('newer', ['none', 'one', 'all'])
def test_what_each_publisher_sent_before_the_successor_was_known_is_taken_first(
    clock: Clock, newer: str
) -> None:
    lock, successor = MemoryLock(), MemorySuccessor()
    term = Term(Stop(), lock, successor)
    lock.lost = successor.come = True
    assert not term.step(takes=True)
    old, new = clock.time_ns(), clock.time_ns() + 60_000_000_000
    first = Message(b'', b'first', 1, old if newer == 'none' else new)
    second = Message(b'', b'second', 1, new if newer == 'all' else old)
    is_over = False
    for _ in range(150):  # a quiet end comes after ten seconds
        clock.sleep(0.1)
        term.note_taken([first, second])
        is_over = term.step(takes=True)
    assert is_over is (newer == 'all')


@pytest.mark.parametrize('stops', [False, True])
def test_a_term_that_is_over_has_less_time_once_somebody_waits_for_its_end(
    clock: Clock, *, stops: bool
) -> None:
    stop, lock, successor = Stop(), MemoryLock(), MemorySuccessor()
    term = Term(stop, lock, successor)
    lock.lost = successor.come = True
    began_s, old = clock.now_s, [Message(b'', b'publisher', 1, clock.time_ns())]
    while not term.step(takes=True):
        clock.sleep(0.1)
        term.note_taken(old)
        if stops and not stop.asked:
            stop.ask()
    most_s = MOST_AT_END_S if stops else MOST_S
    assert clock.now_s - began_s == pytest.approx(most_s, abs=0.2)


def test_a_route_that_was_held_up_before_its_successor_read_is_waited_for(clock: Clock) -> None:
    lock, successor = MemoryLock(), MemorySuccessor()
    stop = Stop()
    term = Term(stop, lock, successor)
    term.note_taken([])
    clock.sleep(5.0)  # there is no room
    stop.ask()
    lock.lost = successor.come = True
    assert not term.step(takes=True)
    clock.sleep(0.5)
    term.note_taken([])
    began_s = clock.now_s
    while not term.step(takes=True):
        clock.sleep(0.1)
        term.note_taken([])
    assert clock.now_s - began_s == pytest.approx(3.5, abs=0.2)
