"""Reading dead-letter topics; nothing is committed."""

import math
import time
from collections import OrderedDict
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Final, NamedTuple, Self, cast

from confluent_kafka import Consumer, TopicPartition

from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark, parse
from ros2_kafka_bridge.endpoints import Record, headers_of
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.errors import Client, is_missing_topic, translate, translated
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview
from ros2_kafka_bridge.kafka.ranges import BATCH, BOUNDS, RangeReader, held, opened
from ros2_kafka_bridge.logs.lines import client_log

_REQUEST_S: Final = 5.0
_SILENT_S: Final = 20.0
_AHEAD: Final = 1000
_AHEAD_BYTES: Final = 1_000_000
_FEW: Final = 10  # in one batch, where they may be large
_MOST_PARTS: Final = 16
_OWN: Final = {
    'isolation.level': 'read_committed',
    'allow.auto.create.topics': False,
    'fetch.wait.max.ms': 10,  # each question waits behind the fetch that is on its way
    'queued.max.messages.kbytes': 16_384,
    **BOUNDS,
}


class LetterReader:
    """Reads dead-letter topics, and the records that letters come from.

    Args:
        properties: librdkafka properties of a consumer.
        overview: The same cluster, for what a consumer cannot ask.

    `partitions` has the topics that are there, as far as the broker has told; `unseen` from where
    on a partition was not read to its end, because a transaction there has not ended; `cut` from
    where on `newest` has read nothing, because its time was up.
    """

    def __init__(self, properties: Mapping[str, Any], overview: Overview) -> None:
        self._properties = {**properties, **_OWN}
        self._overview = overview
        self._consumer: Consumer | None = None
        self._opened = ExitStack()
        self._about = Client('READ', properties)
        self.partitions: dict[str, int] = {}
        self.unseen: dict[tuple[str, int], LetterPlace] = {}
        self.cut: LetterPlace | None = None

    def __enter__(self) -> Self:
        """Look which topics there are.

        Raises:
            TransportError: No broker answers.
            RouteError: This user is not let in.
        """
        seen = self._overview.topics()
        self.partitions = {topic.name: topic.partitions for topic in seen if not topic.problem}
        client = opened(self._properties, 'the Kafka client', client_log(__name__))
        self._consumer = self._opened.enter_context(client)
        return self

    def __exit__(self, *_: object) -> None:
        self._consumer = None
        self._opened.close()

    def has(self, topic: str) -> bool:
        """Whether the topic is there.

        Raises:
            TransportError: The broker cannot tell just now.
            RouteError: This user may not see it.
        """
        if topic in self.partitions:
            return True
        with translated(f'topic {topic}', self._about):
            found = self._client.list_topics(topic, timeout=_REQUEST_S).topics[topic]
        if found.error is None:
            self.partitions[topic] = len(found.partitions)
        elif not is_missing_topic(found.error):
            raise translate(found.error, f'topic {topic}', self._about)
        return found.error is None

    def letters(
        self, topic: str, since_ms: int | None = None, *, whole: bool = False
    ) -> Iterator[Letter | Mark]:
        """Read a dead-letter topic, partition by partition, to the end that it has now.

        Args:
            topic: Its name.
            since_ms: Leaves out most of what is older.
            whole: Insists on everything that is there now, also behind a transaction that another
                client has not ended: for whoever must know each mark.

        Raises:
            TransportError: The broker is away, or such a transaction does not end.
            RouteError: The topic may not be read.
        """
        for partition, end in enumerate(self._ends(topic)):
            offsets = range(self._begin(topic, partition, since_ms), end)
            for message in self._read(topic, partition, offsets, whole=whole):
                yield parse(topic, message)

    def newest(self, topic: str, most: int, deadline_s: float) -> Iterator[Letter | Mark]:
        """Read the last offsets of a dead-letter topic, at most so many of each partition.

        What is not read by `deadline_s` (of the monotonic clock) is left out, from `cut` on.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read.
        """
        for partition, end in enumerate(self._ends(topic)):
            offsets = range(self._held(topic, partition)[-most:].start, end)
            for message in self._read(topic, partition, offsets, batch=_FEW, until_s=deadline_s):
                yield parse(topic, message)
            if self.cut:
                return

    def fetch(self, topic: str, partition: int, offsets: Collection[int]) -> Iterator[Letter]:
        """Read these letters whole, in order; those that are gone are left out."""
        wanted = set(offsets)
        if not wanted:
            return
        for message in self._read(topic, partition, range(min(wanted), max(wanted) + 1)):
            if message.offset() in wanted:
                letter = parse(topic, message)
                if isinstance(letter, Letter):
                    yield letter

    def bounds(self, topic: str, partition: int, offset: int) -> range:
        """The offsets that a partition of a topic holds now; empty where there is none.

        Where it seems not to reach to `offset`, what a transaction has written that is not ended
        counts, too.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read, or even seen.
        """
        if topic not in self.partitions:
            raise RouteError(f'topic {topic}: is not there, or this user may not see it')
        if partition >= self.partitions[topic]:
            return range(0)
        there = self._held(topic, partition)
        if offset < there.stop:
            return there
        ends = self._overview.ends([KafkaTopic(topic, self.partitions[topic], '')])
        return range(there.start, max(there.stop, ends.get((topic, partition)) or 0))

    def records(self, topic: str, partition: int, offsets: range) -> Iterator[Record]:
        """Read what is left of the records of a partition at these offsets, which it holds.

        Raises:
            TransportError: The broker is away.
            RouteError: The topic may not be read.
        """
        return self._read(topic, partition, offsets, batch=_FEW)

    @property
    def _client(self) -> Consumer:
        assert self._consumer is not None, 'the reader is open'
        return self._consumer

    def _ends(self, topic: str) -> list[int]:
        """The end of each partition, behind what transactions have written that have not ended."""
        ends = self._overview.ends([KafkaTopic(topic, self.partitions[topic], '')])
        for partition in range(self.partitions[topic]):
            if (topic, partition) not in ends:
                raise TransportError(f'{topic}[{partition}]: the broker does not tell its end')
        return [ends[topic, partition] for partition in range(self.partitions[topic])]

    def _held(self, topic: str, partition: int) -> range:
        """From the first offset to that before which every transaction has ended."""
        with self._translated(topic):
            return held(self._client, topic, _REQUEST_S, [partition])[topic, partition]

    def _begin(self, topic: str, partition: int, since_ms: int | None) -> int:
        """Where to begin: where nothing is as young, behind what can be seen."""
        there = self._held(topic, partition)
        if since_ms is None:
            return there.start
        asked = TopicPartition(topic, partition, since_ms)
        with self._translated(topic):
            [found] = self._client.offsets_for_times([asked], timeout=_REQUEST_S)
        return max(there.start, found.offset) if found.offset >= 0 else there.stop

    def _read(
        self,
        topic: str,
        partition: int,
        offsets: range,
        *,
        whole: bool = False,
        batch: int = BATCH,
        until_s: float = math.inf,
    ) -> Iterator[Record]:
        """The records at these offsets, as far as they are committed."""
        place = (topic, partition)
        reader = RangeReader(
            self._client,
            {place: offsets},
            silent_s=_SILENT_S,
            stopped=lambda: time.monotonic() > until_s,
            batch=batch,
            waits=whole,
        )
        with translated(f'topic {topic}', self._about):
            # The stubs do not tell that headers are a list; they are.
            yield from cast('Iterator[Record]', iter(reader))
        if place in reader.early_ends:
            self.unseen[place] = LetterPlace(*place, reader.early_ends[place])
        if place not in reader.left:
            return
        if reader.silence_s > _SILENT_S:
            raise TransportError(
                f'{topic}[{partition}] cannot be read behind {reader.left[place]}: the broker is '
                'away, or another client has not ended its transaction there; try again in a '
                'minute'
            )
        self.cut = LetterPlace(*place, reader.left[place])

    def _translated(self, topic: str) -> AbstractContextManager[None]:
        return translated(f'topic {topic} cannot be read', self._about)


class Original(NamedTuple):
    """What is at the place that a letter tells of.

    Args:
        record: What is there; None where it is gone, and where this user may not look.
        was_there: Whether there can have been one: the partition reaches so far.
    """

    record: Record | None
    was_there: bool = True


class Originals:
    """The records that letters tell of, some read ahead: letters of a partition come in order.

    Args:
        reader: Opened, and read with by nobody else meanwhile.
    """

    def __init__(self, reader: LetterReader) -> None:
        self._reader = reader
        self._ahead: OrderedDict[tuple[str, int], _Ahead] = OrderedDict()  # by partition

    def fetch(self, topic: str, partition: int, offset: int) -> Original:
        """Look at one place.

        Raises:
            TransportError: The broker is away.
        """
        ahead = self._ahead.pop((topic, partition), None)
        if ahead is None or offset not in ahead.offsets:
            try:
                ahead = self._read(topic, partition, offset)
            except RouteError:
                return Original(None)
        self._ahead[topic, partition] = ahead
        if len(self._ahead) > _MOST_PARTS:
            self._ahead.popitem(last=False)
        return Original(ahead.records.get(offset), offset in ahead.offsets)

    def _read(self, topic: str, partition: int, offset: int) -> '_Ahead':
        there = self._reader.bounds(topic, partition, offset)
        if offset < there.start:
            return _Ahead(range(offset, there.start), {})
        found: dict[int, Record] = {}
        size_bytes, offsets = 0, range(offset, min(offset + _AHEAD, there.stop))
        for record in self._reader.records(topic, partition, offsets):
            at = record.offset() or 0
            found[at] = record
            size_bytes += _size_of(record)
            if size_bytes > _AHEAD_BYTES:
                return _Ahead(range(offset, at + 1), found)
        return _Ahead(offsets, found)


class _Ahead(NamedTuple):
    """What was read of a partition: all records that it has at these offsets."""

    offsets: range
    records: dict[int, Record]


def _size_of(record: Record) -> int:
    texts = (record.key(), record.value(), *(text for _, text in headers_of(record) or []))
    return sum(len(text) for text in texts if text is not None)
