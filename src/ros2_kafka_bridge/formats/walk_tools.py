"""What the functions that `walk` makes call by name: readers, texts, and what refuses a value.

A refusal says the field, the offset and what was expected; `{0}`, `{1}` in a path stand for the
indices of the loops that it was found in.
"""

import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import DecodeError


class Piece(NamedTuple):
    """Primitives of one width side by side.

    Args:
        path: Of the field; `{0}`, `{1}` stand for the indices of the loops around it.
        offset: Counted from `at`.
        leaves: Names of the primitives in one item; None where the piece is no list.
        times: How many primitives; 0 where only the value says it.
    """

    path: str
    offset: int
    width: int
    leaves: tuple[str, ...] | None
    times: int

    def name(self, number: int) -> str:
        """The path of one of them, counted from 0."""
        if self.leaves is None:
            return self.path
        item, leaf = divmod(number, len(self.leaves))
        return f'{self.path}[{item}]{self.leaves[leaf]}'


def _bad_header(value: bytes) -> DecodeError:
    found = value[:4].hex(' ') or 'nothing'
    return DecodeError(f'encapsulation header: needs 00 00 or 00 01 and 2 bytes, found {found}')


def _short(
    size: int, at: int, pieces: tuple[Piece, ...], indices: tuple[int, ...], items: int = 0
) -> DecodeError:
    """The first of the primitives that reaches behind the end of the value."""
    for piece in pieces:
        start = at + piece.offset
        count = piece.times or items * len(piece.leaves or ())
        if start + piece.width * count > size:
            number = max(0, size - start) // piece.width
            path = piece.name(number).format(*indices)
            offset = start + number * piece.width
            noun = 'byte' if piece.width == 1 else 'bytes'
            return DecodeError(
                f'{path}: needs {piece.width} {noun} at {offset}, the value has {size}'
            )
    raise AssertionError(pieces)


def _too_many(n: int, left: int, at: int, path: str, indices: tuple[int, ...]) -> DecodeError:
    where = path.format(*indices)
    return DecodeError(f'{where}: needs {n} items at {at}, the value has {left} bytes there')


def _over_bound(
    found: int, bound: int, unit: str, at: int, path: str, indices: tuple[int, ...]
) -> DecodeError:
    where = path.format(*indices)
    return DecodeError(f'{where}: at most {bound} {unit}, found {found} at {at}')


def _not_bool(
    value: bytes, at: int, count: int, path: str, indices: tuple[int, ...]
) -> DecodeError:
    number = next(i for i in range(count) if value[at + i] > 1)
    where = path.format(*indices)
    found = value[at + number]
    return DecodeError(f'{where}: needs a bool (0 or 1) at {at + number}, found {found}')


def _narrow(value: bytes, at: int, stop: int, path: str, indices: tuple[int, ...]) -> str:
    """The text of a string whose bytes, NUL included, lie from `at` to `stop`."""
    where = path.format(*indices)
    if stop > len(value):
        raise DecodeError(f'{where}: needs {stop - at} bytes at {at}, the value has {len(value)}')
    if stop == at:
        raise DecodeError(f'{where}: needs a length of at least 1 at {at - 4}, found 0')
    if value[stop - 1]:
        raise DecodeError(f'{where}: needs a NUL at {stop - 1}, found {value[stop - 1]:#04x}')
    inner = value.find(0, at, stop - 1)
    if inner >= 0:
        raise DecodeError(f'{where}: has a NUL inside, at {inner}')
    try:
        return value[at : stop - 1].decode()
    except UnicodeDecodeError as error:
        bad = at + error.start
        raise DecodeError(f'{where}: is not UTF-8 at {bad}: {value[bad]:#04x}') from None


def _wide(value: bytes, at: int, stop: int, path: str, indices: tuple[int, ...]) -> str:
    """The text of a wstring: UTF-16, each unit in 4 bytes, without a NUL behind."""
    where = path.format(*indices)
    if stop > len(value):
        raise DecodeError(f'{where}: needs {stop - at} bytes at {at}, the value has {len(value)}')
    order = 'be' if value[1] == 0 else 'le'
    try:
        units = value[at:stop].decode(f'utf-32-{order}', 'surrogatepass')
        if max(units, default='') > '\uffff':
            raise DecodeError(f'{where}: has a unit of more than 16 bits behind {at}')
        return units.encode('utf-16-le', 'surrogatepass').decode('utf-16-le')
    except UnicodeDecodeError:
        raise DecodeError(f'{where}: is not UTF-16 in units of 4 bytes at {at}') from None


def by_order(code: str) -> tuple[Callable[..., tuple[Any, ...]], ...]:
    """Readers of one primitive, by the second byte of the header."""
    return struct.Struct('>' + code).unpack_from, struct.Struct('<' + code).unpack_from


TOOLS: Final[dict[str, Any]] = {
    'BOOLS': b'\x00\x01',
    'bad_header': _bad_header,
    'narrow': _narrow,
    'not_bool': _not_bool,
    'over_bound': _over_bound,
    'short': _short,
    'too_many': _too_many,
    'u32_by_order': by_order('I'),
    'wide': _wide,
}
