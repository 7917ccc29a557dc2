"""A queue of records in one SQLite file, in the order in which the bridge took them.

Used by one thread, that of its route.
"""

import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.spool import database, repair
from ros2_kafka_bridge.spool.ages import Older
from ros2_kafka_bridge.spool.database import DamagedError, translated
from ros2_kafka_bridge.spool.ledger import Ledger
from ros2_kafka_bridge.spool.lock import FileLock, lock_of
from ros2_kafka_bridge.spool.place import files_of, make_directory, refuse_other_kinds
from ros2_kafka_bridge.spool.rows import Row, pack

_LOOK_S: Final = 0.05  # who only looks whether it is free has the lock for less
_CHUNK: Final = 10_000  # rows deleted in one transaction: the log stays small
_READ: Final = 10_000  # numbers read at once: the memory for them is bounded

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

    def __init__(self, path: Path, *, sync: bool, log: Log) -> None:
        self.is_open = False
        self.damage: repair.Damage | None = None  # what was found last
        self.first = 0  # number of the oldest row; 0 where there is none
        self._end = 0  # number of the newest row; 0 where there is none
        self._ledger = Ledger()
        self._path = path
        self._sync = sync
        self._log = log
        self._lock = FileLock(lock_of(path))
        self._db: sqlite3.Connection | None = None
        self._lost = 0

    # Life

    def claim(self) -> None:
        """Keep the file for this process, whether it is open or not, until `release`.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        make_directory(self._path.parent)
        self._lock.claim(_LOOK_S)

    def release(self) -> None:
        """Close the file, and leave it to any process."""
        self._lock.disclaim()
        self.close()
        self._lock.release()

    def open(self) -> None:
        """Open the file; make it where there is none, repair it where it is damaged.

        Raises:
            RouteError: It cannot be used as it is, or there is no room to repair it: somebody has
                to mend that. Nothing of it was changed.
        """
        if self.is_open:
            return
        make_directory(self._path.parent)
        refuse_other_kinds(self._path)
        self._lock.take()
        try:
            self._open_database()
        except BaseException as error:
            self._lock.release()
            if isinstance(error, TransportError):
                raise RouteError(str(error)) from error
            raise
        self.is_open = True

    def close(self) -> None:
        """Close the file; an empty one is made small. A second call does nothing."""
        if not self.is_open:
            return
        self.is_open = False
        if self._db is not None and not self.count:
            with contextlib.suppress(sqlite3.Error):  # it is a matter of size only
                database.shrink(self._db)
        self._close_database()
        self._lock.release()

    def _open_database(self) -> sqlite3.Connection:
        try:
            self._db = self._connect()
        except BaseException:
            self._close_database()  # half open, it is of no use
            raise
        return self._db

    def _connect(self) -> sqlite3.Connection:
        try:
            damage = repair.repair(self._path, self._known(), self._log)
            if damage is not None:
                self.damage = damage
                self._lost += damage.lost
            refuse_other_kinds(self._path)
            for file in files_of(self._path):
                with contextlib.suppress(OSError):  # it is of another owner, who let us write
                    file.chmod(0o600)
            self._db = db = database.open_to_write(self._path, sync=self._sync)
            with translated(self._path, 'cannot be read'):
                self._ledger = database.read_ledger(db)
                self._lock.keep(self._ledger)
                self.first, self._end = database.ends(db)
        except DamagedError as error:
            raise self._damaged_again(error) from error
        except OSError as error:
            raise database.no_room(self._path, 'cannot be opened', error) from error
        return db

    def _close_database(self) -> None:
        if self._db is not None:
            with contextlib.suppress(sqlite3.Error):  # what is committed is in the log
                self._db.close()
            self._db = None

    def _known(self) -> Ledger | None:
        """The newest ledger that is known without reading the file."""
        own = self._ledger if self._ledger.change else None
        return max(filter(None, (self._lock.ledger(), own)), default=None)

    def _damaged_again(self, error: DamagedError) -> RouteError:
        return RouteError(
            f'the spool {self._path} is damaged again as soon as it is repaired ({error}): is the '
            'disk or the memory of this machine failing?'
        )

    # What is there

    @property
    def last(self) -> int:
        """Highest number given so far, also to a row that is no longer there."""
        return self._ledger.high

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
        return self._ask(lambda db: database.read(db, after, limit, limit_bytes))

    def count_after(self, number: int) -> int:
        """How many rows are above a number; costs nothing where none can be.

        Raises:
            RouteError: The disk does not answer, or has no room for a repair.
        """
        if number >= self._end:
            return 0
        return self._ask(lambda db: database.sum_of(db, number + 1, self._end)[0])

    def numbers(self) -> Iterator[tuple[bytes, int]]:
        """Publisher and number of all rows that have them, in the order of the rows.

        They are read as they are asked for, never all at once.

        Raises:
            RouteError: The disk does not answer, or has no room for a repair.
        """
        after = 0
        while part := self._ask(partial(database.numbers_after, number=after, limit=_READ)):
            yield from ((gid, seq) for _, gid, seq in part if gid and seq > 0)
            after = part[-1][0]

    def _ask(self, question: Callable[[sqlite3.Connection], Result]) -> Result:
        try:
            return self._use(question, 'read')
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
        return self._use(lambda db: self._append(db, rows), 'written')

    def _append(self, db: sqlite3.Connection, rows: Sequence[Row]) -> int:
        ledger = self._ledger
        first = ledger.high + 1
        stored = [pack(row, number) for number, row in enumerate(rows, first)]
        if not ledger.rows:
            ledger = ledger.released(first)
        ledger = ledger._replace(
            high=stored[-1][0],
            rows=ledger.rows + len(stored),
            size_bytes=ledger.size_bytes + sum(row[2] for row in stored),
        )
        with self._transaction(db, ledger):
            database.insert(db, stored)
        return first

    def delete_before(self, number: int) -> None:
        """Delete the rows below a number.

        Raises:
            TransportError: That is not possible now.
        """
        try:
            self._use(lambda db: self._delete_before(db, number), 'written')
        except TransportError as error:
            # A disk that is full to the last byte has no room to note what is deleted, either.
            if number <= self._end or not database.is_full(error):
                raise
            self._begin_again()

    def _delete_before(self, db: sqlite3.Connection, number: int) -> None:
        until = min(number, self._end + 1)
        while self.first and self.first < until:
            self._delete(db, self.first, min(until, self.first + _CHUNK) - 1)
        if database.is_bloated(db):
            with contextlib.suppress(sqlite3.OperationalError):  # no room, or a reader
                database.shrink(db)

    def drop_oldest(self, after: int, bytes_needed: int) -> int:
        """Delete the oldest rows above a number until so many bytes are free; returns how many.

        The newest stays.

        Raises:
            TransportError: That is not possible now.
        """

        def drop(db: sqlite3.Connection) -> int:
            last = database.last_of_bytes(db, after, self._end, bytes_needed)
            return self._drop(db, after + 1, last)

        return self._use(drop, 'written')

    def drop_older(self, after: int, older: Older) -> tuple[int, bool]:
        """Delete the oldest rows behind a number, up to the first that is not older.

        Returns:
            How many rows, and whether none is left of those that were meant.

        Raises:
            TransportError: That is not possible now.
        """

        def drop(db: sqlite3.Connection) -> tuple[int, bool]:
            end = min(older.below, self._end + 1)
            younger = database.first_outside(db, after, older.since_ns, older.until_ns)
            until = min(end, younger or end)
            return self._drop(db, after + 1, until - 1), until == end

        return self._use(drop, 'written')

    def discard_between(self, first: int, last: int, *, keep: frozenset[int]) -> int:
        """Delete the rows from one number to another, but for some; returns how many.

        Raises:
            TransportError: That is not possible now.
        """
        kept = sorted(number for number in keep if first <= number <= last)
        gaps = list(zip([first - 1, *kept], [*kept, last + 1], strict=True))
        return self._use(
            lambda db: sum(self._drop(db, begin + 1, end - 1) for begin, end in gaps), 'written'
        )

    def _drop(self, db: sqlite3.Connection, first: int, last: int) -> int:
        before = self.count
        for begin in range(first, min(last, self._end) + 1, _CHUNK):
            self._delete(db, begin, min(last, begin + _CHUNK - 1))
        return before - self.count

    def _delete(self, db: sqlite3.Connection, first: int, last: int) -> None:
        count, size_bytes = database.sum_of(db, first, last)
        rows, left_bytes = self.count - count, self.size_bytes - size_bytes
        ledger = self._ledger._replace(rows=rows, size_bytes=left_bytes)
        is_lowest = first <= self.first
        ledger = ledger.released(last + 1) if is_lowest else ledger.with_hole(first, last)
        with self._transaction(db, ledger):
            db.execute('DELETE FROM rows WHERE number BETWEEN ? AND ?', (first, last))

    # How the file is used

    def _use(self, work: Callable[[sqlite3.Connection], Result], what: str) -> Result:
        """Use the file; where it turns out to be damaged, repair it and use it again.

        Args:
            work: What to do with it; it is done once more after a repair, and on a full disk.
            what: What that is, such as `written`.

        Raises:
            TransportError: The disk is full or does not answer.
            RouteError: Waiting does not help.
        """
        assert self.is_open, 'open first'
        try:
            return self._try(self._db or self._open_database(), work, what)
        except DamagedError:
            self._close_database()
        try:
            return self._try(self._open_database(), work, what)
        except DamagedError as error:
            raise self._damaged_again(error) from error

    def _try(
        self, db: sqlite3.Connection, work: Callable[[sqlite3.Connection], Result], what: str
    ) -> Result:
        try:
            with translated(self._path, f'cannot be {what}'):
                return work(db)
        except TransportError as error:
            if not database.is_full(error):
                raise
        with translated(self._path, f'cannot be {what}'):
            database.merge_log(db)
            return work(db)

    @contextmanager
    def _transaction(self, db: sqlite3.Connection, ledger: Ledger) -> Iterator[None]:
        """Change rows and ledger, both or none."""
        ledger = ledger._replace(change=self._ledger.change + 1)
        with database.transaction(db):
            yield
            database.write_ledger(db, ledger)
            first, end = database.ends(db)
        self._ledger, self.first, self._end = ledger, first, end
        with contextlib.suppress(OSError):  # only a copy
            self._lock.keep(ledger)

    def _begin_again(self) -> None:
        """Delete the file with all that is in it, and make a new one."""
        self._close_database()
        before, ledger = self._ledger, self._ledger.released(self.last + 1)
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
