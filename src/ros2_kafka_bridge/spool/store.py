"""A queue of records in one SQLite file, in the order in which the bridge took them.

Each route that asks for one has its own, `<directory>/<bridge>.<route>.spool`, and beside it:

    .spool-wal, .spool-shm        SQLite's own, while it is open or after a crash
    .spool.lock                   who has it open, and a copy of its ledger
    .spool.damaged-<UTC time>     a file that was damaged, put aside; the spool goes on without it
    .spool.salvage, .spool.new    for a moment, while a damaged one is repaired

Every row carries a checksum over all its fields. The ledger says which rows there must be; it is
written in the same transaction as they are, and once more into the lock file. What is missing can
so be counted, and a row that was released before does not come back.

Used by one thread, that of its route.
"""

import contextlib
import functools
import logging
import os
import sqlite3
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.spool import database, salvage
from ros2_kafka_bridge.spool.database import DamagedError, translated
from ros2_kafka_bridge.spool.ledger import Ledger
from ros2_kafka_bridge.spool.lock import FileLock, lock_of
from ros2_kafka_bridge.spool.rows import Row, pack, unpack
from ros2_kafka_bridge.spool.salvage import Damage

__all__ = ['Damage', 'Row', 'Spool', 'file_of']

_CHUNK: Final = 10_000  # rows deleted in one transaction: the log stays small
_READ: Final = 10_000  # numbers read at once: the memory for them is bounded
_LAST: Final = 2**63 - 1
_LOOK_S: Final = 0.05  # who only looks whether it is free has the lock for less

Result = TypeVar('Result')


def file_of(directory: Path, bridge: str, route: str) -> Path:
    """The spool of a route."""
    return directory / f'{bridge}.{route}.spool'


class Spool:
    """An ordered queue of records in one file.

    A SIGKILL costs nothing that `append` has returned for, whatever `sync` is. A power loss
    costs nothing with `sync`; without it, what was appended since the system last wrote it out.

    Args:
        path: The file.
        sync: Whether `append` waits until its rows are on the disk.
        log: Where to say what happens.
    """

    def __init__(
        self, path: Path, *, sync: bool, log: logging.LoggerAdapter[logging.Logger]
    ) -> None:
        self.damage: Damage | None = None  # what was found last
        self._path = path
        self._sync = sync
        self._log = log
        self._lock = FileLock(lock_of(path))
        self._is_claimed = False
        self._db: sqlite3.Connection | None = None
        self._is_open = False
        self._ledger = Ledger()
        self._first = self._last = 0  # numbers of the table
        self._lost = 0

    # Life

    def claim(self) -> None:
        """Keep the file for this process, whether it is open or not, until `let_go`.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        _make_directory(self._path.parent)
        self._lock.take(_LOOK_S)
        self._is_claimed = True

    def let_go(self) -> None:
        """Close the file, and leave it to any process."""
        self._is_claimed = False
        self.close()
        self._lock.release()

    def open(self) -> None:
        """Open the file; make it where there is none, repair it where it is damaged.

        Raises:
            RouteError: It cannot be used as it is, or there is no room to repair it: somebody has
                to mend that. Nothing of it was changed.
        """
        if self._is_open:
            return
        _make_directory(self._path.parent)
        for file in _files_of(self._path):
            _refuse_other_kinds(file)
        self._lock.take()
        try:
            self._open_database()
        except TransportError as error:
            self._unlock()
            raise RouteError(str(error)) from error
        except BaseException:
            self._unlock()
            raise
        self._is_open = True

    def close(self) -> None:
        """Close the file; an empty one is made small. A second call does nothing."""
        if not self._is_open:
            return
        self._is_open = False
        if self._db is not None and not self.count:
            with contextlib.suppress(sqlite3.Error):  # it is a matter of size only
                database.shrink(self._db)
        self._close_database()
        self._unlock()

    def _unlock(self) -> None:
        if not self._is_claimed:
            self._lock.release()

    def _open_database(self) -> None:
        try:
            self._connect()
        except BaseException:
            self._close_database()  # half open, it is of no use
            raise

    def _connect(self) -> None:
        try:
            damage = salvage.make_well(self._path, self._known(), self._log)
            if damage is not None:
                self.damage = damage
                self._lost += damage.lost
            for file in _files_of(self._path):
                _refuse_other_kinds(file)  # a link would change what it leads to
                with contextlib.suppress(OSError):  # it is of another owner, who let us write
                    file.chmod(0o600)
            self._db = database.open_to_write(self._path, sync=self._sync)
            with translated(self._path, 'cannot be read'):
                self._ledger = database.read_ledger(self._db)
                self._lock.keep(self._ledger)
                self._find_ends()
        except DamagedError as error:
            raise RouteError(
                f'the spool {self._path} is damaged again as soon as it is repaired ({error}): '
                'is the disk or the memory of this machine failing?'
            ) from error
        except OSError as error:
            raise database.no_room(self._path, 'cannot be opened', error) from error

    def _close_database(self) -> None:
        if self._db is not None:
            with contextlib.suppress(sqlite3.Error):  # what is committed is in the log
                self._db.close()
            self._db = None

    def _known(self) -> Iterator[Ledger]:
        """What is known of the file without reading it."""
        if (copy := self._lock.ledger()) is not None:
            yield copy
        if self._ledger.change:
            yield self._ledger

    def _find_ends(self) -> None:
        assert self._db is not None
        first, last = self._db.execute(
            'SELECT (SELECT min(number) FROM rows), (SELECT max(number) FROM rows)'
        ).fetchone()
        self._first, self._last = first or 0, last or 0

    # What is there

    @property
    def first(self) -> int:
        """Number of the oldest row; 0 where there is none."""
        return self._first - self._ledger.base if self._first else 0

    @property
    def last(self) -> int:
        """Highest number given so far; 0 where no row is there.

        It is that of the newest row, unless that one was dropped or lost: its number is not used
        for another.
        """
        return self._ledger.high - self._ledger.base if self._last else 0

    @property
    def count(self) -> int:
        """How many rows there are."""
        return self._ledger.rows

    @property
    def size_bytes(self) -> int:
        """What they are accounted for: values, keys, headers, and 100 bytes each."""
        return self._ledger.size_bytes

    def take_lost(self) -> int:
        """How many rows were found to be unreadable since the last call."""
        lost, self._lost = self._lost, 0
        return lost

    def read(self, after: int, limit: int, limit_bytes: int) -> list[Row]:
        """Read the rows above a number, in order; at least one, if there is one.

        Args:
            after: Number of the last row that is not wanted.
            limit: How many rows, at most.
            limit_bytes: How many bytes of rows, about.

        Raises:
            RouteError: The disk does not answer, or has no room for a repair.
        """
        return self._asked(lambda db: self._read(db, after, limit, limit_bytes))

    def _read(self, db: sqlite3.Connection, after: int, limit: int, limit_bytes: int) -> list[Row]:
        base, before = self._ledger.base, after + self._ledger.base
        rows: list[Row] = []
        size_bytes = 0
        for stored in database.rows_after(db, before, limit):
            row = unpack(stored, stored[0] - base)
            if row is None or stored[0] <= before:
                raise DamagedError(f'row {stored[0] - base}')
            before = stored[0]
            rows.append(row)
            size_bytes += stored[2]
            if size_bytes >= limit_bytes:
                break
        return rows

    def count_after(self, number: int) -> int:
        """How many rows are above a number; costs nothing where none can be.

        Raises:
            RouteError: The disk does not answer, or has no room for a repair.
        """
        if number + self._ledger.base >= self._last:
            return 0
        return self._asked(
            lambda db: database.sum_of(db, number + self._ledger.base + 1, _LAST)[0]
        )

    def numbers(self) -> Iterator[tuple[bytes, int]]:
        """Publisher and number of all rows that have them, in the order of the rows.

        They are read as they are asked for, never all at once.

        Raises:
            RouteError: The disk does not answer, or has no room for a repair.
        """
        after = 0
        while part := self._asked(functools.partial(self._numbers, after=after)):
            yield from ((gid, seq) for _, gid, seq in part if gid and seq > 0)
            after = part[-1][0]

    def _numbers(self, db: sqlite3.Connection, after: int) -> list[tuple[int, bytes, int]]:
        base, before = self._ledger.base, after + self._ledger.base
        part = []
        for number, gid, seq in database.numbers_after(db, before, _READ):
            if number <= before or not isinstance(gid, bytes) or not isinstance(seq, int):
                raise DamagedError(f'row {number - base}')
            before = number
            part.append((number - base, gid, seq))
        return part

    def _asked(self, use: Callable[[sqlite3.Connection], Result]) -> Result:
        try:
            return self._whole(use, 'read')
        except TransportError as error:  # there is nothing to go on with meanwhile
            raise RouteError(str(error)) from error

    # Changes

    def append(self, rows: Sequence[Row]) -> None:
        """Write rows behind the others, all of them or none.

        Raises:
            TransportError: The disk is full or does not answer: nothing of it was written.
            RouteError: Waiting does not help.
        """
        if not rows:
            return
        self._whole(lambda db: self._append(db, rows), 'written')

    def _append(self, db: sqlite3.Connection, rows: Sequence[Row]) -> None:
        ledger = self._ledger
        if not ledger.rows and rows[0].number + ledger.base <= ledger.high:
            ledger = ledger._replace(base=ledger.high + 1 - rows[0].number)
        base, before = ledger.base, ledger.high
        stored = [pack(row, row.number + base) for row in rows]
        assert stored[0][0] > before, 'numbers ascend'
        ledger = ledger._replace(
            high=stored[-1][0],
            rows=ledger.rows + len(stored),
            size_bytes=ledger.size_bytes + sum(row[2] for row in stored),
        )
        if not self._ledger.rows:  # of what lies between, nothing was ever written
            ledger = ledger.released(stored[0][0])
        elif stored[0][0] > before + 1:
            ledger = ledger.with_hole(before + 1, stored[0][0] - 1)
        with self._transaction(db, ledger):
            database.insert(db, stored)
        self._first, self._last = self._first or stored[0][0], stored[-1][0]

    def release(self, before: int) -> None:
        """Delete the rows below a number.

        Raises:
            TransportError: That is not possible now.
        """
        try:
            self._whole(lambda db: self._release(db, before), 'written')
        except TransportError as error:
            # A disk that is full to the last byte has no room to note what is deleted, either.
            if before + self._ledger.base <= self._last or not database.is_full(error):
                raise
            self._begin_again()

    def _begin_again(self) -> None:
        """Delete the file with all that is in it, and make a new one."""
        self._close_database()
        before, ledger = self._ledger, self._ledger.released(self._ledger.high + 1)
        try:
            self._ledger = ledger._replace(change=ledger.change + 1, rows=0, size_bytes=0)
            self._lock.keep(self._ledger)
            database.remove(self._path)
        except OSError as error:
            if os.path.lexists(self._path):  # with all its rows: they are not to be missed
                self._ledger = before
                with contextlib.suppress(OSError):  # it is the older one then, and also right
                    self._lock.keep(before)
            raise database.no_room(self._path, 'cannot be deleted', error) from error
        self._open_database()

    def _release(self, db: sqlite3.Connection, before: int) -> None:
        until = min(before + self._ledger.base, self._last + 1)
        while self._first and self._first < until:
            self._delete(db, self._first, min(until, self._first + _CHUNK) - 1)
        if database.is_bloated(db):
            with contextlib.suppress(sqlite3.OperationalError):  # no room, or a reader
                database.shrink(db)

    def drop_oldest(self, after: int, bytes_needed: int) -> int:
        """Delete the oldest rows above a number until so many bytes are free.

        Returns:
            How many rows.

        Raises:
            TransportError: That is not possible now.
        """
        return self._whole(lambda db: self._drop_oldest(db, after, bytes_needed), 'written')

    def _drop_oldest(self, db: sqlite3.Connection, after: int, bytes_needed: int) -> int:
        last = first = after + self._ledger.base
        freed_bytes = 0
        query = 'SELECT number, size FROM rows WHERE number > ? ORDER BY number'
        with contextlib.closing(db.execute(query, (first,))) as rows:
            while freed_bytes < bytes_needed and (row := rows.fetchone()) is not None:
                last, size_bytes = row
                freed_bytes += size_bytes
        return self._drop(db, first + 1, last)

    def drop_older(self, after: int, taken_before_ns: int) -> int:
        """Delete the oldest rows above a number as long as they were taken before a time.

        Returns:
            How many rows.

        Raises:
            TransportError: That is not possible now.
        """
        return self._whole(lambda db: self._drop_older(db, after, taken_before_ns), 'written')

    def _drop_older(self, db: sqlite3.Connection, after: int, taken_before_ns: int) -> int:
        first = after + self._ledger.base
        query = 'SELECT number FROM rows WHERE number > ? AND taken_ns >= ? ORDER BY number'
        found = db.execute(f'{query} LIMIT 1', (first, taken_before_ns)).fetchone()
        return self._drop(db, first + 1, found[0] - 1 if found else self._last)

    def discard_between(self, first: int, last: int, *, keep: frozenset[int]) -> int:
        """Delete the rows from one number to another, but for some.

        Returns:
            How many rows.

        Raises:
            TransportError: That is not possible now.
        """
        return self._whole(lambda db: self._discard(db, first, last, keep), 'written')

    def _discard(self, db: sqlite3.Connection, first: int, last: int, keep: frozenset[int]) -> int:
        base, discarded = self._ledger.base, 0
        kept = sorted(number for number in keep if first <= number <= last)
        for begin, end in zip([first - 1, *kept], [*kept, last + 1], strict=True):
            discarded += self._drop(db, begin + 1 + base, end - 1 + base)
        return discarded

    def _drop(self, db: sqlite3.Connection, first: int, last: int) -> int:
        before = self.count
        for begin in range(first, min(last, self._last) + 1, _CHUNK):
            self._delete(db, begin, min(last, begin + _CHUNK - 1))
        return before - self.count

    def _delete(self, db: sqlite3.Connection, first: int, last: int) -> None:
        """Delete the rows in a range of numbers of the table."""
        count, size_bytes = database.sum_of(db, first, last)
        ledger = self._ledger._replace(
            rows=self._ledger.rows - count, size_bytes=self._ledger.size_bytes - size_bytes
        )
        is_all = first <= self._first and last >= self._last
        ledger = (
            ledger.released(last + 1) if first <= self._first else ledger.with_hole(first, last)
        )
        with self._transaction(db, ledger):
            db.execute('DELETE FROM rows WHERE number BETWEEN ? AND ?', (first, last))
        if is_all:
            self._first = self._last = 0
        else:
            self._find_ends()

    @contextmanager
    def _transaction(self, db: sqlite3.Connection, ledger: Ledger) -> Iterator[None]:
        ledger = ledger._replace(change=self._ledger.change + 1)
        db.execute('BEGIN IMMEDIATE')
        try:
            yield
            database.write_ledger(db, ledger)
            db.execute('COMMIT')
        except BaseException:
            if db.in_transaction:
                with contextlib.suppress(sqlite3.Error):  # the first error tells more
                    db.execute('ROLLBACK')
            raise
        self._ledger = ledger
        with contextlib.suppress(OSError):  # only a copy
            self._lock.keep(ledger)

    # Damage

    def _whole(self, use: Callable[[sqlite3.Connection], Result], what: str) -> Result:
        """Use the file; where it turns out to be damaged, repair it and use it again."""
        assert self._is_open, 'open first'
        if self._db is None:
            self._open_database()
        try:
            return self._use(use, what)
        except DamagedError:
            self._close_database()
        self._open_database()
        try:
            return self._use(use, what)
        except DamagedError as error:
            raise RouteError(
                f'the spool {self._path} is damaged again as soon as it is repaired ({error}): '
                'is the disk or the memory of this machine failing?'
            ) from error

    def _use(self, use: Callable[[sqlite3.Connection], Result], what: str) -> Result:
        assert self._db is not None
        try:
            with translated(self._path, f'cannot be {what}'):
                return use(self._db)
        except TransportError as error:
            if not database.is_full(error):
                raise
        with translated(self._path, f'cannot be {what}'):
            database.merge_log(self._db)
            return use(self._db)


def _make_directory(path: Path) -> None:
    try:
        missing = [parent for parent in (path, *path.parents) if not parent.exists()]
        for parent in reversed(missing):
            parent.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise RouteError(
            f'the directory of the spool, {path}, cannot be made: {error.strerror}: make it for '
            'the user of the bridge, or set spool.path to another'
        ) from error
    if not path.is_dir():
        raise RouteError(f'{path} is no directory: set spool.path to one')
    if not os.access(path, os.W_OK | os.X_OK):
        raise RouteError(
            f'the directory of the spool, {path}, cannot be written: let the user of the bridge '
            'write there, or set spool.path to another'
        )


def _files_of(path: Path) -> list[Path]:
    """The file, and what SQLite keeps beside it."""
    return [path.with_name(path.name + suffix) for suffix in ('', '-wal', '-shm')]


def _refuse_other_kinds(path: Path) -> None:
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise database.no_room(path, 'cannot be seen', error) from error
    if not stat.S_ISREG(mode):
        kind = 'a directory' if stat.S_ISDIR(mode) else 'no regular file'
        raise RouteError(f'the spool {path} is {kind}: move it away, or set spool.path to another')
