"""Committing offsets and knowing that they are, within a limit."""

import time
from collections.abc import Sequence
from typing import Final

from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.errors import ERROR_CLASSES

_LOOK_S: Final = 1.0
_PAUSE_S: Final = 0.01


def commit_within(seconds: float, client: Consumer, offsets: Sequence[TopicPartition]) -> None:
    """Commit offsets, and look until the group has them.

    librdkafka's own synchronous commit waits without any limit for a broker that stands still
    (SIGSTOP: 75 s and more); for one that is gone it waits as long as a session.

    Raises:
        KafkaException: They were refused, or it took too long.
    """
    deadline_s = time.monotonic() + seconds
    wanted = {(place.topic, place.partition): place.offset for place in offsets}
    here = [TopicPartition(topic, partition) for topic, partition in wanted]
    client.commit(offsets=list(offsets), asynchronous=True)
    while True:
        left_s = deadline_s - time.monotonic()
        if left_s <= 0:
            text = f'the broker has not confirmed a commit within {seconds:g} s'
            raise KafkaException(KafkaError(KafkaError._TIMED_OUT, text))  # noqa: SLF001 (public)
        try:
            found = client.committed(here, timeout=min(left_s, _LOOK_S))
        except KafkaException as error:
            kind = ERROR_CLASSES.get(error.args[0].code(), RouteError)
            if not issubclass(kind, TransportError):
                raise
        else:
            if all(place.offset == wanted[place.topic, place.partition] for place in found):
                return
        time.sleep(_PAUSE_S)
