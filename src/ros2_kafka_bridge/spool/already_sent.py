"""Whether what an earlier life has left on disk is in Kafka already.

A process that was killed may have sent some of it. The first one goes to Kafka in any case: it
shows whether that answers, because to ask while it is away takes seconds. When it has ended, the
end of the topic is read, and what is there is not sent again.
"""

from collections.abc import Iterable
from enum import Enum

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.spool.rows import Row, identity_of


class _Stage(Enum):
    OPEN = 'some may be there'
    ASKED = 'the first one is on its way, to see whether Kafka answers'
    NONE = 'those that are there are known, or there are none'


class AlreadySent:
    """What is not known of the rows that an earlier life has left.

    Args:
        in_kafka: Tells what was produced before a restart.
        counters: Of the route.
        log: Where to say what happens.
    """

    def __init__(
        self,
        in_kafka: Produced,
        counters: Counters,
        log: Log,
    ) -> None:
        self._in_kafka = in_kafka
        self._counters = counters
        self._log = log
        self._stage = _Stage.NONE
        self._ended_before = 0  # how many had ended when the first of them was loaded

    def begin(self, numbers: Iterable[tuple[bytes, int]], *, found: int) -> None:
        """Begin a run with rows on disk.

        Args:
            numbers: Publisher and number of each.
            found: How many an earlier life has left; 0 in the further runs of a life.
        """
        if found or self._stage is not _Stage.NONE:
            self._stage = _Stage.OPEN  # what was asked may have failed with the last run
            self._in_kafka.add(numbers)

    def room(self, most: int, *, asks: bool) -> int:
        """How many rows may be loaded before Kafka has said what it holds.

        Args:
            most: How many, once it has.
            asks: Whether one is on its way there.
        """
        if self._stage is _Stage.OPEN:
            return 1
        if self._stage is _Stage.ASKED:
            if self._ended == self._ended_before:
                return 0 if asks else 1
            self._look_at_end()
        return most

    def note_loaded(self) -> None:
        """Note that rows were loaded: the first of them asks."""
        if self._stage is _Stage.OPEN:
            self._stage = _Stage.ASKED
            self._ended_before = self._ended

    def settles(self, row: Row) -> bool:
        """Whether a row that an earlier life has left is in Kafka."""
        is_there = self._in_kafka.holds(identity_of(row))
        if is_there:
            self._stage = _Stage.NONE  # the end of the topic is known already
        return is_there

    @property
    def _ended(self) -> int:
        return sum(self._counters.ended.values())

    def _look_at_end(self) -> None:
        self._stage = _Stage.NONE
        try:
            self._in_kafka.look_at_end()
        except BridgeError as error:
            self._log.warning(
                '%s, so what was in flight at the end of the last run may come twice', error
            )
