"""Spools to be damaged, and what is asked of each that was."""

import shutil
from pathlib import Path
from typing import NamedTuple

from spools import opened, read_all, reopened, row

from ros2_kafka_bridge.spool import database
from ros2_kafka_bridge.spool.rows import Row
from ros2_kafka_bridge.spool.store import file_of


def beside(place: Path, suffix: str = '') -> Path:
    """A file of the spool in a directory."""
    file = file_of(place, 'bridge', 'route')
    return file.with_name(file.name + suffix)


def read(file: Path) -> bytes:
    return file.read_bytes() if file.exists() else b''


def overwrite(file: Path, at: int, data: bytes) -> None:
    """Write over a part of a file."""
    with file.open('r+b') as opened_file:
        opened_file.seek(at)
        opened_file.write(data)


def flip(file: Path, at: int, bits: int = 1) -> None:
    """Flip bits of a byte."""
    overwrite(file, at, bytes([file.read_bytes()[at] ^ bits]))


def zero_page(file: Path, around: bytes) -> None:
    """Let the page that holds these bytes be zeros."""
    at = file.read_bytes().index(around) // database.PAGE_BYTES * database.PAGE_BYTES
    overwrite(file, at, bytes(database.PAGE_BYTES))


def put_aside(place: Path) -> list[Path]:
    return sorted(place.glob('*.damaged-*'))


class Sample(NamedTuple):
    """A spool that is not open, and the rows in it."""

    place: Path
    rows: dict[int, Row]

    def copy(self, place: Path) -> 'Sample':
        shutil.copytree(self.place, place, dirs_exist_ok=True)
        return Sample(place, self.rows)

    def check(self) -> int:
        """Open it: what comes was written, the rest is counted. Returns how many are lost."""
        before = {suffix: read(beside(self.place, suffix)) for suffix in ('', '-wal')}
        found = reopened(self.place)
        for kept in put_aside(self.place):
            assert kept.read_bytes() == before['-wal' if kept.name.endswith('-wal') else '']
        assert all(self.rows[one.number] == one for one in found.rows)
        assert found.certain
        assert len(found.rows) + found.lost == len(self.rows)
        again = reopened(self.place)
        assert (again.rows, again.lost) == (found.rows, 0), 'repaired once'
        return found.lost


def fill(place: Path) -> dict[int, Row]:
    """Small rows and some of several pages, some released, some dropped, some free pages."""
    with opened(place) as spool:
        for first in range(1, 600, 50):
            spool.append([row(n, 9000 if n % 40 == 0 else 100) for n in range(first, first + 50)])
        spool.delete_before(30)
        spool.drop_oldest(100, 3000)
        return {one.number: one for one in read_all(spool)}
