"""Taking from ROS: the topics that a route reads."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import Matches, Message
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.topic_reader import TopicReader

_ALL_S: Final = 1.0

OnTake = Callable[[Sequence[Message]], None]


class RosSource:
    """A `MessageSource` of real topics, which are waited for together.

    Args:
        arrivals: Tells which of them have messages.
        readers: By their topics.
        on_take: Told of what each take has brought, also where that is nothing.
    """

    def __init__(
        self,
        arrivals: Arrivals,
        readers: Mapping[str, TopicReader],
        on_take: OnTake = lambda _: None,
    ) -> None:
        self._on_take = on_take
        self._arrivals = arrivals
        self._readers = readers
        self._left: Collection[str] = ()  # topics of which the last take has left something
        self._look_at_all_s = 0.0

    @property
    def lost_upstream(self) -> int:
        """Messages lost before the bridge could take them, by the gaps in their numbers."""
        return sum(reader.lost_upstream for reader in self._readers.values())

    @property
    def exhausted(self) -> bool:
        """Whether the last take has found nothing more to take."""
        return all(reader.exhausted for reader in self._readers.values())

    @property
    def matches(self) -> Matches:
        """Its publishers, as far as the graph knows."""
        return Matches.of_all(reader.matches for reader in self._readers.values())

    def open(self) -> None:
        """Subscribe to what is offered now, or with the default QoS while nothing is.

        Raises:
            RouteError: ROS refuses a subscription.
        """
        for reader in self._readers.values():
            reader.open()

    def look(self) -> None:
        """Follow the publishers that have changed, and take nothing.

        Raises:
            RouteError: ROS refuses a subscription, or to tell who publishes.
        """
        for reader in self._readers.values():
            reader.look()
        self._on_take(())

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Wait up to `timeout_s` for messages, then take at most `limit`.

        Raises:
            RouteError: ROS has failed; what was taken before that was returned.
        """
        topics = self._to_look_at(timeout_s)
        for topic in topics:
            self._readers[topic].look()
        self._raise_failure()
        messages = self._take(topics, limit)
        if not messages:
            self._raise_failure()
        self._on_take(messages)
        return messages

    def _to_look_at(self, timeout_s: float) -> Collection[str]:
        """Wait for topics that have something; all of them, where none has told of anything.

        Also all where there is no time to wait, as at the end, and each second: what is taken does
        not depend on what DDS tells.
        """
        ready = self._left
        if timeout_s > 0:
            ready = {*ready, *self._arrivals.wait(0.0 if ready else timeout_s)}
        now_s = time.monotonic()
        if ready and timeout_s > 0 and now_s < self._look_at_all_s:
            return ready
        self._look_at_all_s = now_s + _ALL_S
        return self._readers.keys()

    def close(self) -> None:
        """Destroy the subscriptions."""
        for reader in self._readers.values():
            reader.close()
        self._left = ()

    def _take(self, topics: Collection[str], limit: int) -> Sequence[Message]:
        share = max(1, limit // max(1, len(topics)))
        messages = [it for topic in topics for it in self._readers[topic].take(share)]
        self._left = [topic for topic in topics if not self._readers[topic].exhausted]
        return messages

    def _raise_failure(self) -> None:
        for topic in self._left:  # what has failed has left something
            self._readers[topic].raise_failure()
