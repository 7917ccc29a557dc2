"""Spools and rows for tests."""

import logging
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

from ros2_kafka_bridge.endpoints import Outgoing
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
