"""What keeps a route to ROS from going on, and for how long it has."""

import time
from enum import Enum, auto
from typing import Final, NamedTuple

SAID_AFTER_S: Final = 1.0
"""What passes sooner is no reason to tell anybody, or to read nothing."""

SHORTEST_NAP_S: Final = 0.0005
LONGEST_NAP_S: Final = 0.02


class Cause(Enum):
    """What has to change before an obstacle goes."""

    PACE = auto()
    """The clock: what waits may go soon."""

    HISTORY = auto()
    """A subscriber that does not take."""

    CLOCK = auto()
    """The clock of this machine: nothing can be too old, or not, before it is set."""

    OTHER = auto()


class Obstacle(NamedTuple):
    """What stands in the way.

    Args:
        reason: In words.
        cause: What has to change.
    """

    reason: str
    cause: Cause = Cause.OTHER


PACED: Final = Obstacle('max_rate', Cause.PACE)
HISTORY_FULL: Final = Obstacle('the history is full: a subscriber does not take', Cause.HISTORY)
WINDOW_FULL: Final = Obstacle('the window is full (max_in_flight_bytes)')

KAFKA_IS_SLOW: Final = 'the window is full: Kafka takes too slowly'
"""Of a route from ROS, once it is full for long."""


class Blocked:
    """How long a route has been kept from going on; its naps become longer meanwhile."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._moved_s = 0.0
        self._nap_s = SHORTEST_NAP_S

    def clear(self) -> None:
        """Note that nothing is in the way."""
        self._since_s = None
        self._nap_s = SHORTEST_NAP_S

    def move(self) -> None:
        """Note that something went, though not all: the next nap is short again."""
        self._moved_s = time.monotonic()
        self._nap_s = SHORTEST_NAP_S

    def note(self) -> None:
        """Note that something is in the way."""
        if self._since_s is None:
            self._since_s = time.monotonic()

    @property
    def for_s(self) -> float:
        """For how long something has been in the way; 0 where nothing is."""
        return 0.0 if self._since_s is None else time.monotonic() - self._since_s

    @property
    def still_for_s(self) -> float:
        """For how long nothing has gone at all: since then whoever does not take is to blame."""
        return min(self.for_s, time.monotonic() - self._moved_s)

    @property
    def is_long(self) -> bool:
        """Whether that is worth telling, and a reason to read nothing."""
        return self.for_s > SAID_AFTER_S

    def nap(self) -> None:
        """Wait for a moment, twice as long as the last time."""
        time.sleep(self._nap_s)
        self._nap_s = min(LONGEST_NAP_S, self._nap_s * 2)
