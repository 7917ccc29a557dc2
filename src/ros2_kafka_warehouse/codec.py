"""Messages as JSON and back; errors name the field."""

from typing import TypeVar

import msgspec

from ros2_kafka_warehouse.messages.message import Message

M = TypeVar('M', bound=Message)

_ENCODER = msgspec.json.Encoder()


class MessageError(ValueError):
    """A text that is not the message that it should be; says which field is wrong."""


def encode(message: Message) -> str:
    """A message as JSON."""
    return _ENCODER.encode(message).decode()


def decode(text: str | bytes, kind: type[M]) -> M:
    """A message from JSON.

    Raises:
        MessageError: The text is not JSON, or a field is missing or of another type.
    """
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise MessageError(f'no {kind.__name__}: {error}') from error
