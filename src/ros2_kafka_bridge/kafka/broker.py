"""Looking at a broker without changing anything, for `check --connect`."""

import contextlib
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from confluent_kafka import Consumer, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.kafka.errors import translate
from ros2_kafka_bridge.kafka.properties import consumer_properties
from ros2_kafka_bridge.logs.lines import client_log
from ros2_kafka_bridge.logs.text import count

_REQUEST_S = 5.0


class TopicView(NamedTuple):
    """What is seen of a topic.

    Args:
        rights: Operations that this user may do (READ, WRITE, ...); None if the broker does not
            tell.
        problem: Why it is not there, in the broker's words.
    """

    exists: bool
    partitions: int
    rights: frozenset[str] | None
    problem: str


class Broker:
    """A cluster, looked at with the user's own properties."""

    def __init__(self, properties: Mapping[str, Any]) -> None:
        self._properties = properties
        self._admin = Admin(properties, __name__)

    def greeting(self) -> str:
        """Say who answers.

        Raises:
            TransportError: Nobody does.
            RouteError: This user is not let in.
        """
        with self._admin.translated('the broker does not answer'):
            metadata = self._admin.requests.list_topics(timeout=_REQUEST_S)
        brokers = count(len(metadata.brokers), 'broker')
        verb = 'answers' if len(metadata.brokers) == 1 else 'answer'
        return f'{brokers} of cluster {metadata.cluster_id} {verb}'

    def topic(self, topic: str) -> TopicView:
        """Look at one topic."""
        try:
            answer = self._admin.requests.describe_topics(
                _topics([topic]), include_authorized_operations=True, request_timeout=_REQUEST_S
            )[topic].result()
        except KafkaException as error:
            return TopicView(exists=False, partitions=0, rights=None, problem=error.args[0].str())
        rights = answer.authorized_operations
        names = None if rights is None else frozenset(right.name for right in rights)
        return TopicView(exists=True, partitions=len(answer.partitions), rights=names, problem='')

    def committed(self, group: str, topic: str, partitions: int) -> dict[int, int]:
        """Look up the committed offsets of a group.

        Raises:
            RouteError: This user may not see the group.
            TransportError: The coordinator does not answer.
        """
        asked = [TopicPartition(topic, number) for number in range(partitions)]
        deadline_s = time.monotonic() + _REQUEST_S
        # A consumer asks, because librdkafka's admin request can end the process while the
        # coordinator of a broker that has just started loads its groups.
        properties = consumer_properties(self._properties, group=group, client_id=__name__)
        client = Consumer(properties, logger=client_log(__name__))
        with contextlib.closing(client):
            while True:
                try:
                    answer = client.committed(asked, timeout=_REQUEST_S)
                    break
                except KafkaException as error:
                    problem = translate(error.args[0], 'its offsets cannot be read')
                    if not isinstance(problem, TransportError) or time.monotonic() > deadline_s:
                        raise problem from error
                    time.sleep(0.2)
        return {p.partition: p.offset for p in answer if p.offset >= 0}


def _topics(names: list[str]) -> Any:
    from confluent_kafka import TopicCollection  # noqa: PLC0415 (its stub says Any)

    return TopicCollection(names)
