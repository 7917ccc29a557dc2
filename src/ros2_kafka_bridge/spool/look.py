"""What is in a spool, seen without touching it: a bridge may be using it."""

import itertools
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.spool import database, health
from ros2_kafka_bridge.spool.database import DamagedError
from ros2_kafka_bridge.spool.ledger import Ledger
from ros2_kafka_bridge.spool.lock import Holder, copy_in, holder, lock_of
from ros2_kafka_bridge.spool.pages import Pages
from ros2_kafka_bridge.spool.rows import Row, Stored, unpack

_SOURCE: Final = 'ros.topic'


@dataclass(frozen=True)
class SpoolContents:
    """What a spool holds.

    Args:
        messages: How many can be read.
        bytes: What these are accounted for.
        file_bytes: Size of the file and its log.
        oldest_ns: When the bridge took the oldest, since 1970; None where there is none.
        newest_ns: The same of the newest.
        ros_topic: Where the messages come from, by the first of them; empty where it does not say.
        kafka_topic: Where they go.
        dead_letters: How many of them are dead letters.
        version: Of the file.
        is_open: Whether a process has it open.
        pid: Its number; 0 where none has, and where it runs in another container.
        damage: What is wrong with it; empty if it is well.
        lost: How many messages cannot be read, as far as that is known.
        problem: Why nothing of it can be shown; empty if it can.
        rows: The first ones, as many as were asked for.
    """

    path: Path
    messages: int = 0
    bytes: int = 0
    file_bytes: int = 0
    oldest_ns: int | None = None
    newest_ns: int | None = None
    ros_topic: str = ''
    kafka_topic: str = ''
    dead_letters: int = 0
    version: int | None = None
    is_open: bool = False
    pid: int = 0
    damage: str = ''
    lost: int = 0
    problem: str = ''
    rows: list[Row] = field(default_factory=list)

    @property
    def exists(self) -> bool:
        """Whether there is a file."""
        return self.version is not None


class _Sums(NamedTuple):
    messages: int
    bytes: int
    dead_letters: int
    oldest_ns: int | None
    newest_ns: int | None


def look(path: Path, messages: int = 0) -> SpoolContents:
    """See what a spool holds, and whether it is well.

    Args:
        path: Its file.
        messages: How many of its messages to show.
    """
    try:
        kind = health.kind_of(path)
        if kind in {'missing', 'other', 'newer'}:
            return SpoolContents(path, problem=_refusal(path, kind))
        return _look(path, kind, messages)
    except OSError as error:
        return SpoolContents(path, problem=f'cannot be read: {error.strerror}')
    except BridgeError as error:
        return SpoolContents(path, problem=str(error))


def _refusal(path: Path, kind: health.FileKind) -> str:
    if kind == 'missing':
        return ''
    if kind == 'newer':
        return f'is of version {health.version_of(path)}: this program is older than it'
    return 'is not a spool'


def _look(path: Path, kind: health.FileKind, messages: int) -> SpoolContents:
    copy = copy_in(lock_of(path))
    held, problem = holder(lock_of(path)), ''
    if not held.is_open and health.has_broken_log(path):
        problem = 'its log does not begin as it was written'
    elif kind == 'spool' and health.can_be_opened(path, is_live=held.is_open):
        try:
            with health.opened_to_read(path, is_live=held.is_open) as db:
                problem = health.problem_of(db, path, copy)
                if not problem:
                    return _contents_of(db, path, held, messages)
        except DamagedError as error:
            problem = str(error)
    return _contents_of_pages(path, held, problem or _reason(kind), copy, messages)


def _reason(kind: health.FileKind) -> str:
    if kind == 'empty':
        return 'the file is empty'
    return 'its header is not as it was written' if kind == 'damaged' else ''


def _contents_of(db: sqlite3.Connection, path: Path, held: Holder, messages: int) -> SpoolContents:
    sums = _Sums._make(
        db.execute(
            'SELECT count(*), total(size), total(dead), min(taken_ns), max(taken_ns) FROM rows'
        ).fetchone()
    )
    base = database.read_ledger(db).base
    shown = [unpack(stored, stored[0] - base) for stored in database.rows_after(db, -1, messages)]
    alive = database.first_alive(db) or next(database.rows_after(db, -1, 1), None)
    return _made(path, held, sums, [row for row in shown if row], alive)


def _contents_of_pages(
    path: Path, held: Holder, problem: str, copy: Ledger | None, messages: int
) -> SpoolContents:
    """What SQLite cannot read, or not without making files of its own."""
    with Pages(path) as pages:
        ledger = max(filter(None, (copy, pages.ledger())), default=None)
        places = {
            stored[0]: (stored[1], stored[2], stored[3])
            for stored in pages.rows()
            if ledger is None or ledger.holds(stored[0])
        }
        first = frozenset(itertools.islice(sorted(places), max(1, messages)))
        found = {stored[0]: stored for stored in pages.rows() if stored[0] in first}
    times = [taken_ns for taken_ns, _, _ in places.values()]
    sums = _Sums(
        len(places),
        sum(size for _, size, _ in places.values()),
        sum(dead for _, _, dead in places.values()),
        min(times, default=None),
        max(times, default=None),
    )
    lost = max(0, ledger.rows - len(places)) if ledger else 0
    if lost and not problem:
        problem = 'not all of it can be read'
    base = ledger.base if ledger else 0
    ordered = [found[number] for number in sorted(found)]
    shown = [unpack(stored, stored[0] - base) for stored in ordered[:messages]]
    alive = next((stored for stored in ordered if not stored[3]), next(iter(ordered), None))
    contents = _made(path, held, sums, [row for row in shown if row], alive)
    return _with(contents, problem, lost)


def _with(contents: SpoolContents, problem: str, lost: int) -> SpoolContents:
    return SpoolContents(**{**vars(contents), 'damage': problem, 'lost': lost})


def _made(
    path: Path, held: Holder, sums: _Sums, rows: list[Row], alive: Stored | None
) -> SpoolContents:
    record = _record(alive)
    return SpoolContents(
        path=path,
        messages=sums.messages,
        bytes=int(sums.bytes),
        file_bytes=_size(path) + _size(path.with_name(f'{path.name}-wal')),
        oldest_ns=sums.oldest_ns,
        newest_ns=sums.newest_ns,
        ros_topic=_ros_topic(record),
        kafka_topic=record.record.topic if record else '',
        dead_letters=int(sums.dead_letters),
        version=health.version_of(path),
        is_open=held.is_open,
        pid=held.pid,
        rows=rows,
    )


def _record(stored: Stored | None) -> Row | None:
    return unpack(stored, stored[0]) if stored else None


def _ros_topic(row: Row | None) -> str:
    for name, value in row.record.headers if row else ():
        if name == _SOURCE and value is not None:
            return value if isinstance(value, str) else value.decode(errors='replace')
    return ''


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def spools_in(directory: Path) -> Iterator[Path]:
    """The spools of a directory.

    Raises:
        OSError: It cannot be read.
    """
    yield from sorted(file for file in directory.iterdir() if file.suffix == '.spool')
