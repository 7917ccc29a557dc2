"""A queue of records in one SQLite file, in the order in which the bridge took them.

Each route that asks for one has its own, `<directory>/<bridge>.<route>.spool`, and beside it:

    .spool-wal, .spool-shm        SQLite's own, while it is open or after a crash
    .spool.lock                   who has it open, and a copy of its ledger
    .spool.damaged-<UTC time>     a file that was damaged, put aside; the spool goes on without it
    .spool.salvage, .salvage.copy, .new    for a moment, while a damaged one is repaired

Every row carries a checksum over all its fields. The ledger says which rows there must be; it is
written in the same transaction as they are, and once more into the lock file. What is missing can
so be counted, and a row that was released before does not come back.

Used by one thread, that of its route.
"""

import contextlib
import functools
import logging
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, TypeVar

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.spool import database
from ros2_kafka_bridge.spool.ages import Older
from ros2_kafka_bridge.spool.database import DamagedError
from ros2_kafka_bridge.spool.file import SpoolFile
from ros2_kafka_bridge.spool.rows import Row, pack, unpack
from ros2_kafka_bridge.spool.salvage import Damage

__all__ = ['Damage', 'Row', 'Spool', 'file_of']

_CHUNK: Final = 10_000  # rows deleted in one transaction: the log stays small
_READ: Final = 10_000  # numbers read at once: the memory for them is bounded
_LAST: Final = 2**63 - 1

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
        self._file = SpoolFile(path, sync=sync, log=log)

    # Life

    def claim(self) -> None:
        """Keep the file for this process, whether it is open or not, until `let_go`.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        self._file.claim()

    def let_go(self) -> None:
        """Close the file, and leave it to any process."""
        self._file.let_go()

    def open(self) -> None:
        """Open the file; make it where there is none, repair it where it is damaged.

        Raises:
            RouteError: It cannot be used as it is, or there is no room to repair it: somebody has
                to mend that. Nothing of it was changed.
        """
        self._file.open()

    def close(self) -> None:
        """Close the file; an empty one is made small. A second call does nothing."""
        self._file.close()

    @property
    def is_open(self) -> bool:
        """Whether it is open."""
        return self._file.is_open

    @property
    def damage(self) -> Damage | None:
        """What was found to be damaged last."""
        return self._file.damage

    # What is there

    @property
    def first(self) -> int:
        """Number of the oldest row; 0 where there is none."""
        return self._file.first

    @property
    def last(self) -> int:
        """Highest number given so far, also to a row that is no longer there."""
        return self._file.ledger.high

    @property
    def count(self) -> int:
        """How many rows there are."""
        return self._file.ledger.rows

    @property
    def size_bytes(self) -> int:
        """What they are accounted for: values, keys, headers, and 100 bytes each."""
        return self._file.ledger.size_bytes

    def take_lost(self) -> int:
        """How many rows were found to be unreadable since the last call."""
        return self._file.take_lost()

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
        rows: list[Row] = []
        size_bytes = 0
        for stored in database.rows_after(db, after, limit):
            row = unpack(stored)
            if row is None or row.number <= after:
                raise DamagedError(f'row {stored[0]}')
            after = row.number
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
        if number >= self._file.last:
            return 0
        return self._asked(lambda db: database.sum_of(db, number + 1, _LAST)[0])

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
        part = []
        for number, gid, seq in database.numbers_after(db, after, _READ):
            if number <= after or not isinstance(gid, bytes) or not isinstance(seq, int):
                raise DamagedError(f'row {number}')
            after = number
            part.append((number, gid, seq))
        return part

    def _asked(self, use: Callable[[sqlite3.Connection], Result]) -> Result:
        try:
            return self._file.use(use, 'read')
        except TransportError as error:  # there is nothing to go on with meanwhile
            raise RouteError(str(error)) from error

    # Changes

    def append(self, rows: Sequence[Row]) -> int:
        """Write rows behind the others, all of them or none.

        Args:
            rows: At least one; whatever number it has is not looked at.

        Returns:
            The number of the first; those of the others follow it.

        Raises:
            TransportError: The disk is full or does not answer: nothing of it was written.
            RouteError: Waiting does not help.
        """
        return self._file.use(lambda db: self._append(db, rows), 'written')

    def _append(self, db: sqlite3.Connection, rows: Sequence[Row]) -> int:
        ledger = self._file.ledger
        first = ledger.high + 1
        stored = [pack(row, number) for number, row in enumerate(rows, first)]
        if not ledger.rows:
            ledger = ledger.released(first)
        ledger = ledger._replace(
            high=stored[-1][0],
            rows=ledger.rows + len(stored),
            size_bytes=ledger.size_bytes + sum(row[2] for row in stored),
        )
        with self._file.transaction(db, ledger):
            database.insert(db, stored)
        return first

    def release(self, before: int) -> None:
        """Delete the rows below a number.

        Raises:
            TransportError: That is not possible now.
        """
        try:
            self._file.use(lambda db: self._release(db, before), 'written')
        except TransportError as error:
            # A disk that is full to the last byte has no room to note what is deleted, either.
            if before <= self._file.last or not database.is_full(error):
                raise
            self._file.begin_again()

    def _release(self, db: sqlite3.Connection, before: int) -> None:
        until = min(before, self._file.last + 1)
        while self._file.first and self._file.first < until:
            self._delete(db, self._file.first, min(until, self._file.first + _CHUNK) - 1)
        if database.is_bloated(db):
            with contextlib.suppress(sqlite3.OperationalError):  # no room, or a reader
                database.shrink(db)

    def drop_oldest(self, after: int, bytes_needed: int) -> int:
        """Delete the oldest rows above a number until so many bytes are free; the newest stays.

        Returns:
            How many rows.

        Raises:
            TransportError: That is not possible now.
        """
        return self._file.use(lambda db: self._drop_oldest(db, after, bytes_needed), 'written')

    def _drop_oldest(self, db: sqlite3.Connection, after: int, bytes_needed: int) -> int:
        last = after
        freed_bytes = 0
        query = 'SELECT number, size FROM rows WHERE number > ? AND number < ? ORDER BY number'
        with contextlib.closing(db.execute(query, (after, self._file.last))) as rows:
            while freed_bytes < bytes_needed and (row := rows.fetchone()) is not None:
                last, size_bytes = row
                freed_bytes += size_bytes
        return self._drop(db, after + 1, last)

    def drop_older(self, after: int, older: Older) -> tuple[int, bool]:
        """Delete the oldest rows behind a number, up to the first that is not older.

        Returns:
            How many rows, and whether none is left of those that were meant.

        Raises:
            TransportError: That is not possible now.
        """
        return self._file.use(lambda db: self._drop_older(db, after, older), 'written')

    def _drop_older(self, db: sqlite3.Connection, after: int, older: Older) -> tuple[int, bool]:
        found = db.execute(
            'SELECT number FROM rows WHERE number > ? AND (taken_ns >= ? OR taken_ns < ?) '
            'ORDER BY number LIMIT 1',
            (after, older.until_ns, older.since_ns),
        ).fetchone()
        end = min(older.below, self._file.last + 1)
        until = min(end, *found) if found else end
        return self._drop(db, after + 1, until - 1), until == end

    def discard_between(self, first: int, last: int, *, keep: frozenset[int]) -> int:
        """Delete the rows from one number to another, but for some.

        Returns:
            How many rows.

        Raises:
            TransportError: That is not possible now.
        """
        return self._file.use(lambda db: self._discard(db, first, last, keep), 'written')

    def _discard(self, db: sqlite3.Connection, first: int, last: int, keep: frozenset[int]) -> int:
        discarded = 0
        kept = sorted(number for number in keep if first <= number <= last)
        for begin, end in zip([first - 1, *kept], [*kept, last + 1], strict=True):
            discarded += self._drop(db, begin + 1, end - 1)
        return discarded

    def _drop(self, db: sqlite3.Connection, first: int, last: int) -> int:
        before = self.count
        for begin in range(first, min(last, self._file.last) + 1, _CHUNK):
            self._delete(db, begin, min(last, begin + _CHUNK - 1))
        return before - self.count

    def _delete(self, db: sqlite3.Connection, first: int, last: int) -> None:
        """Delete the rows in a range of numbers of the table."""
        count, size_bytes = database.sum_of(db, first, last)
        before = self._file.ledger
        ledger = before._replace(
            rows=before.rows - count, size_bytes=before.size_bytes - size_bytes
        )
        is_lowest = first <= self._file.first
        ledger = ledger.released(last + 1) if is_lowest else ledger.with_hole(first, last)
        with self._file.transaction(db, ledger):
            db.execute('DELETE FROM rows WHERE number BETWEEN ? AND ?', (first, last))
