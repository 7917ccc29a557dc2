"""When a message may be published: not faster than its readers take."""

import time


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
