"""What waits to be published, what holds it back, and what the readers of a route have got."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.endpoints import MessageWriter
from ros2_kafka_bridge.route import clock
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.flight import Lane
from ros2_kafka_bridge.route.flight.records import RecordEntry, RecordFlight
from ros2_kafka_bridge.route.flight.stage import SENT
from ros2_kafka_bridge.route.obstacle import HISTORY_FULL, PACED, Cause, Obstacle
from ros2_kafka_bridge.route.pace import Pace
from ros2_kafka_bridge.route.readiness import SubscriberReadiness

_EXPIRED: Final = Obstacle('the first that waits is too old')


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
        publish, ages, paces = self._writer.publish, self._ages, self._paces
        count = 0
        try:
            for entry in lane.ready:
                if ages and clock.since_boot_s() > entry.expires_s:
                    return _EXPIRED
                if paces and not self._pace.go():
                    return PACED
                if not publish(entry.cdr):
                    return HISTORY_FULL
                count += 1
        finally:
            sent = self._flight.sent(lane, count)
            self._unconfirmed += sent
            published += sent
        return None

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
