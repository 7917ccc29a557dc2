"""Committing offsets and knowing that they are, within a limit."""

import time
from collections.abc import Sequence
from typing import Final

from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.errors import ERROR_CLASSES

_LOOK_S: Final = 1.0
_PAUSE_S: Final = 0.05


def commit_within(
    seconds: float,
    client: Consumer,
    offsets: Sequence[TopicPartition],
    *,
    any_counts: bool = False,
) -> dict[int, int]:
    """Commit offsets, and look until the group has them.

    librdkafka's own synchronous commit waits without any limit for a broker that stands still
    (SIGSTOP: 75 s and more); for one that is gone it waits as long as a session. That one is
    refused is told later, to the client's `on_commit`: here it only takes too long.

    Args:
        seconds: How long to wait.
        client: A member of the group.
        offsets: Of one topic.
        any_counts: Whether another member may have committed others at the same time.

    Returns:
        What the group has, by partition.

    Raises:
        KafkaException: It took too long, or the group may not be read.
    """
    deadline_s = time.monotonic() + seconds
    least = {place.partition: 0 if any_counts else place.offset for place in offsets}
    here = [TopicPartition(place.topic, place.partition) for place in offsets]
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
            if all(place.offset >= least[place.partition] for place in found):
                return {place.partition: place.offset for place in found}
        time.sleep(_PAUSE_S)
