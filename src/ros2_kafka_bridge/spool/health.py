"""Whether a file is a spool, and whether it is well; nothing is changed by looking."""

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal
from urllib.parse import quote

from ros2_kafka_bridge.spool import database
from ros2_kafka_bridge.spool.database import APPLICATION_ID, PAGE_BYTES, DamagedError, translated
from ros2_kafka_bridge.spool.ledger import VERSION, Ledger, newest
from ros2_kafka_bridge.spool.rows import is_whole

FileKind = Literal['missing', 'empty', 'spool', 'newer', 'other']

_LOOKED_AT_BYTES: Final = 4 * PAGE_BYTES  # the ledger is in the second page
# Of the header of an SQLite file (https://sqlite.org/fileformat2.html) what tells whose it is,
# and what is the same in every spool: whole pages, and a log.
_SQLITE: Final = b'SQLite format 3\0'
_BEGINNING: Final = _SQLITE + PAGE_BYTES.to_bytes(2) + b'\2\2\0'
_VERSION: Final = slice(60, 64)
_MARK: Final = slice(68, 72)
_SETTINGS: Final = (
    ('application_id', APPLICATION_ID),
    ('user_version', VERSION),
    ('encoding', 'UTF-8'),
    ('auto_vacuum', 0),
)


def kind_of(path: Path, known: Ledger | None = None) -> FileKind:
    """What a file is, by its beginning: SQLite does not open every spool that is damaged.

    Args:
        path: The file.
        known: A copy of its ledger from elsewhere; with one, zeros were a spool.

    Raises:
        OSError: It cannot be read.
    """
    try:
        data = beginning_of(path)
    except FileNotFoundError:
        return 'missing'
    if not data:
        return 'empty'
    if newest(data) is not None or (known is not None and not any(data[:PAGE_BYTES])):
        return 'spool'
    # One that was cut off inside of its header has no mark, or a part of it.
    begins = _SQLITE.startswith(data[: len(_SQLITE)])
    if not begins or not APPLICATION_ID.to_bytes(4).startswith(data[_MARK]):
        return 'other'
    return 'newer' if int.from_bytes(data[_VERSION]) > VERSION else 'spool'


def version_of(path: Path) -> int:
    """The version that a spool says it has."""
    return int.from_bytes(beginning_of(path)[_VERSION])


def beginning_of(path: Path) -> bytes:
    """The first pages of a file."""
    with path.open('rb') as file:
        return file.read(_LOOKED_AT_BYTES)


def has_log(path: Path) -> bool:
    """Whether what was written last is in a log beside the file."""
    return size_of(log_of(path)) > 0


def log_of(path: Path) -> Path:
    """Where SQLite keeps what is not yet in the file."""
    return path.with_name(f'{path.name}-wal')


def size_of(path: Path) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


@contextlib.contextmanager
def opened(
    path: Path, *, is_live: bool = False, with_log: bool = True
) -> Iterator[sqlite3.Connection]:
    """Open a file to read it; its log is not merged into it, nor removed.

    Nothing is made for it, unless there is a log without its index: a full disk is no hindrance.

    Args:
        path: The file.
        is_live: Whether a process may be writing it.
        with_log: Whether what is in its log counts.

    Raises:
        DamagedError: It is not there, or not what SQLite takes for one of its own.
        TransportError: The disk does not answer.
        RouteError: It may not be read.
    """
    if not size_of(path):  # SQLite would make a file, or delete the log
        raise DamagedError(f'the file is {"empty" if path.exists() else "missing"}')
    reads_log = with_log and (is_live or has_log(path))
    name = f'file:{quote(str(path.absolute()))}?mode=ro{"" if reads_log else "&immutable=1"}'
    with translated(path, 'cannot be read'):
        db = sqlite3.connect(name, uri=True, isolation_level=None)
        try:
            db.execute('PRAGMA trusted_schema=OFF')
            yield db
        finally:
            db.close()


def problem_of(db: sqlite3.Connection, path: Path, known: Ledger | None) -> str:
    """Why a spool is damaged, empty if it is well.

    Args:
        db: Open to read; what is read afterwards is of the same moment.
        path: Its file.
        known: A copy of its ledger from elsewhere.

    Raises:
        DamagedError: It cannot be read.
    """
    db.execute('BEGIN')
    settings = [(name, *db.execute(f'PRAGMA {name}').fetchone()) for name, _ in _SETTINGS]
    if not beginning_of(path).startswith(_BEGINNING) or settings != list(_SETTINGS):
        return 'its header is not as it was written'
    (found,) = db.execute('PRAGMA quick_check(1)').fetchone()
    if found != 'ok':
        return f'its pages do not fit together: {" ".join(str(found).split())}'
    ledger = database.read_ledger(db)
    if known is not None and known.change > ledger.change:
        return 'its last transactions are missing'
    count = size_bytes = 0
    for stored in database.rows_after(db, -1, -1):
        if not is_whole(stored):
            return f'row {stored[0]} is not as it was written'
        count += 1
        size_bytes += stored[2]
    if (count, size_bytes) != (ledger.rows, ledger.size_bytes):
        return f'it holds {count} rows, and {ledger.rows} were written'
    return ''
