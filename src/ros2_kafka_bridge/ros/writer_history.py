"""How far the messages in the history of a writer have come: published, acknowledged, confirmed.

A KEEP_ALL history of `room` samples cannot overwrite: when message k was accepted, message
k - room is acknowledged by every matched reader. At a pause, all are when the middleware says so.
Where it bounds no history there would be no pause while messages flow: then no more than `room`
are published until all are acknowledged.

Acknowledged counts as confirmed only after it has aged with no reader going away: a reader that
dies is forgotten by the history a moment before it is reported as gone, and then everything looks
acknowledged.
"""

import math
from collections.abc import Callable

from ros2_kafka_bridge.endpoints import Load

_AGE_S = 0.05


class WriterHistory:
    """Counts the messages of a writer since a reader of it was lost last.

    Args:
        room: Samples of the writer's history.
        asks: Whether to ask the middleware what has arrived; else all has that was published.
        bounded: Whether the history refuses what is beyond its room.
    """

    def __init__(self, room: int, *, asks: bool, bounded: bool) -> None:
        self.published = 0
        self.acknowledged = 0
        self.confirmed = 0
        self.is_acknowledged = False  # whether a reader has acknowledged what is confirmed
        self.most = room if asks and not bounded else math.inf  # that may be under way
        self._room = room
        self._asks = asks
        self._bounded = bounded
        self._will_be_acknowledged = self._had_reader = False
        self._look_at_s = 0.0

    @property
    def load(self) -> Load:
        """What the history holds, as far as its readers have told."""
        limit = self._room if self._asks or self._bounded else None
        held = self.published - self.acknowledged
        return Load(held if limit is None else min(held, limit), limit)

    def begin_again(self, *, has_reader: bool) -> None:
        """Count from here: a reader has gone, and nobody knows what it had.

        Args:
            has_reader: As of `look`.
        """
        self.published = self.confirmed = self.acknowledged = 0
        self.is_acknowledged = self._will_be_acknowledged = False
        self._had_reader = has_reader

    def look(
        self, now_s: float, all_acknowledged: Callable[[], bool], *, has_reader: bool
    ) -> None:
        """Confirm what has aged, if it is time for that, and see what is acknowledged by now.

        Args:
            now_s: By the monotonic clock.
            all_acknowledged: Asks the middleware.
            has_reader: Whether somebody is there who acknowledges.
        """
        if now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _AGE_S
        self.confirmed, self.is_acknowledged = self.acknowledged, self._will_be_acknowledged
        if not self._asks or all_acknowledged():
            self.acknowledged = self.published
        elif self._bounded:
            self.acknowledged = max(self.acknowledged, self.published - self._room)
        # What was published since the last look went to who was there by then.
        self._will_be_acknowledged = self._asks and self._had_reader and has_reader
        self._had_reader = has_reader
