"""Where an entry is while it is in flight, and which steps it may make."""

from collections.abc import Mapping
from enum import Enum, auto
from typing import Final


class Stage(Enum):
    """Where an entry is that has not ended; the stage of one that has is its `Outcome`."""

    HELD = auto()
    """It is in no line: just taken, or behind what is on disk or what ends the route."""

    READY = auto()
    """It waits in its lane for the sink to take it."""

    SENT = auto()
    """The sink has it, and has not confirmed it."""

    REFUSED = auto()
    """It ends the route, and goes nowhere; what is behind it does not either."""

    STORED = auto()
    """It is on disk alone, and no longer in flight: it comes back as another entry."""


# A look into the class for each message costs ten times as much (Python 3.11).
HELD: Final = Stage.HELD
READY: Final = Stage.READY
SENT: Final = Stage.SENT
REFUSED: Final = Stage.REFUSED
STORED: Final = Stage.STORED

STEPS: Final[Mapping[Stage, frozenset[Stage]]] = {
    HELD: frozenset({READY, REFUSED, STORED}),
    READY: frozenset({HELD, SENT, STORED}),
    SENT: frozenset({HELD, READY, REFUSED, STORED}),
    REFUSED: frozenset({STORED}),
    STORED: frozenset(),
}
"""What may follow a stage. All but `STORED` may be followed by an outcome, which nothing follows.

One that is sent is ready again where it may not have arrived: a reader has gone, or a broker has
not taken it. One that is ready is held again where it has to wait on disk, or behind what ends
the route.
"""
