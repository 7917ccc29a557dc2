"""How long a route may take to finish what it has begun."""

import math
import time

from ros2_kafka_bridge.threads.stop import Stop


class DrainTime:
    """The time of a drain: `drain_s` from when it is limited, and nothing once a stop says so.

    Args:
        stop: Why the route drains.
        drain_s: How long it may.
    """

    def __init__(self, stop: Stop, drain_s: float) -> None:
        self.deadline_s = math.inf  # by the monotonic clock
        self._stop = stop
        self._drain_s = drain_s
        self._began_s = time.monotonic()

    def is_over(self, *, limited: bool = True) -> bool:
        """Look whether time is up; who drains asks in each round.

        Args:
            limited: Whether the time counts from now on, also where nobody waits for the end.
        """
        now_s = time.monotonic()
        if self.deadline_s == math.inf and (limited or self._stop.is_limited):
            self.deadline_s = now_s + self._drain_s
        return now_s >= self.deadline_s or self._stop.at_once

    def hands_over_for(self, longest_s: float) -> bool:
        """Whether the route goes on elsewhere, and has drained for so long."""
        return not self._stop.is_limited and time.monotonic() - self._began_s > longest_s
