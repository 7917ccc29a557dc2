"""How far a reader is behind the ends of its partitions."""

import contextlib
import time
from typing import Final

from confluent_kafka import Consumer, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.partition import Partition

_EVERY_S: Final = 5.0
_FIRST_S: Final = 2.0  # mostly, reading has told by then
_LOOK_S: Final = 0.2


class Lag:
    """Counts what a reader has not read yet, also while it reads nothing.

    Args:
        offsets: Of the partitions that it has.
    """

    def __init__(self, offsets: Offsets) -> None:
        self._offsets = offsets
        self._look_at_s = time.monotonic() + _FIRST_S

    def count(self, client: Consumer, *, ask: bool) -> int | None:
        """How many records of the partitions come behind what has ended.

        Also those that a transaction without an end still holds back. None where it is not known
        of a partition how far it was read, or where it ends.

        Args:
            client: Of the reader.
            ask: Whether to ask the broker where partitions end, every few seconds: a client that
                does not read hears of it in no other way.
        """
        if ask or any(partition.next is None for partition in self._offsets):
            self._look(client, ends=ask)
        total = 0
        for partition in self._offsets:
            _, end = client.get_watermark_offsets(self._topic_partition(partition), cached=True)
            end = max(end, -1 if partition.told_end is None else partition.told_end)
            if end < 0 or partition.next is None:
                return None
            total += max(0, end - partition.next)
        return total

    def _look(self, client: Consumer, *, ends: bool) -> None:
        """Ask for what reading has not told: committed offsets, and `ends` if nothing is read.

        While something is, a question for ends would wait behind it.
        """
        now_s = time.monotonic()
        if now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _EVERY_S
        here = self._offsets
        unread = [self._topic_partition(partition) for partition in here if partition.next is None]
        with contextlib.suppress(KafkaException):  # the broker does not answer: the last ones hold
            if unread:
                told = client.committed(unread, timeout=_LOOK_S)
                here.note_committed({p.partition: p.offset for p in told if p.offset >= 0})
            for partition in here if ends else ():
                _, partition.told_end = client.get_watermark_offsets(
                    self._topic_partition(partition), timeout=_LOOK_S
                )

    def _topic_partition(self, partition: Partition) -> TopicPartition:
        return TopicPartition(self._offsets.topic, partition.number)
