"""Where the entry of a window is, in both directions."""

from enum import Enum, auto


class Place(Enum):
    """Where an entry is that has not ended; it leaves its window once it has."""

    ASIDE = auto()
    """It may not go on yet: behind what is on disk, or behind what ends the route."""

    PENDING = auto()
    """It waits for the sink to take it."""

    SENT = auto()
    """The sink has it, or the dead letters have, and has not confirmed it."""

    REFUSED = auto()
    """It ends the route, and goes nowhere."""
