"""Formats: how a record's value encodes a message. One file each, one table of them.

A format is asked once, when its route starts, for the functions that its loop will call:
`decode` makes the CDR bytes of a message from a record's value, `encode` the reverse.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from ros2_kafka_bridge.formats import cdr, text
from ros2_kafka_bridge.formats.layout import Layout

Decode = Callable[[bytes | None], bytes]
"""Value of a record (None: a tombstone) -> CDR bytes. Raises DecodeError."""

Encode = Callable[[bytes], bytes | None]
"""CDR bytes -> value of a record. Raises EncodeError."""


class MakeDecode(Protocol):
    """Makes the decode function for one message type."""

    def __call__(self, layout: Layout, /) -> Decode:
        """Raises ConfigError where the format cannot carry the type."""
        ...


class MakeEncode(Protocol):
    """Makes the encode function for one message type."""

    def __call__(self, layout: Layout, /) -> Encode:
        """Raises ConfigError where the format cannot carry the type."""
        ...


class Format(NamedTuple):
    """One way to write a message into a record.

    Args:
        message_types: The types that it can carry; None means every type.
    """

    make_decode: MakeDecode
    make_encode: MakeEncode
    message_types: frozenset[str] | None


FORMATS: dict[str, Format] = {
    'text': Format(text.make_decode, text.make_encode, frozenset({'std_msgs/msg/String'})),
    'cdr': Format(cdr.make_decode, cdr.make_encode, None),
}
