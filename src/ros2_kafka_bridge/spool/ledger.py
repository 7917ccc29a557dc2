"""What must be in a spool: so that what is missing can be counted.

Every row carries a checksum over all its fields. The ledger says which rows there must be; it is
written in the same transaction as they are, and once more into the lock file. A row that was
deleted before does not come back.

The numbers of rows only grow, also where none is left: a page of the file that is no longer in
use can hold no row that could be taken for another.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import Final, NamedTuple

VERSION: Final = 1
MAGIC: Final = b'RKBSPOOL'
_HOLES: Final = 12
_FIELDS: Final = struct.Struct('<8sBQqqqqq')
_HOLE: Final = struct.Struct('<qq')
_CRC: Final = struct.Struct('<I')
_BODY_BYTES: Final = _FIELDS.size + _HOLES * _HOLE.size
LEDGER_BYTES: Final = _BODY_BYTES + _CRC.size

Hole = tuple[int, int]
"""First and last number of rows that were dropped between others."""


class Ledger(NamedTuple):
    """The state of a spool after a transaction.

    Args:
        change: Which transaction it was.
        high: The highest number that was ever written.
        floor: No row below it is there.
        rows: How many are there.
        size_bytes: What they are accounted for.
        holes: What was dropped above the floor.
    """

    change: int = 0
    high: int = 0
    floor: int = 1
    rows: int = 0
    size_bytes: int = 0
    holes: tuple[Hole, ...] = ()

    def holds(self, number: int) -> bool:
        """Whether a row of this number must be there."""
        if not self.floor <= number <= self.high:
            return False
        return not any(first <= number <= last for first, last in self.holes)

    def with_hole(self, first: int, last: int) -> 'Ledger':
        """Say that rows between others were dropped.

        More holes than there is room for forget the lowest: its rows could come again, if the
        file were damaged before they are overwritten.
        """
        holes = [*self._holes_above(self.floor), (first, last)]
        merged: list[Hole] = []
        for begin, end in sorted(holes):
            if merged and begin <= merged[-1][1] + 1:
                merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
            else:
                merged.append((begin, end))
        return self._replace(holes=tuple(merged[-_HOLES:]))

    def released(self, floor: int) -> 'Ledger':
        """Say that nothing below a number is there any more."""
        return self._replace(floor=floor, holes=tuple(self._holes_above(floor)))

    def _holes_above(self, floor: int) -> Iterator[Hole]:
        return (hole for hole in self.holes if hole[1] >= floor)

    def pack(self) -> bytes:
        """Its bytes, with a checksum."""
        holes = b''.join(_HOLE.pack(*hole) for hole in self.holes)
        body = _FIELDS.pack(MAGIC, VERSION, self.change, 0, *self[1:5]) + holes
        body = body.ljust(_BODY_BYTES, b'\0')
        return body + _CRC.pack(zlib.crc32(body))


def newest(data: bytes) -> Ledger | None:
    """The newest ledger that stands anywhere in these bytes, None where none is readable."""
    return max(_found(data), default=None)


def _found(data: bytes) -> Iterator[Ledger]:
    at = data.find(MAGIC)
    while at >= 0:
        if (ledger := _unpack(data[at : at + LEDGER_BYTES])) is not None:
            yield ledger
        at = data.find(MAGIC, at + 1)


def _unpack(data: bytes) -> Ledger | None:
    if len(data) < LEDGER_BYTES:
        return None
    body, (crc,) = data[:_BODY_BYTES], _CRC.unpack_from(data, _BODY_BYTES)
    if zlib.crc32(body) != crc:
        return None
    # Earlier versions gave numbers of their own, and noted how far those were below the table's.
    _, version, change, _below, *numbers = _FIELDS.unpack_from(body)
    if version != VERSION:
        return None
    holes = (_HOLE.unpack_from(body, _FIELDS.size + n * _HOLE.size) for n in range(_HOLES))
    return Ledger(change, *numbers)._replace(holes=tuple(hole for hole in holes if hole != (0, 0)))
