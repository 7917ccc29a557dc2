"""Who waits for a stop hears of it at once, and of nothing else as one."""

import threading
import time
from collections.abc import Callable

import pytest

from ros2_kafka_bridge.threads.stop import Part, Stop
from ros2_kafka_bridge.threads.wakeup import Wakeup


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


def test_a_stop_without_a_limit_is_no_first_step_to_an_end_at_once() -> None:
    """As where a bridge hands over: who stops it then still waits for its drain."""
    whole = Stop()
    part = Part(whole)
    for _ in range(2):
        part.ask(limited=False)
        assert (part.asked, part.is_limited, part.at_once) == (True, False, False)
    part.ask()
    assert (part.is_limited, part.at_once) == (True, False)
    part.ask(limited=False)
    assert not part.at_once
    part.ask()
    assert part.at_once


def test_a_drain_without_a_limit_gets_one_with_the_stop_of_all() -> None:
    whole = Stop()
    part = Part(whole)
    part.ask(limited=False)
    whole.ask()
    assert (part.is_limited, part.at_once) == (True, False)
    whole.ask()
    assert part.at_once
