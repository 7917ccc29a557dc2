"""Whether enough readers know of their match.

A writer knows of a match before the reader does, and what it publishes meanwhile is lost to that
reader. So a reader counts once it has been there for a while; the while begins with its match,
not with the first message that waits for it.
"""

import time
from collections import deque
from typing import Final

from ros2_kafka_bridge.endpoints import Readers

SETTLE_S: Final = 1.0


class Settling:
    """Follows the readers of one topic.

    Args:
        needed: How many must know of their match; with 0 nobody is waited for.
    """

    def __init__(self, needed: int) -> None:
        self._needed = needed
        self._come = 0
        self._came_s: deque[float] = deque()  # when those that are there came, the oldest first

    def look(self, readers: Readers) -> None:
        """Note who has come and gone; as often as possible, for it counts from here."""
        new = min(readers.come - self._come, readers.matched)
        self._come = readers.come
        self._came_s.extend([time.monotonic()] * new)
        # Which one has gone is not told. The one that came last may be the one that stays.
        while len(self._came_s) > readers.matched:
            self._came_s.popleft()

    @property
    def obstacle(self) -> str | None:
        """What there is to wait for; None where enough readers know of their match."""
        there = len(self._came_s)
        if there < self._needed:
            return f'{there} of {self._needed} subscribers are there'
        if self._needed and time.monotonic() < self._came_s[self._needed - 1] + SETTLE_S:
            return 'a subscriber has come just now, and may not know of the bridge yet'
        return None
