"""Makes a whole spool of what is readable in a damaged one.

A repair can be interrupted at any point. What is readable is written to a file beside it, which
gets the name `.new` when it is whole; only then the damaged file is put aside.
"""

import contextlib
import logging
import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.spool import database, health
from ros2_kafka_bridge.spool.health import has_log, log_of
from ros2_kafka_bridge.spool.ledger import VERSION, Ledger
from ros2_kafka_bridge.spool.rescue import rescue


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


def make_well(
    path: Path, ledgers: Iterable[Ledger], log: logging.LoggerAdapter[logging.Logger]
) -> Damage | None:
    """See that there is a spool, and that it is well. Nobody else may use it meanwhile.

    Args:
        path: Its file.
        ledgers: Copies of its ledger from elsewhere, one for each transaction.
        log: Where to say what was repaired.

    Returns:
        What was damaged; None where nothing was.

    Raises:
        TransportError: There is no room for a repair; nothing was changed.
        RouteError: It is not a spool that this version reads.
    """
    _finish(path)
    known = max(ledgers, default=None)
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
    return _repair(path, problem, known, log) if problem else None


def _problem(path: Path, known: Ledger | None) -> str:
    try:
        with health.opened(path) as db:
            return health.problem_of(db, path, known)
    except database.DamagedError as error:
        return str(error)


def _begin(path: Path, known: Ledger | None) -> None:
    ledger = Ledger() if known is None else known.released(known.high + 1)
    whole = path.with_name(f'{path.name}.salvage')
    database.make(whole, ledger._replace(change=ledger.change + 1), [])
    whole.replace(path)
    database.sync_directory(path)


def _repair(
    path: Path,
    problem: str,
    known: Ledger | None,
    log: logging.LoggerAdapter[logging.Logger],
) -> Damage:
    whole = path.with_name(f'{path.name}.salvage')
    try:
        rows, lost, certain = rescue(path, known, whole)
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
