"""Reads rows out of the pages of an SQLite file without SQLite, as far as they can be read.

SQLite gives up a whole branch of its tree with one damaged page in it. Here every page is looked
at on its own, in the file and in its log, and each row proves itself by its checksum: only what
stood in the damaged bytes is missing. Rows may come several times, and rows that were deleted
may come, too: the ledger tells.

The format: https://www.sqlite.org/fileformat2.html
"""

import itertools
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Self, cast

from ros2_kafka_bridge.spool.database import PAGE_BYTES
from ros2_kafka_bridge.spool.ledger import MAGIC, Ledger, newest
from ros2_kafka_bridge.spool.rows import Stored, is_whole

_LEAF: Final = 13
_LEAF_HEADER_BYTES: Final = 8
_MAX_LOCAL: Final = PAGE_BYTES - 35
_MIN_LOCAL: Final = (PAGE_BYTES - 12) * 32 // 255 - 23
_OVERFLOW_BYTES: Final = PAGE_BYTES - 4
_LOG_HEADER_BYTES: Final = 32
_FRAME_HEADER_BYTES: Final = 24
_FRAME: Final = struct.Struct('>II8s')
_COLUMNS: Final = 8
_INTEGER_BYTES: Final = (0, 1, 2, 3, 4, 6, 8)
_BROKEN: Final = (IndexError, OSError, ValueError, struct.error)


class Pages:
    """The pages of a file and of its log."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = self._log = -1
        self._pages = 0
        self._frames: list[int] = []  # where each page in the log begins
        self._newest: dict[int, int] = {}  # page number -> where its last image in the log begins

    def __enter__(self) -> Self:
        self._file, size = _open(self._path)
        self._pages = -(-size // PAGE_BYTES)
        self._log, size = _open(self._path.with_name(self._path.name + '-wal'))
        self._look_at_log(size)
        return self

    def __exit__(self, *_: object) -> None:
        for file in (self._file, self._log):
            if file >= 0:
                os.close(file)

    def _look_at_log(self, size: int) -> None:
        frames: list[tuple[int, int, int, bytes]] = []
        step = _FRAME_HEADER_BYTES + PAGE_BYTES
        for at in range(_LOG_HEADER_BYTES, size, step):
            header = self._read(self._log, at, _FRAME_HEADER_BYTES)
            number, pages, salt = _FRAME.unpack_from(header)
            frames.append((at + _FRAME_HEADER_BYTES, number, pages, salt))
        self._frames = [at for at, *_ in frames]
        own = [frame for frame in frames if frame[3] == frames[0][3]]
        committed = max((n + 1 for n, (_, _, pages, _) in enumerate(own) if pages), default=0)
        self._newest = {number: at for at, number, _, _ in own[:committed]}

    def ledger(self) -> Ledger | None:
        """The newest ledger in any page."""
        found = (newest(page) for page in self._images())
        return max((ledger for ledger in found if ledger), default=None)

    def rows(self) -> Iterator[Stored]:
        """All rows that prove to be whole."""
        for page in self._images():
            yield from self._rows_in(page)

    def has_rows(self, pages: int) -> bool:
        """Whether a row stands in the first pages of the file."""
        images = itertools.islice(self._images(), pages)
        return any(True for page in images for _ in self._rows_in(page))

    def _images(self) -> Iterator[bytes]:
        for number in range(self._pages):
            yield self._read(self._file, number * PAGE_BYTES, PAGE_BYTES)
        for at in self._frames:
            yield self._read(self._log, at, PAGE_BYTES)

    def _image(self, number: int) -> bytes:
        """The newest image of a page."""
        if (at := self._newest.get(number)) is not None:
            return self._read(self._log, at, PAGE_BYTES)
        if not 0 < number <= self._pages:
            raise ValueError(number)
        return self._read(self._file, (number - 1) * PAGE_BYTES, PAGE_BYTES)

    @staticmethod
    def _read(file: int, at: int, size: int) -> bytes:
        """Read; what is missing or does not come from the disk is zeros."""
        try:
            return os.pread(file, size, at).ljust(size, b'\0')
        except OSError:
            return bytes(size)

    def _rows_in(self, page: bytes) -> Iterator[Stored]:
        count = int.from_bytes(page[3:5])
        room = (PAGE_BYTES - _LEAF_HEADER_BYTES) // 2
        places = [
            int.from_bytes(page[at : at + 2]) for at in range(8, 8 + 2 * min(count, room), 2)
        ]
        if page[0] != _LEAF and not (places and self._row_at(page, places[0])):
            return
        broken = count > room
        for place in places:
            row = self._row_at(page, place)
            if row is not None:
                yield row
            broken = broken or row is None
        if (
            broken and MAGIC not in page
        ):  # where the list of places is damaged, the rows may still be there
            found = (self._row_at(page, place) for place in range(PAGE_BYTES))
            yield from (row for row in found if row is not None)

    def _row_at(self, page: bytes, at: int) -> Stored | None:
        try:
            size, at = _varint(page, at)
            number, at = _varint(page, at)
            if page[at] > 40 or page[at + 1] != 0:  # a row begins with the sizes of its columns
                return None
            stored = (number - (number >> 63 << 64), *_columns(self._payload(page, at, size)))
        except _BROKEN:
            return None
        return cast('Stored', stored) if is_whole(stored) else None

    def _payload(self, page: bytes, at: int, size: int) -> bytes:
        if size <= _MAX_LOCAL:
            return page[at : at + size]
        if size > PAGE_BYTES * (self._pages + len(self._frames)):
            raise ValueError(size)
        local = _MIN_LOCAL + (size - _MIN_LOCAL) % _OVERFLOW_BYTES
        local = local if local <= _MAX_LOCAL else _MIN_LOCAL
        parts = [page[at : at + local]]
        number, left = int.from_bytes(page[at + local : at + local + 4]), size - local
        while left > 0:
            image = self._image(number)
            number = int.from_bytes(image[:4])
            parts.append(image[4 : 4 + left])
            left -= _OVERFLOW_BYTES
        return b''.join(parts)


def _open(path: Path) -> tuple[int, int]:
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return -1, 0
    return file, os.fstat(file).st_size


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for end in range(at, at + 8):
        byte = data[end]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, end + 1
    return value << 8 | data[at + 8], at + 9


def _columns(record: bytes) -> list[Any]:
    """The columns of a record behind the number, which is stored beside it."""
    end, at = _varint(record, 0)
    kinds: list[int] = []
    while at < end:
        kind, at = _varint(record, at)
        kinds.append(kind)
    if len(kinds) != _COLUMNS:
        raise ValueError(kinds)
    values: list[Any] = []
    for kind in kinds[1:]:
        size = (kind - 12) // 2 if kind >= 12 else 0 if kind >= 8 else _INTEGER_BYTES[min(kind, 6)]
        data = record[at : at + size]
        at += size
        if kind in {8, 9}:
            values.append(kind - 8)
        elif kind < 7:
            values.append(int.from_bytes(data, signed=True))
        else:
            values.append(data)
    return values
