"""Whom a source of records calls and asks, for tests of it alone."""

from ros2_kafka_bridge.kafka.topic_id import Question, TopicId, TopicIds


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


OLD, NEW = (TopicId('here', name) for name in ('old', 'new'))
"""A topic, and the one that was made in its place."""


class _Answered(Question):
    def __init__(self, told: TopicId | None) -> None:
        self.told = told

    @property
    def is_answered(self) -> bool:
        return True

    def answer(self, within_s: float) -> TopicId | None:
        del within_s
        return self.told


class ToldIds(TopicIds):
    """A cluster that gives these answers, and the last of them again and again."""

    def __init__(self, *told: TopicId | None) -> None:
        super().__init__({})
        self.told = told
        self.asked = 0

    def ask(self, topic: str) -> Question | None:
        assert topic == 't'
        self.asked += 1
        return _Answered(self.told[min(self.asked, len(self.told)) - 1])
