"""What waits to be published, what holds it back, and what the readers of a route have got."""

import math
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.endpoints import MessageWriter
from ros2_kafka_bridge.route import clock
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.flight import Lane
from ros2_kafka_bridge.route.flight.records import RecordEntry, RecordFlight
from ros2_kafka_bridge.route.flight.stage import SENT
from ros2_kafka_bridge.route.obstacle import HISTORY_FULL, PACED, WINDOW_FULL, Cause, Obstacle
from ros2_kafka_bridge.route.readiness import SubscriberReadiness

_EXPIRED: Final = Obstacle('the first that waits is too old')
_ACKNOWLEDGED_BY_S: Final = 0.2
"""What readers that keep up have got is confirmed by then."""


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


class Publishing:
    """Publishes the entries that wait, in their order, once readers are there to take them.

    Args:
        flight: Where the entries are.
        writer: Where they are published.
        route: How many readers are waited for, how fast they take, and what is too old.
    """

    def __init__(
        self, flight: RecordFlight, writer: MessageWriter, route: KafkaToRosRoute
    ) -> None:
        self._unconfirmed: deque[RecordEntry] = deque()  # in the order of publishing
        self._flight = flight
        self._writer = writer
        publishes = route.when_misread == 'publish'
        self._readiness = SubscriberReadiness(route.min_subscribers, may_misread=publishes)
        self._paces = route.max_rate is not None
        self._pace = Pace(route.max_rate)
        self._ages = route.max_age_s is not None
        self._confirmed = 0  # of those published since a reader was lost last

    @property
    def paced_s(self) -> float:
        """How long the next message waits for `max_rate`."""
        return self._pace.wait_s

    def publish_ready(self) -> tuple[Obstacle | None, Sequence[RecordEntry]]:
        """Publish what waits.

        Returns:
            What stands in the way, None when nothing is left; and what was published.
        """
        if self._ages and (problem := clock.problem()):
            return Obstacle(f'max_age_s: {problem}', Cause.CLOCK), ()
        lane = self._flight.lane
        if lane.ready and (obstacle := self._readiness.obstacle):
            return obstacle, ()
        published: list[RecordEntry] = []
        while (obstacle := self._publish(lane, published)) is _EXPIRED:
            self._flight.end([self._flight.hold_first(lane)], Outcome.DROPPED)
        return obstacle, published

    def _publish(self, lane: Lane[RecordEntry], published: list[RecordEntry]) -> Obstacle | None:
        if not lane.ready:
            return None
        held_by: list[Obstacle] = []
        room_bytes = self._room_bytes
        if self._ages or self._paces or room_bytes < math.inf:
            going = self._going(lane.ready, room_bytes, held_by)
        else:
            going = (entry.cdr for entry in lane.ready)
        sent = self._flight.sent(lane, self._writer.publish(going))
        if self._flight.drops:
            now_s = time.monotonic()
            for entry in sent:
                entry.published_s = now_s
        self._unconfirmed += sent
        published += sent
        if not lane.ready:
            return None
        if held_by:
            return held_by[0]
        self._writer.raise_failure()
        return HISTORY_FULL

    @property
    def _room_bytes(self) -> float:
        """How large what is published may be, where reading goes on though the window is full."""
        flight = self._flight
        if not (flight.drops and flight.fills_window):
            return math.inf
        return flight.max_bytes - sum(entry.size_bytes for entry in self._unconfirmed)

    def _going(
        self, ready: Iterable[RecordEntry], room_bytes: float, held_by: list[Obstacle]
    ) -> Iterator[bytes]:
        """What may be published now; `held_by` is told what holds back the next one."""
        for entry in ready:
            if room_bytes <= 0:
                held_by.append(WINDOW_FULL)
                return
            if self._ages and clock.since_boot_s() > entry.expires_s:
                held_by.append(_EXPIRED)
                return
            if self._paces and not self._pace.go():
                held_by.append(PACED)
                return
            room_bytes -= entry.size_bytes
            yield entry.cdr

    def lets_drop(self, obstacle: Obstacle) -> bool:
        """Whether what waits may be dropped: readers do not take, or cannot."""
        if obstacle.cause in {Cause.PACE, Cause.CLOCK}:
            return False
        if not self._unconfirmed:
            return True
        return time.monotonic() - self._unconfirmed[0].published_s > _ACKNOWLEDGED_BY_S

    def confirm(self) -> int:
        """End what all readers have got.

        Returns:
            How many wait again, for a reader has gone that had not acknowledged them.
        """
        readers = self._writer.readers()
        self._readiness.look(readers)
        again = self._publish_again() if readers.lost else 0
        take = self._unconfirmed.popleft
        confirmed = [take() for _ in range(readers.confirmed - self._confirmed)]
        self._confirmed = readers.confirmed
        if confirmed:
            outcome = Outcome.CONFIRMED if readers.acknowledged else Outcome.PUBLISHED
            self._flight.confirm(confirmed, outcome)
        return again

    def _publish_again(self) -> int:
        again = [entry for entry in self._unconfirmed if entry.stage is SENT]
        self._unconfirmed.clear()
        self._confirmed = 0
        self._flight.requeue(again)
        return len(again)
