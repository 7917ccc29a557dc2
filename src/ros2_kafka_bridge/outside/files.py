"""Files that a setting names: a pipe in their place would never end, a device do something."""

import os
import stat
from pathlib import Path
from typing import Final

SIZE_LIMIT_BYTES: Final = 1024 * 1024

_TEXT_MARKS: Final = ('\n', '\r', '-----BEGIN ')  # YAML makes spaces of line ends
_NOT_REGULAR: Final = 'not a regular file: no pipe, socket or device is read here'
_DIRECTORY: Final = 'a directory: name the file in it'
_MISSING: Final = 'no such file'
_FORBIDDEN: Final = 'no permission to read it'


class UnreadableError(Exception):
    """A file cannot be read; the text says why, in words of a sentence."""


def holds_text(value: str) -> bool:
    """Whether what should name a file is the text of one, perhaps of a key: not to be shown."""
    return any(mark in value for mark in _TEXT_MARKS)


def file_problem(
    path: Path, limit_bytes: int = SIZE_LIMIT_BYTES, *, or_directory: bool = False
) -> str | None:
    """Say why a file is not one that a library of others should open; None where it is.

    Links are followed. The file is not opened.

    Args:
        path: The file.
        limit_bytes: The largest that it may be.
        or_directory: Whether it may be a directory as well.
    """
    if holds_text(str(path)):
        return 'holds the text of a file: write the name of the file here'
    try:
        found = path.stat()
        if or_directory and stat.S_ISDIR(found.st_mode):
            return None
        may_read = os.access(path, os.R_OK, effective_ids=True)
        return _problem(found, limit_bytes) or (None if may_read else _FORBIDDEN)
    except (OSError, ValueError) as error:
        return _plain(error)


def read_regular(path: Path, limit_bytes: int = SIZE_LIMIT_BYTES) -> bytes:
    """The content of a regular file, links followed.

    Raises:
        UnreadableError: It is not there, not readable, of another kind, or larger.
    """
    # Opening a device can do something by itself, so it is looked at before; a pipe that takes
    # its place then is opened without waiting for who writes into it.
    if problem := file_problem(path, limit_bytes):
        raise UnreadableError(problem)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        with open(descriptor, 'rb') as file:  # noqa: PTH123 (a descriptor)
            if problem := _problem(os.fstat(descriptor), limit_bytes):
                raise UnreadableError(problem)
            # A few files of the kernel would wait for what happens next: nothing is there then.
            content: bytes = file.read(limit_bytes + 1) or b''
    except (OSError, ValueError) as error:
        raise UnreadableError(_plain(error)) from error
    return _within(content, limit_bytes)


def read_any(path: Path, limit_bytes: int = SIZE_LIMIT_BYTES) -> bytes:
    """The same of a file that somebody names on a command line, which may be a pipe.

    Raises:
        UnreadableError: It is not there, not readable, or larger.
    """
    try:
        with path.open('rb') as file:
            content = file.read(limit_bytes + 1)
    except (OSError, ValueError) as error:
        raise UnreadableError(_plain(error)) from error
    return _within(content, limit_bytes)


def _within(content: bytes, limit_bytes: int) -> bytes:
    if len(content) > limit_bytes:
        raise UnreadableError(_larger(limit_bytes))
    return content


def _problem(found: os.stat_result, limit_bytes: int) -> str | None:
    if stat.S_ISDIR(found.st_mode):
        return _DIRECTORY
    if not stat.S_ISREG(found.st_mode):
        return _NOT_REGULAR
    return _larger(limit_bytes) if found.st_size > limit_bytes else None


def _larger(limit_bytes: int) -> str:
    return f'larger than {limit_bytes} bytes: is it the right file?'


def _plain(error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError | ValueError):  # no file has a NUL in its name
        return _MISSING
    if isinstance(error, IsADirectoryError):
        return _DIRECTORY
    if isinstance(error, PermissionError):
        return _FORBIDDEN
    return error.strerror or 'cannot be read'
