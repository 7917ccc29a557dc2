"""What stands for ROS where a backlog alone is delivered: another bridge reads the topic."""

import time
from collections.abc import Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import Matches, Message

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


def encode_nothing(_cdr: bytes) -> bytes:
    """Encode none of its messages."""
    raise AssertionError('nothing is taken')
