"""What stands for ROS where a backlog alone is delivered: another bridge reads the topic."""

import time
from collections.abc import Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import Matches, Message
from ros2_kafka_bridge.route.labels import Conversion
from ros2_kafka_bridge.route.type_hash import check_nothing

_WAIT_S: Final = 0.1


class Silence:
    """A `MessageSource` of a topic where nothing is published."""

    lost_upstream = 0
    exhausted = True
    matches = Matches()

    def open(self) -> None:
        """Nothing is subscribed."""

    def look(self) -> None:
        """Nobody is followed."""

    def take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        """Wait for nothing, and not for long: nothing ends this wait."""
        del limit
        time.sleep(min(timeout_s, _WAIT_S))
        return ()

    def close(self) -> None:
        """Nothing is subscribed."""


def _encode_nothing(_cdr: bytes) -> bytes:
    raise AssertionError('nothing is taken')


OF_NOTHING: Final = Conversion(
    lambda: _encode_nothing, lambda _: None, lambda _: [], check_nothing
)
"""What makes records of none of its messages."""
