"""When a record may be published: not faster than its readers take, not when it is too old."""

import time
from collections.abc import Callable

_NO_TIMESTAMP = 0


class Pace:
    """At most so many messages per second, evenly.

    Args:
        max_rate: Messages per second; None lets every one go.
    """

    def __init__(self, max_rate: float | None) -> None:
        self._interval_s = 0.0 if max_rate is None else 1 / max_rate
        self._next_s = 0.0

    @property
    def wait_s(self) -> float:
        """How long until the next message may go."""
        return max(0.0, self._next_s - time.monotonic())

    def go(self) -> bool:
        """Tell whether a message may go now; one that may is counted."""
        if not self._interval_s:
            return True
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = max(self._next_s, now_s - self._interval_s) + self._interval_s
        return True


def expires(max_age_s: float | None) -> Callable[[tuple[int, int]], bool]:
    """Make the question whether a record of this timestamp is too old; with None none is."""
    if max_age_s is None:
        return lambda _: False
    limit_ms = max_age_s * 1000

    def expired(timestamp: tuple[int, int]) -> bool:
        kind, created_ms = timestamp
        return kind != _NO_TIMESTAMP and time.time() * 1000 - created_ms > limit_ms

    return expired
