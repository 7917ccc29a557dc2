"""Whether enough readers know of their match, and none would misread what it gets.

A writer knows of a match before the reader does, and what it publishes meanwhile is lost to that
reader. So a reader counts once it has been there for a while; the while begins with its match,
not with the first message that waits for it.
"""

import time
from collections import deque
from typing import Final

from ros2_kafka_bridge.endpoints import Readers
from ros2_kafka_bridge.route.obstacle import Obstacle

SETTLE_S: Final = 1.0
# Fast DDS tells a reader of another vendor of the writer with the next heartbeat of its discovery,
# which comes once a second: 1.1 s after the match at most, and a second more for each packet lost.
FOREIGN_SETTLE_S: Final = 3.0
_JUST_COME: Final = Obstacle('a subscriber has come just now, and may not know of the bridge yet')


class SubscriberReadiness:
    """Follows the readers of one topic.

    Args:
        needed: How many must know of their match; with 0 nobody is waited for.
        may_misread: Whether those who misread what they get are no obstacle.
    """

    def __init__(self, needed: int, *, may_misread: bool = False) -> None:
        self._needed = needed
        self._may_misread = may_misread
        self._come = 0
        self._misread = ''
        self._settle_s = SETTLE_S
        self._came_s: deque[float] = deque()  # when those that are there came, the oldest first
        self._last_at_loss_s = 0.0  # when the last of those came that outlived one that went

    def look(self, readers: Readers) -> None:
        """Note who has come and gone; as often as possible, for it counts from here."""
        new = max(readers.come - self._come, readers.matched - len(self._came_s))
        self._come = readers.come
        self._misread = readers.misread
        self._settle_s = FOREIGN_SETTLE_S if readers.foreign else SETTLE_S
        self._came_s.extend([time.monotonic()] * min(new, readers.matched))
        # Which one has gone is not told. The one that came last may be the one that stays.
        while len(self._came_s) > readers.matched:
            self._came_s.popleft()
        if readers.lost and self._came_s:
            # What is published again is for the one that came in its place, too.
            self._last_at_loss_s = self._came_s[-1]

    @property
    def obstacle(self) -> Obstacle | None:
        """What there is to wait for; None where enough readers know of their match."""
        if self._misread and not self._may_misread:
            return Obstacle(self._misread)
        there = len(self._came_s)
        if there < self._needed:
            return Obstacle(f'{there} of {self._needed} subscribers are there')
        if self._needed:
            came_s = max(self._came_s[self._needed - 1], self._last_at_loss_s)
            if time.monotonic() < came_s + self._settle_s:
                return _JUST_COME
        return None
