"""Where a spool lies: its directory, its files, and what must not be in their place.

Each route that asks for one has its own, `<directory>/<bridge>.<route>.spool`, and beside it:

    .spool-wal, .spool-shm        SQLite's own, while it is open or after a crash
    .spool.lock                   who has it open, and a copy of its ledger
    .spool.damaged-<UTC time>     a file that was damaged, put aside; the spool goes on without it
    .spool.salvage, .salvage.copy, .new    for a moment, while a damaged one is repaired
"""

import os
import stat
from pathlib import Path

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.spool import database


def make_directory(path: Path) -> None:
    """Make the directory of a spool, if it is not there.

    Raises:
        RouteError: It cannot be made, or not be written.
    """
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


def files_of(path: Path) -> list[Path]:
    """The file, and what SQLite keeps beside it."""
    return [path.with_name(path.name + suffix) for suffix in ('', '-wal', '-shm')]


def refuse_other_kinds(path: Path) -> None:
    """See that the files of a spool are regular ones, or not there.

    Raises:
        RouteError: One is something else; a link would change what it leads to.
    """
    for file in files_of(path):
        try:
            mode = file.lstat().st_mode
        except FileNotFoundError:
            continue
        except OSError as error:
            raise database.no_room(file, 'cannot be seen', error) from error
        if not stat.S_ISREG(mode):
            kind = 'a directory' if stat.S_ISDIR(mode) else 'no regular file'
            raise RouteError(
                f'the spool {file} is {kind}: move it away, or set spool.path to another'
            )
