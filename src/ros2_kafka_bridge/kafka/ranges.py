"""Ranges of offsets, read once, each of one partition; nothing is committed."""

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from typing import Any, Final

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.errors import explain
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topics import partitions_of

_WAIT_S: Final = 0.05

READING: Final = {
    'enable.partition.eof': True,
    'auto.offset.reset': 'earliest',  # what is deleted while it is read is gone
}
"""Properties that a `RangeReader` needs its consumer to have."""

# The client bounds a fetch as it is packed, not what it becomes: with its own settings 4,000
# records with headers of 900 kB, which zstd packs well, took 3.5 GB; with these 0.5 GB, however
# many there are.
BOUNDS: Final = {'max.partition.fetch.bytes': 65_536, 'queued.min.messages': 200}
"""Properties of a consumer that reads what strangers may have written."""

BATCH: Final = 50
"""How many records to take at once: the headers of all are unpacked then, see `route.pieces`."""

Place = tuple[str, int]
"""A topic, and the number of a partition of it."""


class RangeReader:
    """Reads a range of offsets of each partition; iterate for the records, in order in each.

    What is no record (gaps, marks of transactions) is passed over, and what a client still hands
    out of an earlier assignment. Iterated again, it goes on where it was.

    Args:
        consumer: With the properties `READING`, used by nobody else meanwhile; what it is assigned
            is replaced, and afterwards undefined.
        ranges: The offsets, by topic and partition.
        silent_s: It ends where nothing new comes for so long.
        stopped: It ends where this says so; asked some times in a second.
        batch: How many records are taken from the client at once.
        waits: Whether to wait at the end of a partition that is before the end of its range;
            else nothing more of that is read.

    `left` has, for each partition that is not through, where it would go on; `early_ends` where
    partitions have ended before their ranges.
    """

    def __init__(
        self,
        consumer: Consumer,
        ranges: Mapping[Place, range],
        *,
        silent_s: float = math.inf,
        stopped: Callable[[], bool] = lambda: False,
        batch: int = BATCH,
        waits: bool = False,
    ) -> None:
        self.left = {place: offsets.start for place, offsets in ranges.items() if offsets}
        self.early_ends: dict[Place, int] = {}
        self._consumer = consumer
        self._ends = {place: offsets.stop for place, offsets in ranges.items()}
        self._silent_s = silent_s
        self._stopped = stopped
        self._batch = batch
        self._waits = waits
        self._heard_at_s = time.monotonic()

    @property
    def silence_s(self) -> float:
        """For how long nothing new has come."""
        return time.monotonic() - self._heard_at_s

    def __iter__(self) -> Iterator[Message]:
        """Read what is left.

        Raises:
            KafkaException: The client tells an error that does not pass by itself.
        """
        starts = [TopicPartition(*place, offset) for place, offset in self.left.items()]
        if starts:
            self._consumer.assign(starts)
        while self.left and not self._stopped() and self.silence_s <= self._silent_s:
            batch = self._consumer.consume(self._batch, _WAIT_S)
            batch.reverse()
            while batch:  # what was looked at is let go: it may be a megabyte
                message = batch.pop()
                if self._take(message):
                    yield message
                    self._heard_at_s = time.monotonic()  # whoever takes it may take a while

    def _take(self, message: Message) -> bool:
        """Note how far its partition has come; tells whether it is a record of the range."""
        error = message.error()
        if error is not None and error.code() != KafkaError._PARTITION_EOF:  # noqa: SLF001 (its public name)
            if not issubclass(explain(error).kind, TransportError):
                raise KafkaException(error)
            return False
        place, offset = (message.topic() or '', message.partition() or 0), message.offset() or 0
        if place not in self.left:
            return False
        end, is_record = self._ends[place], error is None
        if not is_record and not self._waits:
            if offset < end:
                self.early_ends[place] = offset
            self._reach(place, end)
        elif offset >= self.left[place]:
            self._reach(place, offset + is_record)
            return is_record and offset < end
        return False

    def _reach(self, place: Place, offset: int) -> None:
        """Go on at that offset, or let go of a partition that is through."""
        if offset < self._ends[place]:
            self.left[place] = offset
            return
        del self.left[place]
        self._heard_at_s = time.monotonic()
        if self.left:  # not paused: it would stay so when it is assigned anew
            self._consumer.incremental_unassign([TopicPartition(*place)])


def held(
    client: Consumer, topic: str, within_s: float, numbers: Iterable[int] | None = None
) -> dict[Place, range]:
    """Ask which offsets partitions hold, up to the first transaction that has not ended.

    Args:
        client: With `isolation.level` read_committed, librdkafka's own default.
        topic: Its name.
        within_s: How long each question may take.
        numbers: Of the partitions; None for all.

    Raises:
        KafkaException: The broker does not answer, or tells an error instead.
    """
    offsets = {}
    for number in partitions_of(client, topic, within_s) if numbers is None else numbers:
        here = TopicPartition(topic, number)
        offsets[topic, number] = range(*client.get_watermark_offsets(here, timeout=within_s))
    return offsets


@contextmanager
def opened(properties: Mapping[str, Any], where: str, log: logging.Logger) -> Iterator[Consumer]:
    """A consumer to read ranges with, closed at the end; `where` names it in errors.

    Raises:
        RouteError: A file that its properties name cannot be read.
    """
    check_files(properties, where)
    with closing(Consumer({**properties, **READING}, logger=log)) as consumer:
        yield consumer
