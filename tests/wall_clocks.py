"""A clock of the day that a test sets, for the processes that it says (peers/wall_clock.c)."""

import struct
from pathlib import Path

from preloads import library


class WallClock:
    """How far the clock of the day is ahead; the clocks that only go on are as they are.

    Args:
        place: Where its files go.
    """

    def __init__(self, place: Path) -> None:
        self._file = place / 'wall_clock'
        self._file.write_bytes(bytes(8))
        self.environ = {'LD_PRELOAD': library('wall_clock', place), 'WALL_CLOCK': str(self._file)}

    def set_ahead(self, seconds: float) -> None:
        """Set it, for all that run with `environ`, in this moment."""
        with self._file.open('r+b', buffering=0) as file:
            file.write(struct.pack('<q', int(seconds * 1e9)))
