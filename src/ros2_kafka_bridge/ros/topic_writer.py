"""Publishing to one topic of ROS, and knowing what has arrived."""

import time
from collections.abc import Iterable, Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import Load, Matches, Readers
from ros2_kafka_bridge.ros.errors import translate, translated
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.subscribers import Subscribers
from ros2_kafka_bridge.ros.topic_end import OwnPublisher, TopicEnd
from ros2_kafka_bridge.ros.writer_history import WriterHistory

_MOST_FAULTS: Final = 2  # a single look that fails costs no history


class TopicWriter:
    """Publishes on one topic.

    Args:
        end: What the route has at the topic.
        history: Counts what its readers have got.
    """

    def __init__(self, end: TopicEnd, history: WriterHistory) -> None:
        self._end = end
        self._history = history
        self._subscribers = Subscribers(end)
        self._publisher: OwnPublisher | None = None
        self._matched = 0  # readers that are there
        self._come = 0  # readers that have come, also to publishers that were replaced
        self._come_before = 0  # to publishers that this one has replaced
        self._is_replaced = False  # since the last look
        self._faults = 0
        self._failure: Exception | None = None  # told behind what was published before it

    @property
    def load(self) -> Load:
        """What its history holds, as far as its readers have told."""
        return self._history.load

    @property
    def matches(self) -> Matches:
        """Its subscribers at the last look."""
        return Matches(self._matched, self._subscribers.mismatched)

    @property
    def reliable_subscribers(self) -> Sequence[str]:
        """Names of the nodes whose acknowledgements it waits for, as far as the graph knows."""
        return self._subscribers.reliable

    def open(self) -> None:
        """Make the publisher.

        Raises:
            RouteError: ROS refuses it, for example for another type on the same topic.
        """
        self._subscribers.open()
        self._advertise()

    def close(self) -> None:
        """Destroy the publisher."""
        self._subscribers.close()
        self._withdraw()

    def _advertise(self) -> None:
        self._publisher = self._end.advertise(profile(self._end.qos))

    def _withdraw(self) -> None:
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            self._end.withdraw(publisher)

    def publish(self, messages: Iterable[bytes]) -> int:
        """Publish in this order, as far as there is room; returns how many were taken.

        There is none where the history is full, where there is no publisher, which the next look
        at the readers makes, and where ROS fails: `raise_failure` tells.
        """
        publisher, history = self._publisher, self._history
        if publisher is None:
            return 0
        count, room = 0, history.most - (history.published - history.acknowledged)
        # Held once for all: rclpy's own `publish` does so for each, and asks what it was given.
        handle = publisher.handle.handle
        try:
            with handle:
                publish = handle.publish_raw
                for cdr in messages:
                    if count >= room:
                        break
                    publish(cdr)
                    count += 1
        except Exception as error:  # noqa: BLE001 (raised by `raise_failure`)
            if 'cannot publish data' not in str(error):  # a full history has no class of its own
                self._failure = error
        history.published += count
        return count

    def raise_failure(self) -> None:
        """Tell what has failed in the last publish.

        Raises:
            RouteError: ROS has failed. Another publisher takes the place of this one.
        """
        failure, self._failure = self._failure, None
        if failure is not None:
            self._faults = _MOST_FAULTS
            with translated(self._where):
                raise failure

    def readers(self) -> Readers:
        """Look at the readers.

        Raises:
            RouteError: ROS has failed. Where it fails again, another publisher takes the place of
                this one.
        """
        if self._faults >= _MOST_FAULTS:
            self._open_anew()
        try:
            lost = self._look()
        except Exception as error:  # not `translated`, which costs a microsecond
            self._faults += 1
            if known := translate(error, self._where):
                raise known from error
            raise
        self._faults = 0
        history, subscribers = self._history, self._subscribers
        return Readers(
            self._matched,
            self._come,
            lost,
            history.confirmed,
            history.is_acknowledged,
            subscribers.misread,
            self._matched > subscribers.alike,
        )

    @property
    def _where(self) -> str:
        return f'publisher of {self._end.topic}'

    def _look(self) -> bool:
        """Look at who is there and at what they have; tells whether one has gone."""
        now_s, publisher = time.monotonic(), self._publisher
        assert publisher is not None, 'it is open'
        matched, come_here = publisher.events.look()
        come = self._come_before + come_here
        has_changed = matched != self._matched or come != self._come
        self._subscribers.look(come, ask=has_changed)
        has_reader = bool(self._subscribers.reliable)
        # One that nobody has heard of may have come to the publisher that was replaced.
        lost = self._is_replaced or come - matched != self._come - self._matched
        self._matched, self._come, self._is_replaced = matched, come, False
        if lost:
            self._history.begin_again(has_reader=has_reader)
        else:
            self._history.look(now_s, publisher.all_acknowledged, has_reader=has_reader)
        return lost

    def _open_anew(self) -> None:
        """Put another publisher in the place of one that has failed.

        Its readers have to come again: what the old one had published counts for nothing.
        """
        self._withdraw()
        self._come_before = self._come
        self._advertise()
        self._is_replaced, self._faults = True, 0
