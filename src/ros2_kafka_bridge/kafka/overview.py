"""All topics of a cluster, and how far they reach; nothing is read from them or changed."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from confluent_kafka import KafkaException, TopicPartition
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    ConfigResource,
    OffsetSpec,
    ResourceType,
)

from ros2_kafka_bridge.kafka.admin import Admin

_REQUEST_S = 5.0


class KafkaTopic(NamedTuple):
    """A topic of the cluster.

    Args:
        problem: Why nothing more is known of it, in the broker's words; empty if it is well.
    """

    name: str
    partitions: int
    problem: str


class Overview:
    """A cluster, looked at with the user's own properties."""

    def __init__(self, properties: Mapping[str, Any]) -> None:
        self._admin = Admin(properties, __name__)

    def topics(self) -> list[KafkaTopic]:
        """All topics that this user may see, sorted.

        Raises:
            TransportError: No broker answers.
            RouteError: This user is not let in.
        """
        with self._admin.translated('the broker does not answer'):
            found = self._admin.requests.list_topics(timeout=_REQUEST_S).topics
        return [
            KafkaTopic(name, len(topic.partitions), topic.error.str() if topic.error else '')
            for name, topic in sorted(found.items())
        ]

    def begins(self, topics: Iterable[KafkaTopic]) -> dict[tuple[str, int], int]:
        """The first offset of each partition; those that do not answer are left out."""
        return self._offsets(topics, OffsetSpec.earliest())  # type: ignore[no-untyped-call]

    def ends(self, topics: Iterable[KafkaTopic]) -> dict[tuple[str, int], int]:
        """The offset behind the last record of each partition, as `begins`."""
        return self._offsets(topics, OffsetSpec.latest())  # type: ignore[no-untyped-call]

    def creates_topics(self) -> bool | None:
        """Whether the brokers create a topic that is written to; None where they do not tell."""
        name = 'auto.create.topics.enable'
        try:
            brokers = self._admin.requests.list_topics(timeout=_REQUEST_S).brokers
            resource = ConfigResource(ResourceType.BROKER, str(min(brokers)))
            answer = self._admin.requests.describe_configs([resource], request_timeout=_REQUEST_S)
            value = answer[resource].result(_REQUEST_S + 1).get(name)
        except (KafkaException, TimeoutError, ValueError):
            return None
        return None if value is None else value.value == 'true'

    def _offsets(
        self, topics: Iterable[KafkaTopic], spec: OffsetSpec
    ) -> dict[tuple[str, int], int]:
        asked = {
            TopicPartition(topic.name, number): spec
            for topic in topics
            for number in range(topic.partitions)
        }
        if not asked:
            return {}
        answers = self._admin.requests.list_offsets(asked, request_timeout=_REQUEST_S)
        found = {}
        for partition, answer in answers.items():
            try:
                found[partition.topic, partition.partition] = int(answer.result().offset)
            except KafkaException:
                continue  # its leader is away just now, or this user may not see it
        return found


def records(
    topic: KafkaTopic,
    begins: Mapping[tuple[str, int], int],
    ends: Mapping[tuple[str, int], int],
) -> int | None:
    """How many offsets a topic holds: more than records where it is compacted or transactional.

    None where a partition did not answer.
    """
    places = [(topic.name, number) for number in range(topic.partitions)]
    if not all(place in begins and place in ends for place in places):
        return None
    return sum(ends[place] - begins[place] for place in places)
