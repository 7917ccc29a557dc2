"""The SQLite file of a spool: how it is made, what is in it, what its errors mean."""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError
from ros2_kafka_bridge.spool.ledger import VERSION, Ledger, newest
from ros2_kafka_bridge.spool.rows import Row, Stored, unpack

APPLICATION_ID: Final = 0x524B4253  # 'RKBS'
PAGE_BYTES: Final = 4096
_PAGES_KEPT: Final = 4096
_PAGES_IN_USE: Final = 1024
_WAIT_S: Final = 0.2  # for a reader of the same file, where one is in the way
_MB: Final = 1024 * 1024

_SCHEMA: Final = (
    # The ledger comes first, so that its page is at the beginning of the file: the end of a file
    # is more often lost. It is written twice into its page, so that one flipped bit spares one.
    'CREATE TABLE ledger(id INTEGER PRIMARY KEY, first BLOB, second BLOB)',
    (
        'CREATE TABLE rows(number INTEGER PRIMARY KEY, taken_ns INTEGER, size INTEGER, '
        'dead INTEGER, gid BLOB, seq INTEGER, crc INTEGER, body BLOB)'
    ),
)
_INSERT: Final = 'INSERT INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?)'
_COLUMNS: Final = 'number, taken_ns, size, dead, gid, seq, crc, body'

_UNREADABLE: Final = {sqlite3.SQLITE_IOERR_READ, sqlite3.SQLITE_IOERR_CORRUPTFS}
_WAIT: Final = {
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_INTERRUPT,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_NOMEM,
}
_NOT_OURS: Final = {
    sqlite3.SQLITE_AUTH,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_READONLY,
}


class DamagedError(Exception):
    """The file is not what was written; stays inside of this package."""


@contextmanager
def translated(path: Path, what: str) -> Iterator[None]:
    """Say in the words of the bridge what SQLite says.

    Args:
        path: The file.
        what: What cannot be done, such as `cannot be written`.
    """
    try:
        yield
    except (sqlite3.ProgrammingError, sqlite3.InterfaceError):
        raise  # a bug
    except sqlite3.Error as error:
        raise _translation(path, what, error) from error
    except UnicodeDecodeError as error:  # what SQLite says names what is damaged
        raise DamagedError('its schema is not as it was written') from error


def _translation(path: Path, what: str, error: sqlite3.Error) -> Exception:
    extended = getattr(error, 'sqlite_errorcode', 0)
    code = extended & 0xFF
    if code in _WAIT and extended not in _UNREADABLE:
        text = f'the spool {path} {what}: {error} ({_free(path)})'
        return TransportError(text)
    if extended == sqlite3.SQLITE_READONLY_DBMOVED:
        return RouteError(f'the spool {path} was moved or deleted while it was in use')
    if code in _NOT_OURS:
        return RouteError(
            f'the spool {path} {what}: {error}: let the user of the bridge write it and its '
            'directory'
        )
    return DamagedError(str(error))  # also what no healthy file makes SQLite say


def _free(path: Path) -> str:
    try:
        return f'{shutil.disk_usage(path.parent).free / _MB:.1f} MB free on its disk'
    except OSError:
        return 'its directory cannot be seen'


def is_full(error: TransportError) -> bool:
    """Whether it is the disk that has no room."""
    cause = error.__cause__
    return isinstance(cause, sqlite3.Error) and cause.sqlite_errorcode == sqlite3.SQLITE_FULL


def no_room(path: Path, what: str, error: OSError) -> BridgeError:
    """What an error of the system means for the file."""
    text = f'the spool {path} {what}: {error.strerror} ({_free(path)})'
    if isinstance(error, PermissionError):
        return RouteError(f'{text}: let the user of the bridge write it and its directory')
    return TransportError(text)


def make(path: Path, ledger: Ledger, batches: Iterable[list[Stored]]) -> Ledger:
    """Make a whole spool, on the disk when this returns.

    Args:
        path: Where; what is there is overwritten.
        ledger: What it should hold.
        batches: Its rows; of those with the same number the first counts.

    Returns:
        The ledger of what it holds.

    Raises:
        TransportError: The disk is full; nothing is left at `path`.
        RouteError: It may not be written.
    """
    try:
        remove(path)
        with contextlib.closing(_begin(path)) as db, translated(path, 'cannot be made'):
            for rows in batches:
                db.executemany(_INSERT.replace('INSERT', 'INSERT OR IGNORE'), rows)
            first, last, count, size_bytes = db.execute(
                'SELECT min(number), max(number), count(*), sum(size) FROM rows'
            ).fetchone()
            ledger = ledger._replace(
                high=max(ledger.high, last or 0),
                floor=max(ledger.floor, first or 0),
                rows=count,
                size_bytes=size_bytes or 0,
            )
            write_ledger(db, ledger)
            db.execute('COMMIT')
            db.execute('PRAGMA journal_mode=WAL')
        _sync(path)
    except OSError as error:
        remove(path)
        raise no_room(path, 'cannot be made', error) from error
    except BaseException:
        remove(path)
        raise
    return ledger


def _begin(path: Path) -> sqlite3.Connection:
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    with translated(path, 'cannot be made'):
        db = sqlite3.connect(path, isolation_level=None)
        # It counts only once it is whole: there is nothing to roll back.
        for setting in ('journal_mode=OFF', 'synchronous=OFF', f'page_size={PAGE_BYTES}'):
            db.execute(f'PRAGMA {setting}')
        db.execute('BEGIN')
        db.execute(f'PRAGMA application_id={APPLICATION_ID}')
        db.execute(f'PRAGMA user_version={VERSION}')
        for statement in _SCHEMA:
            db.execute(statement)
        db.execute("INSERT INTO ledger VALUES (1, x'', x'')")
    return db


def sync_directory(path: Path) -> None:
    """See that the name of a file is on the disk."""
    _sync(path.parent)


def _sync(path: Path) -> None:
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def remove(path: Path) -> None:
    """Delete a file and what SQLite keeps beside it."""
    for suffix in ('', '-wal', '-shm', '-journal'):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def open_to_write(path: Path, *, sync: bool) -> sqlite3.Connection:
    """Open a spool that is well.

    Args:
        path: The file.
        sync: Whether a transaction is on the disk when it is committed. Without it the disk is
            waited for only when the log is merged into the file: the file is whole after a power
            loss, too, but the last transactions are gone.
    """
    try:
        return _open_to_write(path, 'NORMAL', sync=sync)
    except TransportError:
        # A full disk has no room for the index of the log: it can be kept in memory, at the price
        # that nobody else can look into the file.
        return _open_to_write(path, 'EXCLUSIVE', sync=sync)


def _open_to_write(path: Path, locking: str, *, sync: bool) -> sqlite3.Connection:
    with translated(path, 'cannot be opened'):
        db = sqlite3.connect(path, isolation_level=None, timeout=_WAIT_S, check_same_thread=False)
        for setting in (
            f'locking_mode={locking}',
            f'synchronous={"FULL" if sync else "NORMAL"}',
            'trusted_schema=OFF',
            'cell_size_check=ON',
            'cache_size=-4096',
            'temp_store=MEMORY',
            f'journal_size_limit={8 * _MB}',
        ):
            db.execute(f'PRAGMA {setting}')
        try:
            db.execute('SELECT id FROM ledger').fetchone()
        except sqlite3.Error:
            db.close()
            raise
    return db


@contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """Change what is in it, as a whole or not at all."""
    db.execute('BEGIN IMMEDIATE')
    try:
        yield
        db.execute('COMMIT')
    except BaseException:
        if db.in_transaction:
            with contextlib.suppress(sqlite3.Error):  # the first error tells more
                db.execute('ROLLBACK')
        raise


def read_ledger(db: sqlite3.Connection) -> Ledger:
    """The ledger.

    Raises:
        DamagedError: It is not readable.
    """
    first, second = copies_of_ledger(db)
    ledger = newest(first) if first == second else None
    if ledger is None:
        raise DamagedError('its ledger cannot be read')
    return ledger


def copies_of_ledger(db: sqlite3.Connection) -> tuple[bytes, bytes]:
    """The two copies of the ledger, as they are stored.

    Raises:
        DamagedError: They are not there.
    """
    found = db.execute('SELECT first, second FROM ledger WHERE id = 1').fetchone()
    match found:
        case (bytes(first), bytes(second)):
            return first, second
    raise DamagedError('its ledger is gone')


def write_ledger(db: sqlite3.Connection, ledger: Ledger) -> None:
    """Write the ledger, inside of a transaction."""
    copy = ledger.pack()
    db.execute('UPDATE ledger SET first = ?, second = ? WHERE id = 1', (copy, copy))


def insert(db: sqlite3.Connection, rows: Iterable[Stored]) -> None:
    """Write rows, inside of a transaction."""
    db.executemany(_INSERT, rows)


def rows_after(db: sqlite3.Connection, number: int, limit: int) -> Iterator[Stored]:
    """The rows above a number, in order."""
    return db.execute(
        f'SELECT {_COLUMNS} FROM rows WHERE number > ? ORDER BY number LIMIT ?',  # noqa: S608
        (number, limit),
    )


def all_rows(db: sqlite3.Connection, order: str) -> Iterator[Stored]:
    """The rows, `ASC` or `DESC`; none is sought, so that no damage misleads to the first."""
    return db.execute(f'SELECT {_COLUMNS} FROM rows ORDER BY number {order}')  # noqa: S608


def read(db: sqlite3.Connection, after: int, limit: int, limit_bytes: int) -> list[Row]:
    """Read the rows above a number, up to one of these limits; see `Spool.read`.

    Raises:
        DamagedError: One is not as it was written.
    """
    rows: list[Row] = []
    size_bytes = 0
    for stored in rows_after(db, after, limit):
        row = unpack(stored)
        if row is None or row.number <= after:
            raise DamagedError(f'row {stored[0]}')
        after = row.number
        rows.append(row)
        size_bytes += stored[2]
        if size_bytes >= limit_bytes:
            break
    return rows


def numbers_after(db: sqlite3.Connection, number: int, limit: int) -> list[tuple[int, bytes, int]]:
    """Number, publisher, and number at the publisher of the rows above a number, in order.

    Raises:
        DamagedError: One is not as it was written.
    """
    found: list[tuple[int, Any, Any]] = db.execute(
        'SELECT number, gid, seq FROM rows WHERE number > ? ORDER BY number LIMIT ?',
        (number, limit),
    ).fetchall()
    for row, gid, seq in found:
        if row <= number or not isinstance(gid, bytes) or not isinstance(seq, int):
            raise DamagedError(f'row {row}')
        number = row
    return found


def last_of_bytes(db: sqlite3.Connection, after: int, before: int, bytes_needed: int) -> int:
    """The last of the rows between two numbers that together take so many bytes, or all do."""
    freed_bytes = 0
    query = 'SELECT number, size FROM rows WHERE number > ? AND number < ? ORDER BY number'
    with contextlib.closing(db.execute(query, (after, before))) as rows:
        while freed_bytes < bytes_needed and (row := rows.fetchone()) is not None:
            after, size_bytes = row
            freed_bytes += size_bytes
    return after


def first_outside(db: sqlite3.Connection, after: int, since_ns: int, until_ns: int) -> int | None:
    """The first row above a number that was not taken in that time; None where all were."""
    found = db.execute(
        'SELECT number FROM rows WHERE number > ? AND (taken_ns >= ? OR taken_ns < ?) '
        'ORDER BY number LIMIT 1',
        (after, until_ns, since_ns),
    ).fetchone()
    return int(found[0]) if found else None


def first_alive(db: sqlite3.Connection) -> Stored | None:
    """The first row that is no dead letter."""
    query = f'SELECT {_COLUMNS} FROM rows WHERE dead = 0 ORDER BY number LIMIT 1'  # noqa: S608
    found: Stored | None = db.execute(query).fetchone()
    return found


def ends(db: sqlite3.Connection) -> tuple[int, int]:
    """Numbers of the first and the last row; 0 where there is none."""
    first, last = db.execute(
        'SELECT (SELECT min(number) FROM rows), (SELECT max(number) FROM rows)'
    ).fetchone()
    return first or 0, last or 0


def sum_of(db: sqlite3.Connection, first: int, last: int) -> tuple[int, int]:
    """How many rows are in a range of numbers, and what they are accounted for."""
    count, size_bytes = db.execute(
        'SELECT count(*), total(size) FROM rows WHERE number BETWEEN ? AND ?', (first, last)
    ).fetchone()
    return count, int(size_bytes)


def is_bloated(db: sqlite3.Connection) -> bool:
    """Whether much of the file is not in use, and so little is that it can be copied at once."""
    (free,) = db.execute('PRAGMA freelist_count').fetchone()
    if free <= _PAGES_KEPT:
        return False
    (pages,) = db.execute('PRAGMA page_count').fetchone()
    return bool(pages - free < _PAGES_IN_USE)


def shrink(db: sqlite3.Connection) -> None:
    """Give the pages that are not in use back to the file system."""
    db.execute('VACUUM')
    db.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchone()


def merge_log(db: sqlite3.Connection) -> None:
    """Write what is in the log to its place, so that the log can begin again where it began."""
    db.execute('PRAGMA wal_checkpoint(RESTART)').fetchone()
