"""What a process did, written so that it can be read after a SIGKILL, and while it goes on.

A line is a mark, the time in nanoseconds since 1970, and a number. Each is written before the
next thing is done, in one piece: what a killed process had written is whole.
"""

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

BEGUN: Final = 'begun'
SENT: Final = 'sent'
HOSTILE: Final = 'hostile'
ACKNOWLEDGED: Final = 'acked'
ARRIVED: Final = 'arrived'
STRANGE: Final = 'strange'


class Entry(NamedTuple):
    """One line.

    Args:
        mark: `begun` (of a process), `sent` (is about to be handed over), `hostile` (the same,
            and it is no good order), `acked` (all up to the number), `arrived`, or `strange`
            (arrived, and is no order).
    """

    mark: str
    time_ns: int
    number: int


class Journal:
    """A file to add lines to."""

    def __init__(self, file: Path) -> None:
        self._file = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)

    def write(self, mark: str, number: int) -> None:
        """Add a line."""
        os.write(self._file, b'%s %d %d\n' % (mark.encode(), time.time_ns(), number))


class Tail:
    """Reads what is added to a journal."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._place = 0

    def __call__(self) -> list[Entry]:
        """The lines since the last call."""
        if not self._file.exists():
            return []
        with self._file.open('rb') as file:
            file.seek(self._place)
            data = file.read()
        whole = data[: data.rfind(b'\n') + 1]
        self._place += len(whole)
        return list(_entries(whole))


def read(file: Path) -> list[Entry]:
    """All lines of a journal."""
    return Tail(file)()


def _entries(data: bytes) -> Iterator[Entry]:
    for line in data.decode().splitlines():
        mark, time_ns, number = line.split()
        yield Entry(mark, int(time_ns), int(number))


def uncounted(entries: Sequence[Entry], *, is_from_kafka: bool) -> set[int]:
    """The orders that nobody had taken from a sender when it ended.

    A publisher that is killed takes with it what was not acknowledged; only its own end makes
    them uncounted, hence the last one that runs counts in full.
    """
    if is_from_kafka:
        return set()
    found: set[int] = set()
    of_life: list[int] = []
    for entry in entries:
        if entry.mark == BEGUN:
            found |= set(of_life)
            of_life = []
        elif entry.mark == ACKNOWLEDGED:
            of_life = [number for number in of_life if number > entry.number]
        else:
            of_life.append(entry.number)
    return found
