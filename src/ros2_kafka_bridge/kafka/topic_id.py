"""Which topic it is of all that ever had its name: by the ids that Kafka gives (KIP-516).

The offsets of a group are kept by name. Their metadata says which topic they are of, so that those
of a topic that was deleted are not taken for places in the one that was made anew.
"""

import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Self

import msgspec
from confluent_kafka import KafkaException, TopicCollection, Uuid

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.admin import Admin

if TYPE_CHECKING:
    from concurrent.futures import Future

ANSWER_S: Final = 2.0
"""How long an answer may take."""

_NONE: Final = str(Uuid(0, 0))  # of a broker before 2.8
_LONGEST: Final = 4096  # as much as a broker keeps (offset.metadata.max.bytes)


class TopicId(msgspec.Struct, frozen=True):
    """One topic of one cluster, for as long as there are both.

    Args:
        cluster_id: Of the cluster.
        topic_id: Of the topic in it, in base64.
    """

    cluster_id: str
    topic_id: str

    @classmethod
    def of_metadata(cls, text: str | None) -> Self | None:
        """The topic that a committed offset is of; None where nobody has said so.

        Args:
            text: Its metadata, which whoever commits may write as he likes.
        """
        try:
            told = msgspec.json.decode((text or '')[:_LONGEST], type=cls)
        except (msgspec.DecodeError, UnicodeError):
            return None
        return told if told.cluster_id and told.topic_id else None

    @property
    def metadata(self) -> str:
        """What says beside a committed offset that it is of this topic."""
        return msgspec.json.encode(self).decode()

    def has_replaced(self, other: 'TopicId | None') -> bool:
        """Whether it has come in the place of another topic of its name, in its cluster."""
        return (
            other is not None
            and self.cluster_id == other.cluster_id
            and self.topic_id != other.topic_id
        )

    def is_elsewhere(self, other: 'TopicId | None') -> bool:
        """Whether another one of its name is in another cluster."""
        return other is not None and self.cluster_id != other.cluster_id


class Question:
    """Which topic a name stands for now, asked and perhaps not answered yet.

    Args:
        client: Who asks: without it, there would be no answer.
        topic: What the cluster tells of the topic.
        cluster: What it tells of itself.
    """

    def __init__(self, client: Any, topic: 'Future[Any]', cluster: 'Future[Any]') -> None:
        self._client = client
        self._topic = topic
        self._cluster = cluster

    @property
    def is_answered(self) -> bool:
        """Whether there is an answer, or will be none."""
        return self._topic.done() and self._cluster.done()

    def answer(self, within_s: float) -> TopicId | None:
        """Wait for the answer; None where there is none.

        Raises:
            KafkaException: The cluster does not answer, or not so.
            TimeoutError: Not within this time.
        """
        by_s = time.monotonic() + within_s
        topic_id = known_id(self._topic.result(within_s).topic_id)
        told = self._cluster.result(max(0.0, by_s - time.monotonic())).cluster_id
        cluster_id = str(told or '')
        return TopicId(cluster_id, topic_id) if topic_id and cluster_id else None


class TopicIds:
    """Asks a cluster which topics its names stand for now; for the threads of all routes.

    A broker before 2.8 does not know, one that is away does not answer, and one that is asked by
    somebody without the right to DESCRIBE the topic does not say.

    Args:
        properties: librdkafka properties that all clients have.
    """

    def __init__(self, properties: Mapping[str, Any]) -> None:
        self._properties = properties
        self._making = threading.Lock()
        self._admin: Admin | None = None

    def ask(self, topic: str) -> Question | None:
        """Ask which topic this is, without waiting; None where that is not possible now."""
        try:
            client = self._client()
            wanted, limit_s = TopicCollection([topic]), ANSWER_S
            about_topic = client.requests.describe_topics(wanted, request_timeout=limit_s)[topic]
            about_cluster = client.requests.describe_cluster(request_timeout=limit_s)
            return Question(client, about_topic, about_cluster)
        except (KafkaException, RouteError):
            return None

    def answer(self, question: Question | None, within_s: float = 0.0) -> TopicId | None:
        """What a question has brought; None where that is nothing."""
        if question is None:
            return None
        try:
            return question.answer(within_s)
        except TimeoutError:
            return None
        except KafkaException as error:
            if error.args[0].code() < 0:  # no word of a broker
                self._admin = None  # one that has forgotten all brokers finds none any more
            return None

    def serve(self) -> None:
        """Let the client say what it has to say, or that would pile up; called now and then."""
        if (admin := self._admin) is not None:
            admin.requests.poll(0)

    def _client(self) -> Admin:
        with self._making:
            admin = self._admin or Admin(self._properties, __name__)
            self._admin = admin
            return admin


def known_id(told: Uuid) -> str:
    """The id of a topic in base64; empty where the broker knows none."""
    text = str(told)
    return '' if text == _NONE else text
