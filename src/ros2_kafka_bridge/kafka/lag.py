"""How far a reader is behind the ends of its partitions."""

import contextlib
import time
from typing import Final

from confluent_kafka import Consumer, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka.partitions import Partition, Partitions

_ENDS_EVERY_S: Final = 5.0
_LOOK_S: Final = 0.2


class Lag:
    """Counts what a reader has not read yet, also while it reads nothing.

    Args:
        topic: That it reads.
        partitions: That it has.
    """

    def __init__(self, topic: str, partitions: Partitions) -> None:
        self._topic = topic
        self._partitions = partitions
        self._ends_look_at_s = 0.0

    def count(self, client: Consumer, *, ask: bool) -> int:
        """How many records of the partitions come behind what has ended.

        Args:
            client: Of the reader.
            ask: Whether to ask the broker where partitions end, every few seconds: a client that
                does not read hears of it in no other way.
        """
        if ask:
            self._look_for_ends(client)
        total = 0
        for partition in self._partitions:
            _, end = client.get_watermark_offsets(self._topic_partition(partition), cached=True)
            end = max(end, -1 if partition.told_end is None else partition.told_end)
            if end >= 0 and partition.next is not None:
                total += max(0, end - partition.next)
        return total

    def _look_for_ends(self, client: Consumer) -> None:
        now_s = time.monotonic()
        if now_s < self._ends_look_at_s:
            return
        self._ends_look_at_s = now_s + _ENDS_EVERY_S
        here = self._partitions
        unread = [self._topic_partition(partition) for partition in here if partition.next is None]
        with contextlib.suppress(KafkaException):  # the broker does not answer: the last ones hold
            if unread:
                told = client.committed(unread, timeout=_LOOK_S)
                here.note_committed({p.partition: p.offset for p in told if p.offset >= 0})
            for partition in here:
                _, partition.told_end = client.get_watermark_offsets(
                    self._topic_partition(partition), timeout=_LOOK_S
                )

    def _topic_partition(self, partition: Partition) -> TopicPartition:
        return TopicPartition(self._topic, partition.number)
