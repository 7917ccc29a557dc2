"""What waits to be published, what holds it back, and what the readers of a route have got."""

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.endpoints import MessageSink
from ros2_kafka_bridge.route import clock
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.obstacle import HISTORY_FULL, PACED, Cause, Obstacle
from ros2_kafka_bridge.route.pace import Pace
from ros2_kafka_bridge.route.place import SENT
from ros2_kafka_bridge.route.record_window import RecordWindow
from ros2_kafka_bridge.route.settling import Settling


class Publishing:
    """Publishes the entries that wait, in their order, once readers are there to take them.

    Args:
        window: Where the entries wait.
        sink: The publisher.
        route: How many readers are waited for, how fast they take, and what is too old.
    """

    def __init__(self, window: RecordWindow, sink: MessageSink, route: KafkaToRosRoute) -> None:
        self._window = window
        self._sink = sink
        publishes = route.when_misread == 'publish'
        self._settling = Settling(route.min_subscribers, may_misread=publishes)
        self._paces = route.max_rate is not None
        self._pace = Pace(route.max_rate)
        self._ages = route.max_age_s is not None

    @property
    def paced_s(self) -> float:
        """How long the next message waits for `max_rate`."""
        return self._pace.wait_s

    def publish_pending(self) -> Obstacle | None:
        """Publish what waits; tells what stands in the way, None when nothing is left."""
        if self._ages and (problem := clock.problem()):
            return Obstacle(f'max_age_s: {problem}', Cause.CLOCK)
        pending, unconfirmed = self._window.pending, self._window.unconfirmed
        if pending and (obstacle := self._settling.obstacle):
            return obstacle
        publish, sent = self._sink.publish, SENT
        while pending:
            entry = pending[0]
            if self._ages and clock.since_boot_s() > entry.expires_s:
                entry.outcome = Outcome.DROPPED
            elif self._paces and not self._pace.go():
                return PACED
            elif not publish(entry.cdr):
                return HISTORY_FULL
            else:
                entry.place = sent
                unconfirmed.append(entry)
            pending.popleft()
        return None

    def confirm(self) -> int:
        """End what all readers have got.

        Returns:
            How many wait again, for a reader has gone that had not acknowledged them.
        """
        readers = self._sink.readers()
        self._settling.look(readers)
        again = self._window.take_back() if readers.lost else 0
        outcome = Outcome.CONFIRMED if readers.acknowledged else Outcome.PUBLISHED
        self._window.confirm(readers.confirmed, outcome)
        return again
