"""When the last records of a topic were written; nothing is committed."""

import time
from collections.abc import Mapping
from contextlib import closing
from typing import Any, NamedTuple

from confluent_kafka import (
    TIMESTAMP_LOG_APPEND_TIME,
    TIMESTAMP_NOT_AVAILABLE,
    Consumer,
    KafkaError,
    KafkaException,
    TopicPartition,
)

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.cause import ClientErrors
from ros2_kafka_bridge.kafka.errors import translate
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topics import partitions_of
from ros2_kafka_bridge.logs.lines import client_log

_REQUEST_S = 5.0
_SILENT_S = 20.0


class Timestamps(NamedTuple):
    """The timestamps of records.

    Args:
        times_ms: In order, since 1970.
        in_order: Whether they came in this order in each partition.
        by_broker: Whether the broker gave them (LogAppendTime).
        partitions: How many partitions hold records.
    """

    times_ms: list[int]
    in_order: bool
    by_broker: bool
    partitions: int


class _Start(NamedTuple):
    """Where a partition is read from, and whether it holds records before that."""

    partition: int
    offset: int
    is_cut: bool


def read_timestamps(
    properties: Mapping[str, Any], topic: str, last: int, partition: int | None = None
) -> Timestamps:
    """Read when the last records of a topic were written.

    Args:
        properties: Of a consumer.
        topic: Its name.
        last: How many records, of all partitions together.
        partition: This one alone; None for all.

    Raises:
        TransportError: The broker is away.
        RouteError: There is no such topic or partition, or it may not be read.
    """
    cause = ClientErrors(properties, 'READ')
    check_files(properties, f'topic {topic}')
    own = {'enable.partition.eof': True, 'error_cb': cause.note}
    consumer = Consumer({**properties, **own}, logger=client_log(__name__))
    with closing(consumer):
        try:
            starts = _starts(consumer, topic, last, partition)
            found = _read(consumer, topic, starts)
        except KafkaException as error:
            consumer.poll(0)  # calls back what has come meanwhile
            raise cause.translated(error.args[0], f'topic {topic} cannot be read') from error
    return _merged(found, {start.partition for start in starts if start.is_cut}, last)


def _starts(consumer: Consumer, topic: str, last: int, partition: int | None) -> list[_Start]:
    """Where to begin with each partition that holds records."""
    there = sorted(partitions_of(consumer, topic, _REQUEST_S))
    numbers = there if partition is None else [partition]
    if partition is not None and partition not in there:
        raise RouteError(f'topic {topic} has no partition {partition}, only 0 to {len(there) - 1}')
    starts = []
    for number in numbers:
        here = TopicPartition(topic, number)
        low, high = consumer.get_watermark_offsets(here, timeout=_REQUEST_S)
        begin = max(low, high - last)
        if high > low:
            starts.append(_Start(number, begin, is_cut=begin > low))
    return starts


def _read(
    consumer: Consumer, topic: str, starts: list[_Start]
) -> dict[int, list[tuple[int, int]]]:
    """Kind and milliseconds of each record, up to the end that each partition has now."""
    consumer.assign([TopicPartition(topic, start.partition, start.offset) for start in starts])
    found: dict[int, list[tuple[int, int]]] = {start.partition: [] for start in starts}
    reading = set(found)
    deadline_s = time.monotonic() + _SILENT_S
    while reading:
        for message in consumer.consume(5000, 0.1):
            error, number = message.error(), message.partition()
            deadline_s = time.monotonic() + _SILENT_S
            if error is None and number in reading:
                found[number].append(message.timestamp())
            elif error is None:
                continue
            elif error.code() == KafkaError._PARTITION_EOF:  # noqa: SLF001 (its public name)
                reading.discard(number)
            elif not isinstance(translate(error, ''), TransportError):
                raise KafkaException(error)
        if time.monotonic() > deadline_s:
            raise TransportError(f'the broker sends no records any more ({_SILENT_S:g} s)')
    return found


def _merged(found: dict[int, list[tuple[int, int]]], cut: set[int], last: int) -> Timestamps:
    """All partitions as one stream, over the time of which all were read."""
    stamped = {
        number: [ms for kind, ms in stamps if kind != TIMESTAMP_NOT_AVAILABLE]
        for number, stamps in found.items()
    }
    kinds = {kind for stamps in found.values() for kind, _ in stamps}
    since_ms = max((min(stamped[number]) for number in cut if stamped[number]), default=0)
    times_ms = sorted(ms for stamps in stamped.values() for ms in stamps if ms >= since_ms)
    return Timestamps(
        times_ms=times_ms[-last:],
        in_order=all(stamps == sorted(stamps) for stamps in stamped.values()),
        by_broker=TIMESTAMP_LOG_APPEND_TIME in kinds,
        partitions=sum(map(bool, stamped.values())),
    )
