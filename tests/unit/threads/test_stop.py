"""Who waits for a stop hears of it at once, and of nothing else as one."""

import threading
import time
from collections.abc import Callable

import pytest
from fake_waits import let_waits_pass
from turning import Nobody

from ros2_kafka_bridge.threads.stop import Part, Stop
from ros2_kafka_bridge.threads.wakeup import Wakeup
from ros2_kafka_bridge.turns.term import Standby, Term


class LostLater:
    """A lock that is another's from some poll on."""

    def __init__(self, polls: int) -> None:
        self.held = True
        self.polls = 0
        self._last = polls

    def poll(self, timeout_s: float) -> None:
        assert timeout_s == 0.0
        self.polls += 1
        self.held = self.polls < self._last

    def has_standby(self) -> bool:
        return False

    def close(self) -> None:
        self.held = False


def took_s(act: Callable[[], object]) -> float:
    began_s = time.monotonic()
    act()
    return time.monotonic() - began_s


def after(seconds: float, act: Callable[[], object]) -> threading.Timer:
    timer = threading.Timer(seconds, act)
    timer.start()
    return timer


@pytest.mark.parametrize('own', [False, True])
def test_the_wait_of_a_route_ends_at_once_with_its_own_stop_or_that_of_all(*, own: bool) -> None:
    whole = Stop()
    parts = Part(whole), Part(whole)
    asked = parts[1] if own else whole
    assert not parts[1].wait(0.01)
    late = after(0.1, asked.ask)
    assert took_s(lambda: parts[1].wait(10)) < 5
    late.join()
    assert parts[1].asked
    assert parts[0].wait(0.01) is not own


def test_a_ring_for_anything_else_does_not_end_the_wait_for_a_stop() -> None:
    part = Part(Stop())
    part.wakeup.ring()
    late = after(0.05, part.wakeup.ring)
    assert took_s(lambda: part.wait(0.3)) >= 0.3
    assert not part.asked
    late.join()


def test_a_ring_is_forgotten_while_the_wait_for_a_stop_goes_on() -> None:
    """Else it would not wait, but loop."""
    stop = Stop()
    stop.wakeup.ring()
    began_s = time.thread_time()
    assert not stop.wait(0.3)
    assert time.thread_time() - began_s < 0.1


def test_any_ring_ends_a_wait_for_any() -> None:
    stop = Stop()
    late = after(0.1, stop.wakeup.ring)
    assert took_s(lambda: stop.wait_for_any(10)) < 5
    late.join()
    assert not stop.asked
    assert took_s(lambda: stop.wait_for_any(0.1)) >= 0.1, 'it was forgotten'
    stop.ask()
    assert took_s(lambda: stop.wait_for_any(10)) < 5


def test_two_threads_that_wait_for_the_same_stop_both_end() -> None:
    stop = Stop()
    ended: list[bool] = []
    threads = [threading.Thread(target=lambda: ended.append(stop.wait(10))) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(0.1)
    stop.ask()
    for thread in threads:
        thread.join(5)
    assert ended == [True, True]


def test_a_stop_that_comes_while_another_ring_is_forgotten_is_not_forgotten() -> None:
    class Asked(Wakeup):
        def clear(self) -> None:
            stop.ask()
            super().clear()

    stop = Stop(Asked())
    stop.wakeup.ring()
    stop.wait_for_any(10)
    assert stop.wakeup.wait(0.0), 'another thread waits for it'


def test_what_ends_by_a_lock_is_looked_at_each_tenth_of_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 1000.0

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += max(seconds, 1e-6)

    monkeypatch.setattr('time.monotonic', lambda: now_s)
    let_waits_pass(monkeypatch, sleep)
    term = Term(Part(Stop()), lock := LostLater(6), Nobody())
    assert term.wait(60)
    assert now_s == pytest.approx(1000.5, abs=0.01)
    assert lock.polls == 6
    lock = LostLater(99)
    lock.held = False
    assert Standby(Part(Stop()), lock).wait(60)
    assert now_s == pytest.approx(1000.5, abs=0.01)


def test_a_stop_of_all_ends_the_wait_of_a_route_that_runs_in_turn() -> None:
    whole = Stop()
    term = Term(Part(whole), LostLater(999), Nobody())
    late = after(0.1, whole.ask)
    assert took_s(lambda: term.wait(10)) < 5
    late.join()
    assert term.asked
