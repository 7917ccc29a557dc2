"""What topics hold, read from their beginning up to the end that they have now."""

import contextlib
import time
from collections.abc import Iterator
from typing import Any, Final

from confluent_kafka import OFFSET_BEGINNING, Consumer, KafkaException, Message, TopicPartition

REQUEST_S: Final = 30.0
READ_S: Final = 120.0
_QUIET: Final = 3


def records(bootstrap_servers: str, topic: str, partitions: int = 1) -> Iterator[Message]:
    """All records of a topic, one partition after the other; no group is joined for it.

    Raises:
        KafkaException: Nobody has told the end of a partition within 30 s.
        TimeoutError: A partition could not be read to its end within two minutes.
    """
    config = {
        'bootstrap.servers': bootstrap_servers,
        'group.id': 'nobody',
        'enable.auto.commit': False,
        'isolation.level': 'read_uncommitted',
        'log_level': _QUIET,
    }
    with contextlib.closing(Consumer(config)) as consumer:
        for partition in range(partitions):
            yield from _of_partition(consumer, topic, partition)


def headers(record: Message, errors: str = 'strict') -> dict[str, str]:
    """The headers of a record as text; `errors` as in `bytes.decode`."""
    pairs: Any = record.headers() or []  # a list, though its type says more
    return {name: bytes(value or b'').decode(errors=errors) for name, value in pairs}


def _of_partition(consumer: Consumer, topic: str, partition: int) -> Iterator[Message]:
    deadline_s = time.monotonic() + READ_S
    end = _end(consumer, topic, partition)
    consumer.assign([TopicPartition(topic, partition, OFFSET_BEGINNING)])
    place = 0
    while place < end:
        for record in consumer.consume(1000, 0.1):
            if record.error() is None:
                place = (record.offset() or 0) + 1
                yield record
        if time.monotonic() > deadline_s:
            raise TimeoutError(f'{topic}[{partition}] can be read up to {place} of {end} only')


def _end(consumer: Consumer, topic: str, partition: int) -> int:
    deadline_s = time.monotonic() + REQUEST_S
    while True:
        try:
            _, end = consumer.get_watermark_offsets(TopicPartition(topic, partition), timeout=5)
            return int(end)
        except KafkaException:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.2)
