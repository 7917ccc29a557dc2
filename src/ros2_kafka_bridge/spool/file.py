"""The file of a spool: kept for one process, made well where it is damaged, changed as a whole."""

import contextlib
import logging
import os
import sqlite3
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.spool import database, salvage
from ros2_kafka_bridge.spool.database import DamagedError, translated
from ros2_kafka_bridge.spool.ledger import Ledger
from ros2_kafka_bridge.spool.lock import FileLock, lock_of

_LOOK_S: Final = 0.05  # who only looks whether it is free has the lock for less

Result = TypeVar('Result')


class SpoolFile:
    """A file with its lock and its ledger. Used by one thread, that of its route.

    Args:
        path: The file.
        sync: Whether a change waits until it is on the disk.
        log: Where to say what happens.
    """

    def __init__(
        self, path: Path, *, sync: bool, log: logging.LoggerAdapter[logging.Logger]
    ) -> None:
        self.damage: salvage.Damage | None = None  # what was found last
        self.ledger = Ledger()
        self.first = self.last = 0  # numbers of the table; 0 where no row is there
        self._path = path
        self._sync = sync
        self._log = log
        self._lock = FileLock(lock_of(path))
        self._is_claimed = False
        self._db: sqlite3.Connection | None = None
        self.is_open = False
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
        if self.is_open:
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
        self.is_open = True

    def close(self) -> None:
        """Close the file; an empty one is made small. A second call does nothing."""
        if not self.is_open:
            return
        self.is_open = False
        if self._db is not None and not self.ledger.rows:
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
                self.ledger = database.read_ledger(self._db)
                self._lock.keep(self.ledger)
                self.first, self.last = database.ends(self._db)
        except DamagedError as error:
            raise _damaged_again(self._path, error) from error
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
        if self.ledger.change:
            yield self.ledger

    # Use

    def take_lost(self) -> int:
        """How many rows were found to be unreadable since the last call."""
        lost, self._lost = self._lost, 0
        return lost

    def use(self, work: Callable[[sqlite3.Connection], Result], what: str) -> Result:
        """Use the file; where it turns out to be damaged, repair it and use it again.

        Args:
            work: What to do with it; it is done once more after a repair, and on a full disk.
            what: What that is, such as `written`.

        Raises:
            TransportError: The disk is full or does not answer.
            RouteError: Waiting does not help.
        """
        assert self.is_open, 'open first'
        if self._db is None:
            self._open_database()
        try:
            return self._try(work, what)
        except DamagedError:
            self._close_database()
        self._open_database()
        try:
            return self._try(work, what)
        except DamagedError as error:
            raise _damaged_again(self._path, error) from error

    def _try(self, work: Callable[[sqlite3.Connection], Result], what: str) -> Result:
        assert self._db is not None
        try:
            with translated(self._path, f'cannot be {what}'):
                return work(self._db)
        except TransportError as error:
            if not database.is_full(error):
                raise
        with translated(self._path, f'cannot be {what}'):
            database.merge_log(self._db)
            return work(self._db)

    @contextmanager
    def transaction(self, db: sqlite3.Connection, ledger: Ledger) -> Iterator[None]:
        """Change rows and ledger, both or none.

        Args:
            db: The file, as `use` gives it.
            ledger: What it is then.
        """
        ledger = ledger._replace(change=self.ledger.change + 1)
        db.execute('BEGIN IMMEDIATE')
        try:
            yield
            database.write_ledger(db, ledger)
            ends = database.ends(db)
            db.execute('COMMIT')
        except BaseException:
            if db.in_transaction:
                with contextlib.suppress(sqlite3.Error):  # the first error tells more
                    db.execute('ROLLBACK')
            raise
        self.ledger = ledger
        self.first, self.last = ends
        with contextlib.suppress(OSError):  # only a copy
            self._lock.keep(ledger)

    def begin_again(self) -> None:
        """Delete the file with all that is in it, and make a new one."""
        self._close_database()
        before, ledger = self.ledger, self.ledger.released(self.ledger.high + 1)
        try:
            self.ledger = ledger._replace(change=ledger.change + 1, rows=0, size_bytes=0)
            self._lock.keep(self.ledger)
            database.remove(self._path)
        except OSError as error:
            if os.path.lexists(self._path):  # with all its rows: they are not to be missed
                self.ledger = before
                with contextlib.suppress(OSError):  # it is the older one then, and also right
                    self._lock.keep(before)
            raise database.no_room(self._path, 'cannot be deleted', error) from error
        self._open_database()


def _damaged_again(path: Path, error: DamagedError) -> RouteError:
    return RouteError(
        f'the spool {path} is damaged again as soon as it is repaired ({error}): is the disk or '
        'the memory of this machine failing?'
    )


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
