"""Records that nobody should write, made from a seed: the same seed makes the same records."""

import random
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

TEXT_TYPE: Final = 'std_msgs/msg/String'
CDR_TYPE: Final = 'test_msgs/msg/UnboundedSequences'

LIMIT_BYTES: Final = 1_000_000
"""max_message_bytes of a route, by default."""

_LARGE_IN: Final = 5000  # one record in so many is about as large as is allowed
_CODE_POINTS: Final = 'aZ0 \u00e9\u4e16\U0001f916\ufffd\u202e\x1b\n'
_NOT_UTF8: Final = (b'\xc0\x80', b'\xed\xa0\x80', b'\xf8\x88', b'\xff', b'\xc3', b'\xf0\x9f\xa4')
_NAMES: Final = (
    b'', b'trace', b'\xff\xfe', b'\xed\xa0\x80', b'a\x00b', b'\x1b[31m', b'x\r\ny', b'{0}', b'%s',
    b'bridge.origin', b'bridge.route', b'ros.topic', b'ros.gid', b'ros.seq', b'dead_letter.error',
    b'dead_letter.offset',
    '\u202eevil'.encode(), b'n' * 5000,
)  # fmt: skip
_LENGTHS: Final = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 10**6, 255)


class Hostile(NamedTuple):
    """A record; the names of its headers are bytes, too."""

    key: bytes | None
    value: bytes | None
    headers: list[tuple[bytes, bytes | None]]


def texts(seed: int, count: int) -> Iterator[Hostile]:
    """Records for a route with `format: text`."""
    rng = random.Random(seed)  # noqa: S311 (no secret)
    for _ in range(count):
        yield _around(rng, _text(rng))


def messages(seed: int, count: int, valid: Sequence[bytes]) -> Iterator[Hostile]:
    """Records for a route with `format: cdr`.

    Args:
        seed: The same makes the same.
        count: How many.
        valid: CDR bytes of messages; the last one is larger than any record may be.
    """
    rng = random.Random(seed)  # noqa: S311 (no secret)
    *small, large = valid
    for _ in range(count):
        yield _around(rng, _message(rng, small, large))


def _around(rng: random.Random, value: bytes | None) -> Hostile:
    return Hostile(_key(rng), value, _headers(rng))


# Values


def _text(rng: random.Random) -> bytes | None:
    if rng.randrange(_LARGE_IN) == 0:
        return b'x' * (LIMIT_BYTES + rng.randint(-2, 2))
    return rng.choice(_TEXTS)(rng)


def _plain(rng: random.Random) -> bytes:
    return bytes(rng.choices(range(1, 128), k=rng.randrange(200)))


def _unicode(rng: random.Random) -> bytes:
    return ''.join(rng.choices(_CODE_POINTS, k=rng.randrange(100))).encode()


def _anything(rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(200))


def _with_nul(rng: random.Random) -> bytes:
    return _put(rng, _plain(rng), b'\0')


def _not_utf8(rng: random.Random) -> bytes:
    return _put(rng, _unicode(rng), rng.choice(_NOT_UTF8))


def _nothing(rng: random.Random) -> bytes | None:
    return rng.choice((b'', None))


_TEXTS: Final[tuple[Callable[[random.Random], bytes | None], ...]] = (
    _plain, _plain, _unicode, _anything, _with_nul, _not_utf8, _nothing,
)  # fmt: skip


def _message(rng: random.Random, small: Sequence[bytes], large: bytes) -> bytes | None:
    if rng.randrange(_LARGE_IN) == 0:
        return large[: LIMIT_BYTES + rng.randint(-2, 2)]
    if rng.randrange(8) == 0:
        return _nothing(rng) if rng.randrange(2) else _anything(rng)
    value = bytearray(rng.choice(small))
    for _ in range(rng.choice((0, 0, 1, 1, 2, 8))):
        rng.choice(_CHANGES)(rng, value)
    return bytes(value)


def _flip(rng: random.Random, value: bytearray) -> None:
    if value:
        value[rng.randrange(len(value))] ^= 1 << rng.randrange(8)


def _cut(rng: random.Random, value: bytearray) -> None:
    del value[rng.randrange(len(value) + 1) :]


def _lengthen(rng: random.Random, value: bytearray) -> None:
    value += rng.randbytes(rng.randrange(1, 9))


def _length(rng: random.Random, value: bytearray) -> None:
    """Put a length where perhaps one is."""
    at = 4 * rng.randrange(1, max(2, len(value) // 4))
    value[at : at + 4] = struct.pack('<I', rng.choice(_LENGTHS))


def _header(rng: random.Random, value: bytearray) -> None:
    value[:4] = bytes((rng.choice((0, 0, 1, 255)), rng.choice((0, 1, 2, 3)), 0, rng.randrange(4)))


def _splice(rng: random.Random, value: bytearray) -> None:
    at = rng.randrange(len(value) + 1)
    value[at:at] = value[rng.randrange(len(value) + 1) :][:100]


_CHANGES: Final = (_flip, _flip, _cut, _lengthen, _length, _header, _splice)


# Keys and headers


def _key(rng: random.Random) -> bytes | None:
    if rng.randrange(_LARGE_IN) == 0:
        return b'k' * rng.choice((100_000, 900_000, LIMIT_BYTES))
    return rng.choice((None, b'', b'key', rng.randbytes(20)))


def _headers(rng: random.Random) -> list[tuple[bytes, bytes | None]]:
    if rng.randrange(_LARGE_IN) == 0:
        return [(b'h', b'')] * rng.choice((999, 1000, 1001, 30_000, 200_000))
    if rng.randrange(_LARGE_IN) == 0:
        return [(rng.choice(_NAMES), b'v' * rng.choice((100_000, 990_000)))]
    if rng.randrange(4):
        return []
    return [_one_header(rng) for _ in range(rng.randrange(1, 8))]


def _one_header(rng: random.Random) -> tuple[bytes, bytes | None]:
    name = rng.choice((*_NAMES, rng.randbytes(rng.randrange(8))))
    return name, rng.choice((None, b'', b'1', rng.randbytes(rng.randrange(50))))


def _put(rng: random.Random, value: bytes, part: bytes) -> bytes:
    at = rng.randrange(len(value) + 1)
    return value[:at] + part + value[at:]
