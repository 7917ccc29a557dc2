"""The end of a topic, read backwards step by step."""

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final, NamedTuple, cast

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition

from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.errors import Client, is_missing_topic, translate
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topics import partitions_of

# The caller is the thread of a route: while it waits here nothing is taken from ROS.
_REQUEST_S: Final = 2.0
_BATCH: Final = 50  # the headers of all of them are unpacked at once: see `route.pieces`
# The client bounds a fetch as it is packed, not what it becomes: with its own settings 4,000
# records with headers of 900 kB, which zstd packs well, took 3.5 GB; with these 0.5 GB, however
# many there are.
BOUNDS: Final = {'max.partition.fetch.bytes': 65_536, 'queued.min.messages': 200}
"""Properties of a consumer that reads what strangers may have written."""

Note = Callable[[Record], None]
"""What is done with a record that was read."""


class _Start(NamedTuple):
    """Where the reading of a partition has begun.

    Args:
        offset: Of the first record read.
        low: Of the first record that the partition holds.
        time_ns: Of the first record read; infinite where none tells.
    """

    offset: int
    low: int
    time_ns: float


class KafkaTail:
    """A `TopicTail` of a real topic: its last records, as far as they were read back.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: The topic.
    """

    def __init__(self, properties: Mapping[str, Any], topic: str) -> None:
        self.topic = topic
        self.records = 0  # read so far
        self.is_cut = False
        # What a broker deletes meanwhile is not missed.
        own = {'enable.partition.eof': True, 'auto.offset.reset': 'earliest', **BOUNDS}
        self._properties = {**properties, **own}
        self._about = Client('READ', properties)
        self._starts: dict[int, _Start] = {}
        self._lows: dict[int, int] = {}

    @property
    def complete(self) -> bool:
        """Whether the topic holds nothing before what was read."""
        read = all(start.offset <= start.low for start in self._starts.values())
        return read and not self.is_cut

    @property
    def partitions(self) -> int:
        """How many partitions the topic has."""
        return len(self._starts)

    @property
    def since_ns(self) -> float:
        """All records from that time on were read, by their timestamps, since 1970."""
        incomplete = (s.time_ns for s in self._starts.values() if s.offset > s.low)
        return max(incomplete, default=0.0)

    def read(self, records: int, within_s: float, note: Note) -> None:
        """Read `records` records of each partition: the last ones, then those before them.

        Args:
            records: How many of each partition.
            within_s: The longest time for it.
            note: Called with each of them.

        Where there is more than that time is enough for, `is_cut` says so, and nothing can be read
        any further.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read.
        """
        check_files(self._properties, f'topic {self.topic}')
        with self._translated():
            consumer = Consumer(
                self._properties, logger=logging.getLogger(f'{__name__}.librdkafka')
            )
            try:
                ranges = self._ranges(consumer, records)
                reading = _Reading(ranges, note)
                self._read(consumer, reading, ranges, within_s)
            finally:
                consumer.close()
        self.records += reading.records
        for partition, offsets in ranges.items():
            time_ns = reading.times_ns.get(partition, math.inf)
            self._starts[partition] = _Start(offsets.start, self._lows[partition], time_ns)

    def _ranges(self, consumer: Consumer, records: int) -> dict[int, range]:
        """The offsets to read in each partition."""
        ranges = {}
        for partition in self._partitions(consumer):
            here = TopicPartition(self.topic, partition)
            low, high = consumer.get_watermark_offsets(here, timeout=_REQUEST_S)
            before = self._starts.get(partition)
            end = max(low, high if before is None else before.offset)
            ranges[partition] = range(max(low, end - records), end)
            self._lows[partition] = low
        return ranges

    def _partitions(self, consumer: Consumer) -> list[int]:
        """Those of the topic; none where it is not there yet."""
        try:
            return partitions_of(consumer, self.topic, _REQUEST_S)
        except KafkaException as error:
            if not is_missing_topic(error.args[0]):
                raise
            return []

    def _read(
        self,
        consumer: Consumer,
        reading: '_Reading',
        ranges: Mapping[int, range],
        within_s: float,
    ) -> None:
        deadline_s = time.monotonic() + within_s
        places = [TopicPartition(self.topic, p, ranges[p].start) for p in reading.left]
        consumer.assign(places)
        while reading.left:
            batch = consumer.consume(_BATCH, 0.05)
            batch.reverse()
            while batch:  # what was looked at is let go: its headers may take megabytes
                message = batch.pop()
                error = message.error()
                if error is None or error.code() == KafkaError._PARTITION_EOF:  # noqa: SLF001 (its public name)
                    if reading.note(message):
                        number = message.partition() or 0
                        consumer.pause([TopicPartition(self.topic, number)])
                elif not isinstance(translate(error, f'topic {self.topic}'), TransportError):
                    raise KafkaException(error)
            now_s = time.monotonic()
            if reading.left and now_s > deadline_s:
                if now_s - reading.heard_at_s > within_s / 2:
                    raise TransportError(f'topic {self.topic}: its end cannot be read in time')
                self.is_cut = True
                return

    @contextmanager
    def _translated(self) -> Iterator[None]:
        where = f'topic {self.topic} cannot be read, to skip what it holds from before a restart'
        try:
            yield
        except KafkaException as error:
            raise translate(error.args[0], where, self._about) from error


class _Reading:
    """Some offsets of each partition, while they are read."""

    def __init__(self, ranges: Mapping[int, range], note: Note) -> None:
        self.left = {partition for partition, offsets in ranges.items() if offsets}
        self.records = 0
        self.heard_at_s = time.monotonic()
        self.times_ns: dict[int, float] = {}  # of the first record in each partition
        self._ranges = ranges
        self._note = note

    def note(self, message: Message) -> bool:
        """Take in a record, or the end of a partition; tells whether the partition is through."""
        partition, offset = message.partition() or 0, message.offset() or 0
        if partition not in self.left:
            return False
        if message.error() is None and offset < self._ranges[partition].stop:
            self._note_record(message, partition)
        if message.error() is None and offset + 1 < self._ranges[partition].stop:
            return False
        self.left.discard(partition)
        return True

    def _note_record(self, message: Message, partition: int) -> None:
        self.records += 1
        self.heard_at_s = time.monotonic()
        if partition not in self.times_ns:
            self.times_ns[partition] = _time_ns(message)
        self._note(cast('Record', message))


def _time_ns(message: Message) -> float:
    kind, time_ms = message.timestamp()
    return time_ms * 1e6 if kind else math.inf
