"""text: a std_msgs/msg/String whose text is the record's value, as UTF-8.

The bytes of such a message are a fixed prefix, its length, the text and a NUL.
"""

import struct
from collections.abc import Callable
from typing import Final

from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.formats.looks import another_format
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Layout

MESSAGE_TYPE: Final = 'std_msgs/msg/String'

# The kind of encapsulation, then the length if that is little endian.
_BEGIN: Final = struct.Struct('<HxxI').unpack_from
_LITTLE: Final = 0x0100
_BIG: Final = 0
_LENGTH_BIG: Final = struct.Struct('>I').unpack_from
# The header of little endian, then the length.
_PREFIX: Final = struct.Struct('<4sI').pack
_HEADER: Final = b'\x00\x01\x00\x00'


def make_decode(layout: Layout, _scope: Scope) -> Callable[[bytes | None], bytes]:
    """Make the function from a record's value to the CDR bytes of a String.

    Returns:
        The function. It raises DecodeError for a null value, a NUL, and what is not UTF-8.

    Raises:
        ConfigError: The type is not std_msgs/msg/String.
    """
    _check_type(layout)
    return _decode


def make_encode(layout: Layout, _scope: Scope) -> Callable[[bytes], bytes]:
    """Make the function from the CDR bytes of a String to a record's value.

    Returns:
        The function. It raises EncodeError for bytes that are no String, and for a text that
        has a NUL or is not UTF-8.

    Raises:
        ConfigError: The type is not std_msgs/msg/String.
    """
    _check_type(layout)
    return _encode


def _check_type(layout: Layout) -> None:
    if layout.type_name != MESSAGE_TYPE:
        raise ConfigError([f'text carries {MESSAGE_TYPE}, not {layout.type_name}'])


def _decode(value: bytes | None) -> bytes:
    if value is None:
        raise DecodeError('the value is null (a tombstone), and text has no message for it')
    if 0 in value or not value.isascii():
        try:
            _check_text(value)
        except DecodeError as error:
            # Text may begin as JSON does, but not with a NUL as the others do.
            hint = '' if value[0] else another_format(value, 'text')
            raise DecodeError(f'{error}{hint}') from None
    return _PREFIX(_HEADER, len(value) + 1) + value + b'\0'


def _encode(message: bytes) -> bytes:
    size = len(message)
    if size < 9:
        raise _no_string(message)
    kind, length = _BEGIN(message)
    if kind != _LITTLE:
        if kind != _BIG:
            raise _no_string(message)
        (length,) = _LENGTH_BIG(message, 4)
    nul = 7 + length
    text = message[8:nul]
    is_plain = 8 <= nul < size <= nul + 4 and not message[nul] and 0 not in text
    if not is_plain or not text.isascii():
        _check_string(message, nul)
    return text


def _no_string(message: bytes) -> EncodeError:
    found = message[:4].hex(' ') or 'nothing'
    return EncodeError(f'not the bytes of a String: {len(message)} bytes, from {found} on')


def _check_text(value: bytes) -> None:
    """Look again, slowly, at a value that is not plain ASCII."""
    if 0 in value:
        raise DecodeError(f'a NUL at byte {value.index(0)}: ROS strings cannot hold it')
    try:
        value.decode()
    except UnicodeDecodeError as error:
        found = value[error.start]
        raise DecodeError(f'not UTF-8 at byte {error.start}: {found:#04x}') from None


def _check_string(message: bytes, nul: int) -> None:
    """Look again, slowly, at a message that is not plain ASCII."""
    if nul < 8 or nul >= len(message) or message[nul]:
        length = nul - 7
        raise EncodeError(
            f'data: a length of {length} at 4 and no NUL at {nul}, in {len(message)} bytes'
        )
    if len(message) > nul + 4:
        raise EncodeError(f'{len(message) - nul - 1} bytes behind the String, at {nul + 1}')
    try:
        _check_text(message[8:nul])
    except DecodeError as error:
        raise EncodeError(f'data: {error}') from None
