"""Clocks that tests set, and waits where time passes only when a test lets it."""

from collections.abc import Callable

import pytest

from ros2_kafka_bridge.threads.wakeup import Wakeup


class Clock:
    """What a module takes for `time`: it goes on only when it is told to."""

    def __init__(self, now_s: float = 1000.0) -> None:
        self.now_s = now_s

    def monotonic(self) -> float:
        return self.now_s

    def time_ns(self) -> int:
        return round(self.now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


def let_waits_pass(patch: pytest.MonkeyPatch, sleep: Callable[[float], None]) -> None:
    """Let a wait that nobody has ended before be a sleep of that clock."""

    def wait(wakeup: Wakeup, timeout_s: float) -> bool:
        if not wakeup.is_rung:
            sleep(timeout_s)
        return wakeup.is_rung

    patch.setattr(Wakeup, 'wait', wait)
