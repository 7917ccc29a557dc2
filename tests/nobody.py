"""Whom a source of records can do without, for tests of it alone."""

from ros2_kafka_bridge.kafka.topic_id import Question, TopicIds


class Nobody:
    """Calls of a source while it is polled, which change nothing."""

    def revoked(self, partitions: frozenset[int]) -> None:
        pass

    def lost(self, partitions: frozenset[int]) -> None:
        pass

    def detached(self, partitions: frozenset[int]) -> None:
        pass


class NoIds(TopicIds):
    """A cluster that does not tell which topics its names stand for."""

    def ask(self, topic: str) -> Question | None:
        del topic
        return None


NO_IDS = NoIds({})
