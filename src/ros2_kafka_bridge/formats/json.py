"""json: the fields of the message as one JSON object, by their names in ROS.

JSON is decoded straight into the structs of the message type, so that a wrong field is found
where it stands, and its path is told.
"""

import codecs
import json
import re
from collections.abc import Callable
from contextlib import suppress
from operator import is_
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.foreign_objects import (
    envelope,
    make_foreign_reason,
    may_hide_envelope,
)
from ros2_kafka_bridge.formats.looks import another_format, framed_json
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.values.read import make_read
from ros2_kafka_bridge.formats.values.structs import (
    NON_FINITE,
    Structs,
    Style,
    explain,
    make_structs,
)
from ros2_kafka_bridge.formats.values.write import make_write
from ros2_kafka_bridge.message_types.layout import Layout, Scalar, layouts_in

_DIALECT: Final = 'https://json-schema.org/draft/2020-12/schema'


def make_decode(layout: Layout, scope: Scope) -> Callable[[bytes | None], bytes]:
    """Make the function from a record's value to the CDR bytes of a message.

    Returns:
        The function. It raises DecodeError for a null value, for what is not JSON, and, with
        the path of the field, for what the message type or the route's settings refuse.
    """
    style = _style(scope.json)
    struct = make_structs(layout, style)[layout.type_name]
    from_json: Callable[[bytes], Any] = msgspec.json.Decoder(struct).decode
    if style.unknown == 'ignore' and may_hide_envelope(layout):
        from_json = _without_envelopes(from_json, layout)
    if style.unknown == 'ignore' and style.missing == 'default' and layout.fields:
        from_json = _without_foreign(from_json, layout, struct())
    write = make_write(layout, style, scope.max_message_bytes)

    def decode(value: bytes | None) -> bytes:
        if value is None:
            raise DecodeError('the value is null (a tombstone), and json has no message for it')
        try:
            message = from_json(value)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise DecodeError(_reason(value, layout, error)) from None
        return write(message)

    return decode


def _without_foreign(
    from_json: Callable[[bytes], Any], layout: Layout, defaults: msgspec.Struct
) -> Callable[[bytes], Any]:
    """Make the reader of objects of which no field is asked for, and any other is passed over.

    A field that is not there has the very object of the default: where all have, an object of
    other fields is told from `{}`.
    """
    first, *others = msgspec.structs.astuple(defaults)
    foreign_reason = make_foreign_reason(layout)

    def read(value: bytes) -> Any:
        message = from_json(value)
        # Most messages set their first field, and are asked for no more.
        if message.f0 is first and all(map(is_, msgspec.structs.astuple(message)[1:], others)):
            _refuse(foreign_reason(value))
        return message

    return read


def _without_envelopes(
    from_json: Callable[[bytes], Any], layout: Layout
) -> Callable[[bytes], Any]:
    """Make the reader of a type whose messages may be made of Kafka Connect's envelope itself."""

    def read(value: bytes) -> Any:
        message = from_json(value)
        if b'"schema"' in value and b'"payload"' in value:
            _refuse(envelope(value, layout))
        return message

    return read


def _refuse(reason: str | None) -> None:
    if reason:
        raise DecodeError(reason)


def make_encode(layout: Layout, scope: Scope) -> Callable[[bytes], bytes]:
    """Make the function from a message's CDR bytes to a record's value.

    Returns:
        The function. It raises EncodeError for what is not one message of this type, and for
        NaN and infinity where the settings refuse them.
    """
    style = _style(scope.json)
    read = make_read(layout, make_structs(layout, style), style)
    to_json = msgspec.json.Encoder().encode

    return lambda message: to_json(read(message))


def schema(layout: Layout, settings: JsonSettings) -> str:
    """Tell what a record has to look like, as JSON Schema (draft 2020-12).

    It comes from the structs that decode. Keywords that begin with `ros.` are what JSON Schema
    has no word for: type, type hash and constants.
    """
    structs = make_structs(layout, _style(settings))
    root = structs[layout.type_name]
    [top], inner = msgspec.json.schema_components([root], ref_template='#/$defs/{name}')
    # So msgspec names the definition of a type.
    layouts = {name.replace('/', '_'): one for name, one in layouts_in(layout).items()}
    definitions = {
        name: _described(found, layouts[name], structs, settings) for name, found in inner.items()
    }
    whole = {'$schema': _DIALECT, **top, '$defs': definitions}
    return json.dumps(whole, indent=2, allow_nan=False) + '\n'


def _style(settings: JsonSettings) -> Style:
    return Style(
        bytes_as='list' if settings.bytes == 'list' else 'bytes',
        non_finite=settings.non_finite,
        integers=settings.integers,
        missing=settings.missing,
        unknown=settings.unknown,
    )


# Why a value is no message, looked for only once it is refused


def _reason(value: bytes, layout: Layout, error: Exception) -> str:
    if said := _wrong_beginning(value):
        return said
    try:
        value.decode()
    except UnicodeDecodeError as bad:
        found = f'not UTF-8 at byte {bad.start}: {value[bad.start]:#04x}'
        return found + another_format(value, 'json')
    if isinstance(error, RecursionError):
        return 'nested too deeply'
    assert isinstance(error, msgspec.MsgspecError)
    if isinstance(error, msgspec.ValidationError):
        said = None
        with suppress(RecursionError):
            said = envelope(value, layout)
        return said or explain(error)
    return _malformed(value, str(error)) + another_format(value, 'json')


def _wrong_beginning(value: bytes) -> str | None:
    if not value.strip():
        return 'the value is empty, and json needs an object'
    if value.startswith(codecs.BOM_UTF8):
        return 'a byte order mark (EF BB BF) at byte 0: JSON has none'
    return framed_json(value)


def _malformed(value: bytes, said: str) -> str:
    """Msgspec's own words, and what often stands where JSON ends to be JSON."""
    if said.endswith('truncated'):
        half = _HALF_PAIR.search(value)
        if half:
            return f'JSON is malformed: half a surrogate pair (byte {half.start()})'
        return f'JSON is malformed: it ends too soon (byte {len(value)})'
    place = _BYTE.search(said)
    word = _NON_FINITE.match(value, int(place[1])) if place else None
    return f'{said}: JSON has no {word[0].decode()}, see non_finite' if word else said


_BYTE: Final = re.compile(r'\(byte (\d+)\)$')
_HALF_PAIR: Final = re.compile(rb'\\u[dD][89abAB][0-9a-fA-F]{2}(?!\\u[dD][c-fC-F])')
_NON_FINITE: Final = re.compile(rb'NaN|Infinity')


# The schema


def _described(
    found: dict[str, Any], layout: Layout, structs: Structs, settings: JsonSettings
) -> dict[str, Any]:
    described = {'title': layout.type_name, **found}
    if not layout.doc:
        described.pop('description', None)
    if settings.missing == 'default':
        defaults = json.loads(msgspec.json.encode(structs[layout.type_name]()))
        for field in layout.fields:
            if isinstance(field.kind, Layout):
                continue
            shown, default = described['properties'][field.name], defaults[field.name]
            shown['default'] = default
            if default is None and settings.non_finite != 'null':
                # NaN, which would be no value of the field.
                del shown['default']
    if layout.type_hash:
        described['ros.type_hash'] = layout.type_hash
    if layout.constants:
        described['ros.constants'] = {one.name: _spelled(one.value) for one in layout.constants}
    return described


def _spelled(value: Scalar) -> Scalar:
    """A constant as JSON has it."""
    return NON_FINITE.get(str(value), value) if isinstance(value, float) else value
