"""Where a partition begins that has nothing at the offset wanted: never read, cut off, or anew."""

from typing import NamedTuple

from confluent_kafka import OFFSET_BEGINNING, Consumer, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import About
from ros2_kafka_bridge.kafka.offsets import Offsets, committed_of
from ros2_kafka_bridge.kafka.partition import Partition
from ros2_kafka_bridge.kafka.topics import partitions_of
from ros2_kafka_bridge.logs.lines import Log, summed
from ros2_kafka_bridge.logs.text import count

_REQUEST_S = 10.0


class Beginning(NamedTuple):
    """Where to read on.

    Args:
        offset: Of the next record, or OFFSET_BEGINNING.
        anew: Whether nothing counts that is known of what was there before.
    """

    offset: int
    anew: bool = False


class Beginnings:
    """Finds where the partitions of a topic begin, and counts what was gone before it was read.

    Args:
        start: `latest` or `earliest`: where a topic begins that the group never read.
        offsets: Of the topic.
        log: Where to say what happens.
    """

    def __init__(self, start: str, offsets: Offsets, log: Log) -> None:
        self.lost = 0
        self._counted: dict[int, range] = {}  # the last of what is in `lost`, also of earlier runs
        self._topic = offsets.topic
        self._start = start
        self._offsets = offsets
        self._log = log
        self._occasional = summed(log)

    def expect_new_topic(self) -> None:
        """Note that the topic is gone: once it is there again, all that it holds is new."""
        self._start = 'earliest'
        self._counted.clear()

    def find(self, client: Consumer, partition: Partition, wanted: int | None) -> Beginning:
        """Find where to read on.

        Args:
            client: Whom to ask.
            partition: Where it stands.
            wanted: The offset that is not there; None where the group has none.

        Raises:
            KafkaException: The broker does not answer, or refuses.
        """
        if wanted is not None and wanted < self._bounds(client, partition.number)[0]:
            return _cut_off(partition, wanted)
        everywhere = self._everywhere(client)
        committed = committed_of(client.committed(everywhere, timeout=_REQUEST_S))
        if not committed and partition.next is None:
            return Beginning(self._first_start(client, everywhere)[partition.number])
        low, high = self._bounds(client, partition.number)
        if (told := committed.get(partition.number)) is not None:
            return self._at_committed(partition, told.offset, low, high)
        if partition.next is not None:  # the offsets of the group went with the topic
            self._say_not_there(partition, max(partition.next, high + 1), low, high)
            return Beginning(low, anew=True)
        if high > low:
            self._say_without_offset(partition.number, high - low)
        return Beginning(low)

    def on_reached(self, client: Consumer, partition: Partition, offset: int) -> None:
        """Note the first offset, of a record or of the end, that is there behind a gap."""
        wanted, partition.wanted = partition.wanted, None
        if wanted is None or offset <= wanted:
            return
        try:
            low, _ = self._bounds(client, partition.number)
        except KafkaException:
            low = offset
        # Behind the beginning there may be gaps of another kind: marks and compacted records.
        self._count(partition.number, range(wanted, min(low, offset)))

    def _everywhere(self, client: Consumer) -> list[TopicPartition]:
        numbers = partitions_of(client, self._topic, _REQUEST_S)
        return [TopicPartition(self._topic, number) for number in numbers]

    def _bounds(self, client: Consumer, number: int) -> tuple[int, int]:
        return client.get_watermark_offsets(
            TopicPartition(self._topic, number), timeout=_REQUEST_S
        )

    def _first_start(self, client: Consumer, everywhere: list[TopicPartition]) -> dict[int, int]:
        """Resolve `start` once, for every partition, and commit it at once.

        Also for partitions that others read: seen from them, a partition without an offset among
        others with one has appeared later, and is read from its beginning.
        """
        bounds = {p.partition: self._bounds(client, p.partition) for p in everywhere}
        is_latest = self._start == 'latest'
        offsets = {number: high if is_latest else low for number, (low, high) in bounds.items()}
        self._offsets.commit_within(_REQUEST_S, offsets)
        passed = sum(high - low for low, high in bounds.values()) if is_latest else 0
        self._say_begun(passed)
        return offsets

    def _say_begun(self, passed: int) -> None:
        """Say where the group begins, and how many records it does not read."""
        begins = f'first start of this group: begins at the {self._start} record'
        if not passed:
            self._log.info('%s', begins)
            return
        self._log.warning(
            '%s, and does not read the %s that %s holds: if it was here before, its offsets have '
            'expired (offsets.retention.minutes) or were deleted; kafka-consumer-groups.sh '
            '--reset-offsets sets it back, while the bridge is stopped',
            begins, count(passed, 'record'), self._topic,
        )  # fmt: skip

    def _say_without_offset(self, number: int, held: int) -> None:
        self._log.warning(
            '%s[%d]: the group has no offset here, though it has of other partitions: begins with '
            'the first of %s; the partition was added, or its offset has expired '
            '(offsets.retention.minutes)',
            self._topic, number, count(held, 'record'),
        )  # fmt: skip

    def _at_committed(
        self, partition: Partition, committed: int, low: int, high: int
    ) -> Beginning:
        if committed < low:
            return _cut_off(partition, committed)
        if committed <= high:
            return Beginning(committed)  # meanwhile, at the first start of the group
        self._say_not_there(partition, committed, low, high)
        return Beginning(low, anew=True)

    def _count(self, number: int, missing: range) -> None:
        # A route that fails before it has committed meets the same gap again.
        before = self._counted.get(number, range(0))
        again = range(max(missing.start, before.start), min(missing.stop, before.stop))
        news = len(missing) - len(again)
        if not news:
            return
        self.lost += news
        first = min(missing.start, before.start) if again else missing.start
        self._counted[number] = range(first, missing.stop)
        self._occasional.error(
            f'{self._topic}[{number}]: {news} records were deleted before the bridge read them '
            f'(offsets {missing.start} to {missing.stop - 1}); it goes on at {missing.stop}: keep '
            'the topic longer than the bridge can be away (retention.ms, retention.bytes)',
            about=About(self._topic, number, missing.start),
        )

    def _say_not_there(self, partition: Partition, wanted: int, low: int, high: int) -> None:
        number, partition.wanted = partition.number, None
        self._counted.pop(number, None)
        self._log.error(
            '%s[%d]: offset %d is not there, the topic holds %d to %d: it was made anew or '
            'cut off; the bridge reads all that it holds now',
            self._topic, number, wanted, low, high - 1,
            extra={'about': About(self._topic, number, wanted)},
        )  # fmt: skip


def _cut_off(partition: Partition, wanted: int) -> Beginning:
    # An offset would be gone again where the broker deletes faster than it can be asked for
    # and fetched: so the client itself looks for it, each time that it fetches.
    partition.wanted = wanted if partition.wanted is None else min(wanted, partition.wanted)
    return Beginning(OFFSET_BEGINNING)
