"""Why nothing is read of partitions that hold more, though Kafka answers: it holds it back."""

import time
from collections.abc import Mapping
from itertools import starmap
from typing import Final, NamedTuple

from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.statistics import PartitionEnds
from ros2_kafka_bridge.logs.text import clock_time

_SAID_AFTER_S: Final = 10.0  # a transaction that takes as long is worth a word
_HANGS_AFTER_S: Final = 960.0  # a broker allows 15 minutes by default (transaction.max.timeout.ms)
_HANGS: Final = (
    'its producer hangs: end that, or abort the transaction (kafka-transactions.sh find-hanging, '
    'abort)'
)
_THROTTLE_S: Final = 5.0  # a quota that makes a client wait for so long is, too
_BETWEEN_S: Final = 5.0  # the next answer tells whether it goes on
_QUOTA: Final = (
    'a quota of the broker lets this client wait for many seconds at a time: raise its '
    'consumer_byte_rate, or nothing is read where a batch of records is larger than what it may '
    'read in ten seconds'
)


class _Since(NamedTuple):
    """When something was seen first, by the monotonic clock and by the one of the log."""

    at_s: float
    clock: str


def _now() -> _Since:
    return _Since(time.monotonic(), clock_time())


class HeldBack:
    """Notices what a reader is not given: for a quota, a transaction, or a leader that is away.

    Args:
        offsets: Of the partitions that it has.
    """

    def __init__(self, offsets: Offsets) -> None:
        self._offsets = offsets
        self._since: dict[tuple[int, int | None], _Since] = {}  # by partition and first offset
        self._throttled_until_s = 0.0

    def on_throttle(self, seconds: float) -> None:
        """Note for how long the broker lets the client wait (librdkafka's throttle callback)."""
        if seconds >= _THROTTLE_S:
            self._throttled_until_s = time.monotonic() + seconds + _BETWEEN_S

    def on_ends(self, ends: Mapping[int, PartitionEnds]) -> None:
        """Note where partitions that are fetched ended last, and whether they are led."""
        before = self._since
        held = [(number, told.stable) for number, told in ends.items() if told.is_open]
        unled = [(number, None) for number, told in ends.items() if not told.is_led]
        here = [place for place in (*held, *unled) if place[0] in self._offsets]
        self._since = {place: before.get(place) or _now() for place in here}

    @property
    def is_throttled(self) -> bool:
        """Whether the broker lets the client wait: a question now would be in vain, too."""
        return time.monotonic() < self._throttled_until_s

    @property
    def hides_ends(self) -> bool:
        """Whether it is not known where partitions end now."""
        return self.is_throttled or any(offset is None for _, offset in self._since)

    @property
    def reason(self) -> str:
        """Why nothing is read; empty where nothing is held back, or not for long."""
        if self.is_throttled:
            return _QUOTA
        return next(filter(None, starmap(self._reason_of, self._since.items())), '')

    def _reason_of(self, place: tuple[int, int | None], since: _Since) -> str:
        number, offset = place
        for_s = time.monotonic() - since.at_s
        if for_s < _SAID_AFTER_S:
            return ''
        where = f'{self._offsets.topic}[{number}]'
        if offset is None:
            return (
                f'{where}: the broker that leads it does not answer, since {since.clock}: does it '
                'run, and is its advertised.listeners right?'
            )
        partition = self._offsets.get(number)
        if partition is None or partition.reached is None or partition.reached < offset:
            return ''
        wait = f'{where}: waits from offset {offset} on for the end of a transaction'
        text = f'{wait}, seen open since {since.clock}'
        if for_s < _HANGS_AFTER_S:
            return f'{text} (Flink, for one, ends its own at checkpoints)'
        return f'{text}: {_HANGS}'
