"""Spools and their rows: as tests write them, damaged, and as earlier versions have left them."""

import logging
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.spool import database
from ros2_kafka_bridge.spool.rows import Row
from ros2_kafka_bridge.spool.store import Spool, file_of

LOG = logging.LoggerAdapter(logging.getLogger('spool'))
GID = bytes(range(16))
EVERYTHING = 1 << 40


def row(number: int, size: int = 50) -> Row:
    """A row as a route makes it."""
    value = b'%d ' % number * size
    headers: list[tuple[str, str | bytes | None]] = [
        ('ros.topic', b'/orders'),
        ('ros.seq', b'%d' % number),
    ]
    record = Outgoing('orders', b'/orders', value[:size], headers)
    return Row(number, 1_700_000_000_000_000_000 + number, False, GID, number, record)  # noqa: FBT003 (dead)


def rows(first: int, last: int, size: int = 50) -> list[Row]:
    """Rows with these numbers."""
    return [row(number, size) for number in range(first, last + 1)]


def make(path: Path, *, sync: bool = False) -> Spool:
    """A spool in a directory, not open yet."""
    return Spool(file_of(path, 'bridge', 'route'), sync=sync, log=LOG)


@contextmanager
def opened(path: Path, count: int = 0, size: int = 50, *, sync: bool = False) -> Iterator[Spool]:
    """A spool in a directory, which gets so many rows."""
    spool = make(path, sync=sync)
    spool.open()
    try:
        if count:
            spool.append(rows(1, count, size))
        yield spool
    finally:
        spool.close()


def read_all(spool: Spool, limit: int = 100) -> list[Row]:
    """Everything in a spool."""
    found: list[Row] = []
    while part := spool.read(found[-1].number if found else 0, limit, EVERYTHING):
        found += part
    return found


def numbers(found: Iterable[Row]) -> list[int]:
    """The numbers of rows."""
    return [one.number for one in found]


class Found(NamedTuple):
    """What a spool turned out to hold."""

    rows: Sequence[Row]
    lost: int
    certain: bool


def reopened(path: Path) -> Found:
    """Open a spool, read it, close it."""
    with opened(path) as spool:
        held = read_all(spool)
        assert numbers(held) == sorted({one.number for one in held}), 'in order, each once'
        assert spool.count == len(held)
        certain = spool.damage is None or spool.damage.certain
        return Found(held, spool.take_lost(), certain)


def newest_on_disk(file: Path) -> int:
    """The number, at its publisher, of the newest message in the spool of a bridge that runs."""
    if not file.exists():
        return 0
    reader = sqlite3.connect(f'file:{file}?mode=ro', uri=True)
    with closing(reader):
        return int(reader.execute('SELECT max(seq) FROM rows').fetchone()[0] or 0)


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


GOLDEN: Final = Path(__file__).parents[2] / 'unit' / 'spool' / 'golden'
STATES: Final = {
    'closed': range(5, 21), 'killed': range(5, 31), 'counted_anew': range(5, 21),
}  # fmt: skip
VERSIONS: Final = tuple(int(folder.name) for folder in sorted(GOLDEN.iterdir()))

_BEFORE: Final = {'counted_anew': 30}  # rows of which nothing is left
_NAME: Final = 'bridge.route.spool'
_WITHOUT_VALUE: Final = 7
_LETTER: Final = 9


def put(version: int, state: str, file: Path) -> None:
    """Lay a copy there, with all that lay beside it."""
    file.parent.mkdir(exist_ok=True)
    for source in (GOLDEN / str(version) / state).iterdir():
        shutil.copy(source, file.with_name(source.name.replace(_NAME, file.name)))


def held(state: str) -> list[Row]:
    """What it holds."""
    before = _BEFORE.get(state, 0)
    return [_row(number)._replace(number=before + number) for number in STATES[state]]


def _row(number: int) -> Row:
    headers: list[tuple[str, str | bytes | None]] = [
        ('ros.topic', b'/orders'),
        ('ros.seq', b'%d' % number),
        ('text', 'ünï'),
        ('none', None),
    ]
    is_letter = number == _LETTER
    record = Outgoing(
        'orders.dead-letters' if is_letter else 'orders',
        None if number % 5 == 0 else b'/orders',
        None if number == _WITHOUT_VALUE else b'order %d' % number,
        headers,
    )
    taken_ns = 1_700_000_000_000_000_000 + number
    return Row(number, taken_ns, is_letter, bytes(range(16)), number, record)
