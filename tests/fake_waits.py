"""Waits for a wakeup where time passes only when a test lets it."""

from collections.abc import Callable

import pytest

from ros2_kafka_bridge.threads.wakeup import Wakeup


def let_waits_pass(patch: pytest.MonkeyPatch, sleep: Callable[[float], None]) -> None:
    """Let a wait that nobody has ended before be a sleep of that clock."""

    def wait(wakeup: Wakeup, timeout_s: float) -> bool:
        if not wakeup.is_rung:
            sleep(timeout_s)
        return wakeup.is_rung

    patch.setattr(Wakeup, 'wait', wait)
