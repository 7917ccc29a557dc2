"""Makes a whole spool of what is readable in a damaged one.

A repair can be interrupted at any point. What is readable, by SQLite's own means, is written to a
file beside it, which gets the name `.new` when it is whole; only then the damaged file is put
aside.
"""

import contextlib
import itertools
import os
import shutil
import sqlite3
from collections import deque
from collections.abc import Generator, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.spool import database, health
from ros2_kafka_bridge.spool.database import DamagedError, translated
from ros2_kafka_bridge.spool.health import has_log, log_of
from ros2_kafka_bridge.spool.ledger import VERSION, Ledger, newest
from ros2_kafka_bridge.spool.rows import Stored, is_whole

_BATCH: Final = 500
_FAILURES: Final = 10_000  # a second of looking for what is behind damage
_LAST: Final = 2**63 - 1
# Of the first page (https://sqlite.org/fileformat2.html): how many pages there are (with 0 SQLite
# goes by the size of the file), and what is the same in every spool, all but such counters.
_PAGES: Final = slice(28, 32)
_SAME_IN_ALL: Final = (slice(24), slice(44, 92), slice(100, database.PAGE_BYTES))


class Damage(NamedTuple):
    """What was found to be damaged.

    Args:
        lost: How many rows cannot be read.
        certain: Whether that number is exact.
        kept_as: Where the damaged file was put aside; None where there was none.
    """

    lost: int
    certain: bool
    kept_as: Path | None


def repair(path: Path, known: Ledger | None, log: Log) -> Damage | None:
    """See that there is a spool, and that it is well. Nobody else may use it meanwhile.

    Args:
        path: Its file.
        known: A copy of its ledger from elsewhere.
        log: Where to say what was repaired.

    Returns:
        What was damaged; None where nothing was.

    Raises:
        TransportError: There is no room for a repair; nothing was changed.
        RouteError: It is not a spool that this version reads.
    """
    _finish(path)
    kind = health.kind_of(path, known)
    if kind == 'newer':
        raise RouteError(
            f'the spool {path} is of version {health.version_of(path)}, this program reads '
            f'version {VERSION}: update it, or move the file away (its messages stay in it)'
        )
    if kind == 'other':
        raise RouteError(
            f'{path} is not a spool: move it away, or set spool.path to another directory'
        )
    if kind in {'missing', 'empty'} and not (known and known.rows) and not has_log(path):
        _begin(path, known)
        return None
    problem = _problem(path, known)
    return _rebuild(path, problem, known, log) if problem else None


def _problem(path: Path, known: Ledger | None) -> str:
    try:
        with health.opened(path) as db:
            return health.problem_of(db, path, known)
    except DamagedError as error:
        return str(error)


def _begin(path: Path, known: Ledger | None) -> None:
    ledger = Ledger() if known is None else known.released(known.high + 1)
    whole = path.with_name(f'{path.name}.salvage')
    database.make(whole, ledger._replace(change=ledger.change + 1), [])
    whole.replace(path)
    database.sync_directory(path)


def _rebuild(path: Path, problem: str, known: Ledger | None, log: Log) -> Damage:
    whole = path.with_name(f'{path.name}.salvage')
    try:
        rows, lost, certain = recover(path, known, whole)
    except TransportError as error:
        raise TransportError(
            f'the spool {path} is damaged ({problem}) and cannot be repaired now, nothing '
            f'of it was changed: {error}'
        ) from error
    kept_as = _aside(path, whole) if path.exists() or has_log(path) else None
    log.error(
        'the spool %s is damaged (%s): %s in it can be read, %s%s lost; %s',
        path,
        problem,
        counted(rows, 'message'),
        '' if certain else 'at least ',
        counted(lost, 'message'),
        f'the damaged file is kept as {kept_as}' if kept_as else 'nothing is left of it',
    )
    whole.rename(path.with_name(f'{path.name}.new'))
    _finish(path)
    return Damage(lost, certain, kept_as)


def _finish(path: Path) -> None:
    """Put the damaged file aside, and the whole one in its place."""
    new = path.with_name(f'{path.name}.new')
    if not new.exists():
        return
    aside = _aside(path, new)
    log = log_of(path)
    if has_log(path):  # before the other: it would be taken for the log of the new file
        log.rename(log_of(aside))
    log.unlink(missing_ok=True)
    path.with_name(f'{path.name}-shm').unlink(missing_ok=True)
    with contextlib.suppress(FileNotFoundError, FileExistsError):
        os.link(path, aside)
    for name in (aside, log_of(aside)):
        with contextlib.suppress(OSError):
            name.chmod(0o600)
    new.replace(path)
    database.sync_directory(path)


def _aside(path: Path, whole: Path) -> Path:
    """Where the damaged file goes: the same name, also where a repair is taken up again."""
    made = datetime.fromtimestamp(whole.stat().st_mtime, UTC)
    return path.with_name(f'{path.name}.damaged-{made:%Y%m%dT%H%M%S.%fZ}')


class Recovered(NamedTuple):
    """What came of it.

    Args:
        rows: How many rows could be read.
        lost: How many could not.
        certain: Whether that number is exact.
    """

    rows: int
    lost: int
    certain: bool


def recover(path: Path, known: Ledger | None, target: Path) -> Recovered:
    """Make a whole spool of what can be read.

    Args:
        path: The damaged one.
        known: A copy of its ledger from elsewhere.
        target: Where the whole one is made; it is on the disk when this returns.

    Raises:
        TransportError: There is no room for it, or the disk does not answer.
        RouteError: It may not be read, or not be made.
    """
    found = max(filter(None, (known, _newest_ledger(path))), default=None)
    ledger = found or Ledger()
    copy = target.with_name(f'{target.name}.copy')
    with contextlib.closing(_readable(path, found, copy)) as right:
        batches = iter(lambda: list(itertools.islice(right, _BATCH)), [])
        made = database.make(target, ledger._replace(change=ledger.change + 1), batches)
    lost = (ledger.rows if found else made.high - made.floor + 1) - made.rows
    # The copy beside the file is at most one transaction behind, unless the machine went down.
    certain = found is not None and known is not None and found.change <= known.change + 1
    return Recovered(made.rows, max(0, lost), certain and lost >= 0)


def _newest_ledger(path: Path) -> Ledger | None:
    found = [health.beginning_of(path)] if path.exists() else []
    with contextlib.suppress(DamagedError), health.opened(path) as db:
        found += database.copies_of_ledger(db)
    return max(filter(None, map(newest, found)), default=None)


def _readable(path: Path, ledger: Ledger | None, copy: Path) -> Generator[Stored, None, None]:
    """The rows that are whole and must be there, in no order; one may come twice."""
    yield from _rows_in(path, ledger)
    with _with_fresh_first_page(path, copy) as is_made:
        if is_made:
            yield from _rows_in(copy, ledger)


@contextlib.contextmanager
def _with_fresh_first_page(path: Path, copy: Path) -> Iterator[bool]:
    """Make a copy whose first page leads to all others; none where that of the file does."""
    try:
        database.make(copy, Ledger(), [])
        fresh = health.beginning_of(copy)[: database.PAGE_BYTES]
        if _leads_to_all(path, fresh):
            yield False
            return
        shutil.copyfile(path, copy)
        if has_log(path):
            shutil.copyfile(log_of(path), log_of(copy))
        with copy.open('r+b') as file:
            file.write(fresh[: _PAGES.start] + bytes(4) + fresh[_PAGES.stop :])
        yield True
    except OSError as error:
        raise database.no_room(copy, 'cannot be made', error) from error
    finally:
        database.remove(copy)


def _leads_to_all(path: Path, fresh: bytes) -> bool:
    """Whether the first page of a file is as it was made; so it is, where there is no file."""
    if not health.size_of(path):
        return True
    found = health.beginning_of(path)
    pages = health.size_of(path) // database.PAGE_BYTES
    is_same = all(found[part] == fresh[part] for part in _SAME_IN_ALL)
    return is_same and int.from_bytes(found[_PAGES]) >= pages


def _rows_in(path: Path, ledger: Ledger | None) -> Iterator[Stored]:
    first, last = (ledger.floor, ledger.high) if ledger else (0, _LAST)
    # A damaged log hides pages of the file.
    for with_log in (True, False) if has_log(path) else (True,):
        with contextlib.suppress(DamagedError), health.opened(path, with_log=with_log) as db:
            db.text_factory = bytes  # a damaged row may hold anything of any type
            db.execute('PRAGMA writable_schema=ON')  # or SQLite refuses what was cut off
            for stored in _whole_rows(db, path, first, last):
                if ledger is None or ledger.holds(stored[0]):
                    yield stored


def _whole_rows(db: sqlite3.Connection, path: Path, first: int, last: int) -> Iterator[Stored]:
    """The rows from the first on, and from the last, each up to damage; then what is between."""
    try:
        with translated(path, 'cannot be read'):
            for stored in filter(is_whole, database.all_rows(db, 'ASC')):
                yield stored
                first = stored[0] + 1
    except DamagedError:
        with contextlib.suppress(DamagedError), translated(path, 'cannot be read'):
            for stored in filter(is_whole, database.all_rows(db, 'DESC')):
                yield stored
                last = stored[0] - 1
        yield from _between(db, path, first, last)


def _between(db: sqlite3.Connection, path: Path, first: int, last: int) -> Iterator[Stored]:
    """The rows of a range; where SQLite meets damage, it is asked for both halves of the rest."""
    ranges, failures = deque([(first, last)]), 0
    while ranges and failures < _FAILURES:
        first, last = ranges.popleft()
        try:
            with translated(path, 'cannot be read'):
                # All above: a damaged number that is far too high would be taken for the end.
                for stored in filter(is_whole, database.rows_after(db, first - 1, -1)):
                    yield stored
                    first = max(first, stored[0] + 1)
                    if first > last:
                        break
        except DamagedError:
            failures += 1
            if first < last:
                middle = (first + last) // 2
                ranges += [(first, middle), (middle + 1, last)]
