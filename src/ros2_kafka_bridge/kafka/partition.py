"""Where one partition of a topic stands in its group."""

from dataclasses import dataclass
from typing import NamedTuple

from ros2_kafka_bridge.kafka.topic_id import TopicId


class Committed(NamedTuple):
    """What a group has got of a partition.

    Args:
        offset: Of the next record to read.
        of: The topic that it is of; None where whoever has committed it did not say so.
    """

    offset: int
    of: TopicId | None


@dataclass(slots=True)
class Partition:
    """Where one partition stands. All are offsets; None where that is not known.

    Args:
        number: Of the partition in its topic.
        committed: What the group has, as it has told or been told.
        position: Of the next record to read, were the route to begin again: all before it in
            the order of consumption have ended.
        read: Behind the last record that was handed out.
        end: There is nothing left to read before it. Marks of transactions have offsets, too, and
            are no records.
        told_end: Where it ended when the broker was asked last.
        wanted: Of the first record that was deleted before it was read, until one behind it is.
        of: The topic that these offsets are of.
    """

    number: int
    committed: int | None = None
    position: int | None = None
    read: int | None = None
    end: int | None = None
    told_end: int | None = None
    wanted: int | None = None
    of: TopicId | None = None

    @property
    def next(self) -> int | None:
        """The next record to read, as far as anybody knows."""
        return self.committed if self.position is None else self.position

    @property
    def reached(self) -> int | None:
        """How far it was read."""
        known = (self.committed, self.position, self.read, self.end)
        return max((offset for offset in known if offset is not None), default=None)

    def advance(self, position: int) -> None:
        """Note that all before `position` have ended."""
        self.position = position
        self._skip()

    def reach_end(self, end: int) -> None:
        """Note that there is nothing left before `end`.

        Where nothing was handed out yet, there was no record up to there: the group is told, or
        marks of transactions would be a lag for ever.
        """
        self.end = end
        if self.position is None:
            self.position = end
        self._skip()

    def _skip(self) -> None:
        """Move the position behind what is no record, where all that was handed out has ended.

        What was given back has not: the end lies behind that, too.
        """
        if self.end is None or self.position is None:
            return
        if self.read is None or self.read <= self.position:
            self.position = max(self.position, self.end)
