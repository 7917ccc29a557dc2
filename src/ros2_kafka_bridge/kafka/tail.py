"""The end of a topic, read backwards step by step."""

import logging
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, cast

from confluent_kafka import Consumer, KafkaException, Message

from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.errors import Client, is_missing_topic, translated
from ros2_kafka_bridge.kafka.ranges import BOUNDS, Place, RangeReader, held, opened
from ros2_kafka_bridge.kafka.topics import partitions_of

# The caller is the thread of a route: while it waits here nothing is taken from ROS.
_REQUEST_S: Final = 2.0

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
        self._properties = {**properties, **BOUNDS}
        self._about = Client('READ', properties)
        self._starts: dict[Place, _Start] = {}

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
        where = f'topic {self.topic}'
        log = logging.getLogger(f'{__name__}.librdkafka')
        cannot = f'{where} cannot be read, to skip what it holds from before a restart'
        with translated(cannot, self._about), opened(self._properties, where, log) as consumer:
            there = self._held(consumer)
            ranges = {place: self._before(place, there[place])[-records:] for place in there}
            times_ns = self._read(consumer, ranges, within_s, note)
        for place, offsets in ranges.items():
            time_ns = times_ns.get(place[1], math.inf)
            self._starts[place] = _Start(offsets.start, there[place].start, time_ns)

    def _held(self, consumer: Consumer) -> dict[Place, range]:
        """What the topic holds: nothing where it is not there yet."""
        try:
            numbers = partitions_of(consumer, self.topic, _REQUEST_S)
        except KafkaException as error:
            if not is_missing_topic(error.args[0]):
                raise
            return {}
        return held(consumer, self.topic, _REQUEST_S, numbers)

    def _before(self, place: Place, there: range) -> range:
        """What a partition holds before what was read."""
        end = self._starts[place].offset if place in self._starts else there.stop
        return range(there.start, max(there.start, end))

    def _read(
        self, consumer: Consumer, ranges: Mapping[Place, range], within_s: float, note: Note
    ) -> dict[int, float]:
        """Read them as far as there is time; returns the time of the first in each partition."""
        deadline_s = time.monotonic() + within_s
        reader = RangeReader(consumer, ranges, stopped=lambda: time.monotonic() > deadline_s)
        times_ns: dict[int, float] = {}
        records = 0
        for message in reader:
            records += 1
            times_ns.setdefault(message.partition() or 0, _time_ns(message))
            note(cast('Record', message))
        if reader.left:
            if reader.silence_s > within_s / 2:
                raise TransportError(f'topic {self.topic}: its end cannot be read in time')
            self.is_cut = True
        self.records += records
        return times_ns


def _time_ns(message: Message) -> float:
    kind, time_ms = message.timestamp()
    return time_ms * 1e6 if kind else math.inf
