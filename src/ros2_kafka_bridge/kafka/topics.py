"""Topics: looking at them and creating them."""

from collections.abc import Mapping
from typing import Any

from confluent_kafka import Consumer, KafkaError, KafkaException
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    ConfigResource,
    NewTopic,
    ResourceType,
)

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.admin import Admin

_REQUEST_S = 3.0
_LOOK_S = 2.0
_DONE = {
    KafkaError.TOPIC_ALREADY_EXISTS,
    KafkaError.TOPIC_AUTHORIZATION_FAILED,
    KafkaError.CLUSTER_AUTHORIZATION_FAILED,
}


def ensure_topic(properties: Mapping[str, Any], topic: str) -> None:
    """Create a topic of one partition if it is not there and may be created.

    Without the permission nothing is done here: producing then says what is missing.

    Raises:
        TransportError: The broker did not answer.
        RouteError: This user is not let in.
    """
    admin = Admin(properties, __name__)
    with admin.translated(f'topic {topic}'):
        if topic in admin.requests.list_topics(timeout=_REQUEST_S).topics:
            return
        new = NewTopic(topic, num_partitions=1)
        answer = admin.requests.create_topics([new], request_timeout=_REQUEST_S)[topic]
        try:
            answer.result(_REQUEST_S + 1)
        except TimeoutError as error:
            raise TransportError(f'topic {topic}: the broker does not answer') from error
        except KafkaException as error:
            if error.args[0].code() not in _DONE:
                raise


def partitions_of(client: Consumer, topic: str, within_s: float) -> list[int]:
    """The numbers of a topic's partitions, as the broker tells them.

    Raises:
        KafkaException: The broker does not answer, or tells an error instead: none may look like
            a topic without partitions.
    """
    found = client.list_topics(topic, timeout=within_s).topics[topic]
    if found.error is not None:
        raise KafkaException(found.error)
    return list(found.partitions)


def topic_limit_bytes(properties: Mapping[str, Any], topic: str) -> int | None:
    """Look up the topic's max.message.bytes; None where the broker does not tell."""
    admin = Admin(properties, __name__).requests
    resource = ConfigResource(ResourceType.TOPIC, topic)
    try:
        answer = admin.describe_configs([resource], request_timeout=_LOOK_S)[resource]
        return int(answer.result(_LOOK_S + 1)['max.message.bytes'].value)
    except (KafkaException, TimeoutError, KeyError, TypeError):  # not all brokers tell all
        return None
