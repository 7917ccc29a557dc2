"""Where the entry of a window is, in both directions."""

from enum import Enum, auto
from typing import Final


class Place(Enum):
    """Where an entry is that has not ended."""

    ASIDE = auto()
    """It is in no line yet: just taken, or behind what is on disk or what ends the route."""

    PENDING = auto()
    """It waits for the sink to take it."""

    SENT = auto()
    """The sink has it, or the dead letters have, and has not confirmed it."""

    REFUSED = auto()
    """It ends the route, and goes nowhere; to ROS, what is behind it does not either."""


# A look into the class for each message costs ten times as much (Python 3.11).
ASIDE: Final = Place.ASIDE
PENDING: Final = Place.PENDING
SENT: Final = Place.SENT
REFUSED: Final = Place.REFUSED
