"""cdr: the record's value is the CDR bytes of the message, as ROS 2 sends them.

Bytes are looked at, never changed: DDS takes garbage without a word, and readers drop it so.
"""

from collections.abc import Callable

from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats.looks import another_format
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.walk import make_end
from ros2_kafka_bridge.message_types.layout import Layout, has_slack


def make_decode(layout: Layout, _scope: Scope) -> Callable[[bytes | None], bytes]:
    """Make the function from a record's value to the same bytes, without padding behind.

    Returns:
        The function. It raises DecodeError for a null value and for what is not one message
        of this type; where nothing is to be cut off, it returns the same object.
    """
    exact = make_exact(layout)

    def decode(value: bytes | None) -> bytes:
        if value is None:
            raise DecodeError('the value is null (a tombstone), and cdr has no message for it')
        try:
            return exact(value)
        except DecodeError as error:
            raise DecodeError(f'{error}{another_format(value, "cdr")}') from None

    return decode


def make_encode(layout: Layout, _scope: Scope) -> Callable[[bytes], bytes]:
    """Make the function from a message's bytes to the same bytes, without padding behind.

    Returns:
        The function. It raises EncodeError for what is not one message of this type.
    """
    exact = make_exact(layout)

    def encode(message: bytes) -> bytes:
        try:
            return exact(message)
        except DecodeError as error:
            raise EncodeError(str(error)) from None

    return encode


def make_exact(layout: Layout) -> Callable[[bytes], bytes]:
    """Make the function that validates a message and cuts off the padding behind it.

    Returns:
        The function. It raises DecodeError for what is not one message of this type.
    """
    end_of = make_end(layout)
    slack = has_slack(layout)

    def exact(value: bytes) -> bytes:
        fields_end = end_of(value)
        size = len(value)
        if fields_end == size and not value[3] & 3:
            return value
        # Some vendors pad and say so in the header: readers cut that much off.
        end = fields_end + (value[3] & 3)
        behind = size - end
        if behind < 0:
            raise DecodeError(
                f'padding: needs {end - fields_end} bytes at {fields_end}, as the '
                f'header says, the value has {size}'
            )
        if not value[1]:
            _check_big_endian(size, fields_end, end, slack=slack)
        if not behind:
            return value
        # Slack of 4 bytes comes from a field that has at least 4 bytes itself.
        if behind > (end if slack else 3):
            raise DecodeError(f'{behind} bytes behind the last field, at {end}')
        return value[:end]

    return exact


def _check_big_endian(size: int, fields_end: int, end: int, *, slack: bool) -> None:
    """Refuse what is padded as no message is; also what would be without the padding.

    The id of a schema before the doubles of a Twist, in Avro, looks like a header.
    """
    # Slack is not counted from a multiple of 4.
    is_padded = not size % 4 or (slack and size - fields_end > 3)
    if not is_padded or (end != fields_end and end % 4):
        raise DecodeError(
            f'{size - fields_end} bytes behind the last field, at {fields_end}, which do not '
            'pad a message in big endian to a multiple of 4'
        )
