"""What the end of a topic says of the messages that are in it already."""

import contextlib
import logging
import time
from collections.abc import Mapping
from typing import Any

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.health import check_files

TAIL_RECORDS = 10_000
_REQUEST_S = 5.0
_READ_S = 60.0


def read_tail(
    properties: Mapping[str, Any], topic: str, records: int = TAIL_RECORDS
) -> set[tuple[bytes, int]]:
    """Read the last `records` records of each partition.

    Returns:
        Publisher gid and number (`ros.gid`, `ros.seq`) of each that carries them.

    Raises:
        TransportError: The broker is away.
        RouteError: The topic may not be read.
    """
    about = Client('READ', properties)
    check_files(properties, f'topic {topic}')
    consumer = Consumer(
        {**properties, 'enable.partition.eof': True},
        logger=logging.getLogger(f'{__name__}.librdkafka'),
    )
    try:
        return _read(consumer, topic, records)
    except KafkaException as error:
        where = f'topic {topic} cannot be read, to skip what it holds from before a restart'
        raise translate(error.args[0], where, about) from error
    finally:
        consumer.close()


def _read(consumer: Consumer, topic: str, records: int) -> set[tuple[bytes, int]]:
    ends: set[int | None] = set()
    starts: list[TopicPartition] = []
    partitions = consumer.list_topics(topic, timeout=_REQUEST_S).topics[topic].partitions
    for partition in partitions:
        here = TopicPartition(topic, partition)
        low, high = consumer.get_watermark_offsets(here, timeout=_REQUEST_S)
        if high > low:
            ends.add(partition)
            starts.append(TopicPartition(topic, partition, max(low, high - records)))
    consumer.assign(starts)
    found: set[tuple[bytes, int]] = set()
    deadline_s = time.monotonic() + _READ_S
    while ends:
        for message in consumer.consume(1000, 0.05):
            error = message.error()
            if error is None:
                _note(message, found)
            elif error.code() == KafkaError._PARTITION_EOF:  # noqa: SLF001 (its public name)
                ends.discard(message.partition())
            elif not isinstance(translate(error, f'topic {topic}'), TransportError):
                raise KafkaException(error)
        if time.monotonic() > deadline_s:
            raise TransportError(f'topic {topic}: its end cannot be read')
    return found


def _note(message: Message, found: set[tuple[bytes, int]]) -> None:
    headers = dict(message.headers() or ())
    gid, seq = headers.get('ros.gid'), headers.get('ros.seq')
    if isinstance(gid, bytes) and isinstance(seq, bytes):
        # Anyone may write such headers: what is not ours says nothing.
        with contextlib.suppress(ValueError):
            found.add((bytes.fromhex(gid.decode()), int(seq)))
