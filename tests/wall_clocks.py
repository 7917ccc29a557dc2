"""A clock of the day that a test sets, for the processes that it says (peers/wall_clock.c)."""

import shutil
import struct
import subprocess
from pathlib import Path
from typing import Final

import pytest

_SOURCE: Final = Path(__file__).parent / 'peers' / 'wall_clock.c'


class WallClock:
    """How far the clock of the day is ahead; the clocks that only go on are as they are.

    Args:
        place: Where its files go.
    """

    def __init__(self, place: Path) -> None:
        compiler = shutil.which('cc')
        if compiler is None:
            pytest.skip('there is no C compiler: apt-get install gcc libc6-dev')
        library, self._file = place / 'wall_clock.so', place / 'wall_clock'
        options = ('-O2', '-shared', '-fPIC', '-ldl')
        made = subprocess.run(
            [compiler, *options, '-o', library, _SOURCE],
            capture_output=True,
            text=True,
            check=False,
        )
        assert made.returncode == 0, made.stderr
        self._file.write_bytes(bytes(8))
        self.environ = {'LD_PRELOAD': str(library), 'WALL_CLOCK': str(self._file)}

    def set_ahead(self, seconds: float) -> None:
        """Set it, for all that run with `environ`, in this moment."""
        with self._file.open('r+b', buffering=0) as file:
            file.write(struct.pack('<q', int(seconds * 1e9)))
