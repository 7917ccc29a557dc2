"""Middlewares as others may be, and the readers that a bridge tries them by."""

from pathlib import Path
from typing import Any

from preloads import library


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
