"""Publishing to ROS: the topics that a route publishes on."""

from collections.abc import Mapping, Sequence

from ros2_kafka_bridge.endpoints import Load, Matches
from ros2_kafka_bridge.ros.topic_writer import TopicWriter


class RosSink:
    """A `MessageSink` of real topics.

    Args:
        writers: By their topics.
    """

    def __init__(self, writers: Mapping[str, TopicWriter]) -> None:
        self._writers = writers

    @property
    def load(self) -> Load:
        """What the histories hold, as far as the readers have told."""
        return Load.of_all(writer.load for writer in self._writers.values())

    @property
    def matches(self) -> Matches:
        """Its subscribers at the last look."""
        return Matches.of_all(writer.matches for writer in self._writers.values())

    @property
    def reliable_subscribers(self) -> Sequence[str]:
        """Names of the nodes whose acknowledgements it waits for, as far as the graph knows."""
        each = (writer.reliable_subscribers for writer in self._writers.values())
        return sorted({node for nodes in each for node in nodes})

    def writer(self, topic: str) -> TopicWriter:
        """What publishes on a topic."""
        return self._writers[topic]

    def open(self) -> None:
        """Make the publishers.

        Raises:
            RouteError: ROS refuses one, for example for another type on the same topic.
        """
        for writer in self._writers.values():
            writer.open()

    def close(self) -> None:
        """Destroy the publishers."""
        for writer in self._writers.values():
            writer.close()
