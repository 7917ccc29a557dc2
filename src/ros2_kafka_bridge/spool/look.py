"""What is in a spool, seen without touching it: a bridge may be using it."""

import contextlib
import shutil
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.spool import database, health
from ros2_kafka_bridge.spool.database import DamagedError
from ros2_kafka_bridge.spool.health import log_of
from ros2_kafka_bridge.spool.ledger import Ledger
from ros2_kafka_bridge.spool.lock import copy_in, holder, is_in_use, lock_of
from ros2_kafka_bridge.spool.repair import recover
from ros2_kafka_bridge.spool.rows import Row, unpack

_SOURCE: Final = 'ros.topic'


@dataclass(frozen=True)
class SpoolContents:
    """What a spool holds; a number that is not known is None.

    Args:
        exists: Whether there is a file; None where that cannot be seen.
        messages: How many can be read.
        bytes: What these are accounted for.
        file_bytes: Size of the file and its log.
        oldest_ns: When the bridge took the oldest, since 1970; None where there is none.
        newest_ns: The same of the newest.
        ros_topic: Where the messages come from, by the first of them; empty where it does not say.
        kafka_topic: Where they go.
        dead_letters: How many of them are dead letters.
        version: Of the file.
        is_open: Whether a process has it open; None where that cannot be seen.
        pid: Its number; 0 where none has, None where it runs in another container.
        damage: What is wrong with it; empty if it is well.
        lost: How many messages cannot be read.
        certain: Whether that number is exact: without its lock file there may be more.
        problem: Why nothing of it can be shown; empty if it can.
        rows: The first ones, as many as were asked for.
    """

    path: Path
    exists: bool | None = None
    messages: int | None = None
    bytes: int | None = None
    file_bytes: int | None = None
    oldest_ns: int | None = None
    newest_ns: int | None = None
    ros_topic: str = ''
    kafka_topic: str = ''
    dead_letters: int | None = None
    version: int | None = None
    is_open: bool | None = None
    pid: int | None = None
    damage: str = ''
    lost: int | None = None
    certain: bool = False
    problem: str = ''
    rows: list[Row] = field(default_factory=list)


def look(path: Path, messages: int = 0) -> SpoolContents:
    """See what a spool holds, and whether it is well.

    Args:
        path: Its file.
        messages: How many of its messages to show.
    """
    try:
        found = _look(path, messages)
        began = found.damage and not found.is_open and is_in_use(lock_of(path))
        return _look(path, messages) if began else found  # what is being written looks so
    except OSError as error:
        return replace(_from_outside(path), problem=f'cannot be read: {error.strerror}')
    except BridgeError as error:
        return replace(_from_outside(path), problem=str(error))


def _look(path: Path, messages: int) -> SpoolContents:
    known = copy_in(lock_of(path))
    general = _from_outside(path)
    kind = health.kind_of(path, known)
    if kind == 'missing':
        return _missing(general, known)
    if kind == 'other':
        return replace(general, problem='is not a spool')
    general = replace(general, version=health.version_of(path))
    if kind == 'newer':
        text = f'is of version {general.version}: this program is older than it'
        return replace(general, problem=text)
    return _inside(general, known, messages)


def _from_outside(path: Path) -> SpoolContents:
    """What the directory and the lock tell, also where the file cannot be read."""
    held = holder(lock_of(path))
    general = SpoolContents(path, is_open=held.is_open, pid=held.pid)
    try:
        file_bytes = health.size_of(path) + health.size_of(log_of(path))
    except OSError:
        return general
    return replace(general, exists=path.exists(), file_bytes=file_bytes)


def _missing(general: SpoolContents, known: Ledger | None) -> SpoolContents:
    """Without the file, its lock file tells what was in it, as it does to a bridge that begins."""
    if general.is_open is None:
        text = 'is not there, and its lock file, which tells what was in it, cannot be read'
        return replace(general, problem=text)
    lost = known.rows if known else None
    is_gone = bool(lost) if known else health.has_log(general.path)
    damage = 'the file is missing' if is_gone else ''
    told = replace(general, lost=lost, certain=known is not None)
    return replace(told, messages=0, bytes=0, dead_letters=0, damage=damage)


def _inside(general: SpoolContents, known: Ledger | None, messages: int) -> SpoolContents:
    path, is_live = general.path, bool(general.is_open)
    with _untouched(path, is_live=is_live) as seen:
        try:
            with health.opened(seen, is_live=is_live) as db:
                problem = health.problem_of(db, path, known)
                if not problem:
                    well = replace(general, lost=0, certain=known is not None)
                    return _with_contents(well, db, messages)
        except DamagedError as error:
            problem = str(error)
        try:
            return _what_is_left(replace(general, damage=problem), seen, known, messages)
        except BridgeError as error:
            text = f'is damaged ({problem}), and what is left of it cannot be shown: {error}'
            return replace(general, problem=text)


def _what_is_left(
    general: SpoolContents, path: Path, known: Ledger | None, messages: int
) -> SpoolContents:
    """What a bridge would make of a damaged spool."""
    with _temporary() as place:
        whole = place / path.name
        _, lost, certain = recover(path, known, whole)
        damaged = replace(general, lost=lost if certain or lost else None, certain=certain)
        with health.opened(whole) as db:
            return _with_contents(damaged, db, messages)


@contextlib.contextmanager
def _untouched(path: Path, *, is_live: bool) -> Iterator[Path]:
    """The file, or a copy where SQLite would write beside it: the index of a log left alone."""
    if is_live or not health.has_log(path):
        yield path
        return
    with _temporary() as place:
        copy = place / path.name
        for source, target in ((path, copy), (log_of(path), log_of(copy))):
            try:
                shutil.copyfile(source, target)
            except OSError as error:
                raise TransportError(
                    f'a copy of {source}, to look into it, cannot be made in {place}: '
                    f'{error.strerror}'
                ) from error
        yield copy


@contextlib.contextmanager
def _temporary() -> Iterator[Path]:
    try:
        place = TemporaryDirectory()
    except OSError as error:
        raise TransportError(
            f'there is no directory for temporary files ({error.strerror}): set TMPDIR to one'
        ) from error
    with place as name:
        yield Path(name)


def _with_contents(general: SpoolContents, db: sqlite3.Connection, messages: int) -> SpoolContents:
    count, size_bytes, dead_letters, oldest_ns, newest_ns = db.execute(
        'SELECT count(*), total(size), total(dead), min(taken_ns), max(taken_ns) FROM rows'
    ).fetchone()
    shown = map(unpack, database.rows_after(db, -1, messages))
    first = database.first_alive(db) or next(database.rows_after(db, -1, 1), None)
    record = unpack(first) if first else None
    return replace(
        general,
        messages=count,
        bytes=int(size_bytes),
        oldest_ns=oldest_ns,
        newest_ns=newest_ns,
        ros_topic=_ros_topic(record),
        kafka_topic=record.record.topic if record else '',
        dead_letters=int(dead_letters),
        rows=[row for row in shown if row],
    )


def _ros_topic(row: Row | None) -> str:
    for name, value in row.record.headers if row else ():
        if name == _SOURCE and value is not None:
            return value if isinstance(value, str) else value.decode(errors='replace')
    return ''


def spools_in(directory: Path) -> Iterator[Path]:
    """The spools of a directory, also those of which only the lock file is left.

    Raises:
        OSError: It cannot be read.
    """
    names = {file.name.removesuffix('.lock') for file in directory.iterdir()}
    yield from sorted(directory / name for name in names if name.endswith('.spool'))
