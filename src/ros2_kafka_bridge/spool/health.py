"""Whether a file is a spool, and whether it is well; nothing is changed by looking."""

import contextlib
import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal
from urllib.parse import quote

from ros2_kafka_bridge.spool import database
from ros2_kafka_bridge.spool.database import APPLICATION_ID, PAGE_BYTES, DamagedError, translated
from ros2_kafka_bridge.spool.ledger import VERSION, Ledger, newest
from ros2_kafka_bridge.spool.pages import Pages
from ros2_kafka_bridge.spool.rows import is_whole

FileKind = Literal['missing', 'empty', 'spool', 'damaged', 'newer', 'other']

_HEADER_BYTES: Final = 100
_LOOKED_AT_BYTES: Final = 256 * PAGE_BYTES
_LOG: Final = struct.Struct('>8I')
_LOG_MAGIC: Final = 0x377F0682
_LOG_VERSION: Final = 3007000
_SQLITE: Final = b'SQLite format 3\0'
# Of the header of an SQLite file, what is the same in every spool: where, and what.
_MARK: Final = (68, APPLICATION_ID.to_bytes(4))
_VERSION: Final = slice(60, 64)
_CONSTANT: Final = (
    (0, _SQLITE),
    _MARK,
    (60, VERSION.to_bytes(4)),
    (16, PAGE_BYTES.to_bytes(2) + b'\2\2\0\x40\x20\x20'),  # WAL; the whole page in use
    (44, (4).to_bytes(4)),  # format of the schema
    (52, bytes(4)),  # no vacuuming by itself
    (56, (1).to_bytes(4)),  # UTF-8
    (64, bytes(4)),
    (72, bytes(20)),
)


def kind_of(path: Path) -> FileKind:
    """What a file is, by its beginning.

    Raises:
        OSError: It cannot be read.
    """
    try:
        with path.open('rb') as file:
            data = file.read(_LOOKED_AT_BYTES)
    except FileNotFoundError:
        return 'missing'
    if not data:
        return 'empty'
    if all(data.startswith(text, at) for at, text in _CONSTANT):
        return 'spool'
    if newest(data) is not None or _is_cut_header(data):
        return 'damaged'
    if data.startswith(_SQLITE) and data.startswith(_MARK[1], _MARK[0]):
        return 'newer' if int.from_bytes(data[_VERSION]) > VERSION else 'damaged'
    with Pages(path) as pages:
        return 'damaged' if pages.has_rows(_LOOKED_AT_BYTES // PAGE_BYTES) else 'other'


def _is_cut_header(data: bytes) -> bool:
    """Whether this is all that is left of a spool that was cut off inside of its header."""
    parts = ((data[at : at + len(text)], text) for at, text in _CONSTANT)
    return len(data) < _HEADER_BYTES and all(text.startswith(part) for part, text in parts)


def version_of(path: Path) -> int:
    """The version that a spool says it has."""
    with path.open('rb') as file:
        return int.from_bytes(file.read(_HEADER_BYTES)[_VERSION])


def problem_of(db: sqlite3.Connection, path: Path, *ledgers: Ledger | None) -> str:
    """Why a spool is damaged, empty if it is well.

    Args:
        db: Open to read.
        path: Its file, for messages.
        ledgers: Copies of its ledger from elsewhere.

    Raises:
        TransportError: The disk does not answer.
        RouteError: It may not be read.
    """
    try:
        with translated(path, 'cannot be read'):
            return _problem(db, *ledgers)
    except DamagedError as error:
        return str(error)


def _problem(db: sqlite3.Connection, *ledgers: Ledger | None) -> str:
    db.execute('BEGIN')  # one moment for all that is looked at
    (found,) = db.execute('PRAGMA quick_check(1)').fetchone()
    if found != 'ok':
        return f'its pages do not fit together: {" ".join(str(found).split())}'
    ledger = database.read_ledger(db)
    if any(copy is not None and copy.change > ledger.change for copy in ledgers):
        return 'its last transactions are missing'
    count = size_bytes = 0
    for stored in database.rows_after(db, -1, -1):
        if not is_whole(stored):
            return f'row {stored[0] - ledger.base} is not as it was written'
        count += 1
        size_bytes += stored[2]
    if (count, size_bytes) != (ledger.rows, ledger.size_bytes):
        return f'it holds {count} rows, and {ledger.rows} were written'
    return ''


@contextlib.contextmanager
def opened_to_look(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a file that nobody else uses; its log is not merged into it, nor removed.

    Nothing is made for it, unless there is a log without its index: a full disk is no hindrance.

    Raises:
        DamagedError: SQLite does not take it for one of its own.
        TransportError: The disk does not answer.
        RouteError: It may not be read.
    """
    with _opened(path, 'mode=ro' if _has_log(path) else 'mode=ro&immutable=1') as db:
        yield db


def has_broken_log(path: Path) -> bool:
    """Whether the log of a file that nobody has open does not begin as one.

    SQLite, where it may change nothing, would wait ten seconds for somebody to mend it.
    """
    if not _has_log(path):
        return False
    with _beside(path)[0].open('rb') as file:
        header = file.read(_LOG.size)
    if len(header) < _LOG.size:
        return True
    magic, version, page_bytes, *_, first, second = _LOG.unpack(header)
    words = struct.unpack_from(('>' if magic & 1 else '<') + '6I', header)
    sums = [0, 0]
    for number, word in enumerate(words):
        sums[number % 2] = (sums[number % 2] + word + sums[1 - number % 2]) & 0xFFFFFFFF
    known = (magic & ~1, version, page_bytes) == (_LOG_MAGIC, _LOG_VERSION, PAGE_BYTES)
    return not known or sums != [first, second]


def can_be_opened(path: Path, *, is_live: bool) -> bool:
    """Whether SQLite can read a file without making one of its own."""
    return is_live or not _has_log(path) or _beside(path)[1].exists()


@contextlib.contextmanager
def opened_to_read(path: Path, *, is_live: bool) -> Iterator[sqlite3.Connection]:
    """Open a file so that nothing is made and nothing repaired; somebody may be using it.

    Args:
        path: The file, for which `can_be_opened` is true.
        is_live: Whether a process has it open.

    Raises:
        DamagedError: SQLite does not take it for one of its own.
        TransportError: The disk does not answer.
        RouteError: It may not be read.
    """
    with _opened(path, 'mode=ro' if is_live else _untouched(path)) as db:
        yield db


def _untouched(path: Path) -> str:
    return 'mode=ro&readonly_shm=1' if _has_log(path) else 'mode=ro&immutable=1'


def _has_log(path: Path) -> bool:
    log, _ = _beside(path)
    return log.exists() and log.stat().st_size > 0


def _beside(path: Path) -> tuple[Path, Path]:
    return path.with_name(f'{path.name}-wal'), path.with_name(f'{path.name}-shm')


@contextlib.contextmanager
def _opened(path: Path, how: str) -> Iterator[sqlite3.Connection]:
    with translated(path, 'cannot be opened'):
        name = f'file:{quote(str(path.absolute()))}?{how}'
        db = sqlite3.connect(name, uri=True, isolation_level=None)
        try:
            db.execute('PRAGMA trusted_schema=OFF')
            yield db
        finally:
            db.close()
