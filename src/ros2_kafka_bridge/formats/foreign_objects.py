"""json: objects that are no message of the type, though each of their fields may be passed over.

They are looked at only where a value was refused, or has set no field of the message.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from ros2_kafka_bridge.message_types.layout import Layout

_ENVELOPE: Final = frozenset({'schema', 'payload'})
_WITHOUT_SCHEMAS: Final = 'value.converter.schemas.enable=false'
_AS_TEXT: Final = 'value.converter=org.apache.kafka.connect.storage.StringConverter'


class _Envelope(msgspec.Struct, forbid_unknown_fields=True):
    """An object of these two fields: at another one, nothing more is read."""

    schema: msgspec.Raw
    payload: msgspec.Raw


class _ConnectSchema(msgspec.Struct):
    """What Kafka Connect writes of every schema."""

    type: str
    optional: bool


class _Empty(msgspec.Struct, forbid_unknown_fields=True):
    """An object without fields."""


def make_foreign_reason(layout: Layout) -> Callable[[bytes], str | None]:
    """Make the function that tells why an object that is JSON is no message.

    Its names are not said: they may be data of whoever passes over unknown fields. Nor are they
    kept: a million of them would take a second, in which no other route runs.

    Returns:
        The function. It returns None for an object that has a field of the type, and for `{}`.
        It raises UnicodeDecodeError where the name of the first field is not UTF-8, and
        RecursionError for what is nested too deeply.
    """
    names = {f'f{number}': field.name for number, field in enumerate(layout.fields)}
    members = [(member, msgspec.Raw, msgspec.Raw()) for member in names]
    own_of = msgspec.json.Decoder(msgspec.defstruct('Own', members, rename=names)).decode
    without = msgspec.structs.astuple(own_of(b'{}'))

    def reason(value: bytes) -> str | None:
        if msgspec.structs.astuple(own_of(value)) != without or _is_empty(value):
            return None
        return envelope(value, layout) or f'no field of it is one of {layout.type_name}'

    return reason


def envelope(value: bytes, layout: Layout) -> str | None:
    """Say that a refused value is in Kafka Connect's envelope, and what to do; else None.

    Raises:
        RecursionError: It is nested too deeply.
    """
    try:
        found = msgspec.json.decode(value, type=_Envelope)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
    return _envelope(found, _own_names(layout))


def may_hide_envelope(layout: Layout) -> bool:
    """Whether a message of the type may be made of Kafka Connect's envelope itself."""
    return not layout.fields or len(_ENVELOPE & _own_names(layout)) == 1


def _own_names(layout: Layout) -> frozenset[str]:
    return frozenset(field.name for field in layout.fields)


def _is_empty(value: bytes) -> bool:
    try:
        msgspec.json.decode(value, type=_Empty)
    except msgspec.ValidationError:
        return False
    return True


def _envelope(found: _Envelope, own: frozenset[str]) -> str | None:
    """`own` are the names of the type's fields, which may be these themselves."""
    if own >= _ENVELOPE:
        return None
    schema = _schema_of(found.schema)
    if schema is None and (bytes(found.schema) != b'null' or own & _ENVELOPE):
        return None
    is_text = schema is not None and schema.type == 'string'
    around = ' around null (a tombstone)' if bytes(found.payload) == b'null' else ''
    return (
        f"in Kafka Connect's envelope{around}: set {_AS_TEXT if is_text else _WITHOUT_SCHEMAS} "
        'for the connector that writes it, or for its worker'
    )


def _schema_of(raw: msgspec.Raw) -> _ConnectSchema | None:
    try:
        return msgspec.json.decode(raw, type=_ConnectSchema)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
