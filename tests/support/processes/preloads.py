"""Libraries that stand before those of a process (LD_PRELOAD), made of tests/peers/*.c."""

import shutil
import struct
from pathlib import Path
from typing import Any, Final

import pytest
from support.processes.terminal import finished

_SOURCES: Final = Path(__file__).parents[2] / 'peers'


def library(name: str, place: Path) -> str:
    """Compile a library into `place`; returns its path, for LD_PRELOAD.

    Args:
        name: Of its source, without `.c`.
        place: A directory.
    """
    compiler = shutil.which('cc')
    if compiler is None:
        pytest.skip('there is no C compiler: apt-get install gcc libc6-dev')
    made = place / f'{name}.so'
    done = finished(
        [compiler, '-O2', '-shared', '-fPIC', '-o', made, _SOURCES / f'{name}.c', '-ldl']
    )
    assert done.returncode == 0, done.stderr
    return str(made)


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


def stranger(place: Path, ways: str) -> dict[str, Any]:
    """The environment of a process whose middleware is another one (tests/peers/stranger.c).

    Args:
        place: A directory.
        ways: `lies`, `unbounded` or both.
    """
    return {'LD_PRELOAD': library('stranger', place), 'STRANGER': ways}


def tried_by(process: int) -> list[int]:
    """The readers that a process has started to try its middleware by."""
    found = []
    for status in Path('/proc').glob('[0-9]*/stat'):
        try:
            parent = int(status.read_text().rpartition(')')[2].split()[1])
            command = (status.parent / 'cmdline').read_bytes()
        except (OSError, IndexError):
            continue  # it has ended meanwhile
        if parent == process and b'trial_reader' in command:
            found.append(int(status.parent.name))
    return found
