"""When the last records of a topic were written; nothing is committed."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from confluent_kafka import (
    TIMESTAMP_LOG_APPEND_TIME,
    TIMESTAMP_NOT_AVAILABLE,
    Consumer,
    KafkaException,
)

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.cause import ClientErrors
from ros2_kafka_bridge.kafka.ranges import Place, RangeReader, held, opened
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
    own = {**properties, 'error_cb': cause.note}
    with opened(own, f'topic {topic}', client_log(__name__)) as consumer:
        try:
            there = _held(consumer, topic, partition)
            found = _read(consumer, {place: offsets[-last:] for place, offsets in there.items()})
        except KafkaException as error:
            consumer.poll(0)  # calls back what has come meanwhile
            raise cause.translated(error.args[0], f'topic {topic} cannot be read') from error
    return _merged(found, {place for place in there if len(there[place]) > last}, last)


def _held(consumer: Consumer, topic: str, partition: int | None) -> dict[Place, range]:
    """What the topic holds, or that partition alone."""
    numbers = sorted(partitions_of(consumer, topic, _REQUEST_S))
    if partition is not None and partition not in numbers:
        last = len(numbers) - 1
        raise RouteError(f'topic {topic} has no partition {partition}, only 0 to {last}')
    return held(consumer, topic, _REQUEST_S, numbers if partition is None else [partition])


def _read(consumer: Consumer, ranges: Mapping[Place, range]) -> dict[Place, list[tuple[int, int]]]:
    """Kind and milliseconds of each record."""
    found: dict[Place, list[tuple[int, int]]] = {place: [] for place in ranges}
    reader = RangeReader(consumer, ranges, silent_s=_SILENT_S)
    for message in reader:
        found[message.topic() or '', message.partition() or 0].append(message.timestamp())
    if reader.left:
        raise TransportError(f'the broker sends no records any more ({_SILENT_S:g} s)')
    return found


def _merged(
    found: Mapping[Place, list[tuple[int, int]]], cut: set[Place], last: int
) -> Timestamps:
    """All partitions as one stream, over the time of which all were read."""
    stamped = {
        place: [ms for kind, ms in stamps if kind != TIMESTAMP_NOT_AVAILABLE]
        for place, stamps in found.items()
    }
    kinds = {kind for stamps in found.values() for kind, _ in stamps}
    since_ms = max((min(stamped[place]) for place in cut if stamped[place]), default=0)
    times_ms = sorted(ms for stamps in stamped.values() for ms in stamps if ms >= since_ms)
    return Timestamps(
        times_ms=times_ms[-last:],
        in_order=all(stamps == sorted(stamps) for stamps in stamped.values()),
        by_broker=TIMESTAMP_LOG_APPEND_TIME in kinds,
        partitions=sum(map(bool, stamped.values())),
    )
