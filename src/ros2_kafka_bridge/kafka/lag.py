"""How far a reader is behind the ends of its partitions."""

import contextlib
import time
from collections.abc import Mapping
from typing import Final

from confluent_kafka import Consumer, KafkaException, TopicPartition

_ENDS_EVERY_S: Final = 5.0
_LOOK_S: Final = 0.2


class Lag:
    """Counts what a reader has not read yet, also while it reads nothing."""

    def __init__(self) -> None:
        self._ends_look_at_s = 0.0
        self._known_ends: dict[int, int] = {}  # of the partitions, while they are held
        self._begins: dict[int, int] = {}  # of the partitions that nothing was read from yet

    def count(self, client: Consumer, positions: Mapping[int, int], *, ask: bool) -> int:
        """How many records of the assigned partitions come behind `positions`.

        Args:
            client: Of the reader.
            positions: The next offset to read of each partition.
            ask: Whether to ask the broker where partitions end, every few seconds: a client that
                is held hears of it in no other way.
        """
        assigned = client.assignment()
        if ask:
            self._look_for_ends(client, assigned, positions)
        total = 0
        for partition in assigned:
            _, end = client.get_watermark_offsets(partition, cached=True)
            number = partition.partition
            end = max(end, self._known_ends.get(number, -1))
            position = positions.get(number, self._begins.get(number))
            if end >= 0 and position is not None:
                total += max(0, end - position)
        return total

    def _look_for_ends(
        self, client: Consumer, assigned: list[TopicPartition], positions: Mapping[int, int]
    ) -> None:
        now_s = time.monotonic()
        if now_s < self._ends_look_at_s:
            return
        self._ends_look_at_s = now_s + _ENDS_EVERY_S
        unread = [place for place in assigned if place.partition not in positions]
        with contextlib.suppress(KafkaException):  # the broker does not answer: the last ones hold
            if unread:
                begins = client.committed(unread, timeout=_LOOK_S)
                self._begins = {p.partition: p.offset for p in begins if p.offset >= 0}
            for partition in assigned:
                _, end = client.get_watermark_offsets(partition, timeout=_LOOK_S)
                self._known_ends[partition.partition] = end

    def forget(self, partition: int) -> None:
        """Note that another reads this partition now."""
        self._known_ends.pop(partition, None)

    def clear(self) -> None:
        """Forget all partitions."""
        self._known_ends.clear()
        self._begins.clear()
