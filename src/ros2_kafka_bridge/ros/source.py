"""Taking from ROS: the topics that a route reads."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from ros2_kafka_bridge.endpoints import Matches, Message
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.topic_reader import TopicReader


class RosSource:
    """A `MessageSource` of real topics, which are waited for together.

    Args:
        node: The bridge's node.
        readers: By their topics.
    """

    def __init__(self, node: RosNode, readers: Mapping[str, TopicReader]) -> None:
        self._node = node
        self._readers = readers
        self._waiter: Any = None

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
        from ros2_kafka_bridge.ros.take import Waiter  # noqa: PLC0415 (heavy)

        self._waiter = Waiter(self._node.context)
        for reader in self._readers.values():
            reader.open()

    def look(self) -> None:
        """Follow the publishers, if it is time for that.

        Raises:
            RouteError: ROS refuses a subscription, or to tell who publishes.
        """
        for reader in self._readers.values():
            reader.look()

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Wait up to `timeout_s` for messages, then take at most `limit`.

        Raises:
            RouteError: ROS has failed; what was taken before that was returned.
        """
        self.look()
        self._raise_failure()
        messages = self._take(limit)
        if not messages:
            self._raise_failure()
            if self.exhausted and timeout_s > 0:
                self._wait(timeout_s)
                messages = self._take(limit)
        return messages

    def close(self) -> None:
        """Destroy the subscriptions."""
        for reader in self._readers.values():
            reader.close()

    def _take(self, limit: int) -> Sequence[Message]:
        share = max(1, limit // max(1, len(self._readers)))
        return [it for reader in self._readers.values() for it in reader.take(share)]

    def _raise_failure(self) -> None:
        for reader in self._readers.values():
            reader.raise_failure()

    def _wait(self, timeout_s: float) -> None:
        handles = [handle for reader in self._readers.values() for handle in reader.handles]
        if not handles:
            time.sleep(timeout_s)
            return
        with translated(f'subscription of {", ".join(self._readers)}'):
            self._waiter.wait(handles, timeout_s)
