"""A row of the spool: a record with what the bridge must know of it, and its checksum."""

import struct
import zlib
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec

from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, source_time_ns
from ros2_kafka_bridge.route.identity import Identity

ROW_BYTES: Final = 100
"""What a row takes beside its payload, as it is accounted."""

_Body: TypeAlias = tuple[str, bytes | None, bytes | None, list[tuple[str, Any]]]
Stored: TypeAlias = tuple[int, int, int, int, bytes, int, int, bytes]
"""Number, time, size, dead, gid, seq, checksum, body: a row as it stands in the table."""

_FIELDS: Final = struct.Struct('<qqqqq')
_encode: Final = msgspec.msgpack.Encoder().encode
_decode: Final = msgspec.msgpack.Decoder(_Body).decode


class Row(NamedTuple):
    """A record that waits on disk.

    Args:
        number: Given by the spool, ascending, above 0; 0 while the row is not written.
        taken_ns: When the bridge took it, since 1970.
        dead: Whether it is a dead letter, explained already.
        gid: Of its publisher; empty where that was not told.
        seq: Its number at its publisher; 0 where that was not told.
        record: What is to be produced.
    """

    number: int
    taken_ns: int
    dead: bool
    gid: bytes
    seq: int
    record: Outgoing


def identity_of(row: Row) -> Identity:
    """Which message a row holds."""
    return Identity(row.gid, row.seq, source_time_ns(row.record.headers))


def size_of(record: Outgoing) -> int:
    """Bytes that a record is accounted for, in the spool."""
    _, key, value, headers = record
    size = ROW_BYTES + len(key or b'') + len(value or b'')
    for name, text in headers:
        size += len(name) + len(text or b'')
    return size


def pack(row: Row, number: int) -> Stored:
    """A row as it is stored under a number."""
    _, taken_ns, dead, gid, seq, record = row
    size = size_of(record)
    body = _encode(record)
    crc = _checksum(number, taken_ns, size, int(dead), gid, seq, body)
    return number, taken_ns, size, int(dead), gid, seq, crc, body


def is_whole(stored: tuple[Any, ...]) -> bool:
    """Whether a row read from the disk is as it was written."""
    number, taken_ns, size, dead, gid, seq, crc, body = stored
    try:
        return bool(_checksum(number, taken_ns, size, dead, gid, seq, body) == crc)
    except (TypeError, struct.error):  # a damaged row may hold anything of any type
        return False


def unpack(stored: Stored) -> Row | None:
    """A row read from the disk, None where it is not as it was written."""
    if not is_whole(stored):
        return None
    number, taken_ns, _, dead, gid, seq, _, body = stored
    try:
        topic, key, value, headers = _decode(body)
    except msgspec.MsgspecError:
        return None
    if not _are_headers(headers):
        return None
    return Row(number, taken_ns, bool(dead), gid, seq, Outgoing(topic, key, value, headers))


def _are_headers(headers: HeaderList) -> bool:
    return all(text is None or isinstance(text, str | bytes) for _, text in headers)


def _checksum(
    number: int, taken_ns: int, size: int, dead: int, gid: bytes, seq: int, body: bytes
) -> int:
    fields = _FIELDS.pack(number, taken_ns, size, dead, seq)
    return zlib.crc32(body, zlib.crc32(gid, zlib.crc32(fields)))
