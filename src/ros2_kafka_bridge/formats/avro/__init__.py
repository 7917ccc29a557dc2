"""avro: the record's value is the message in Avro's binary encoding.

With a Schema Registry, it is confluent's wire format: the id of the schema stands before the
value, and what was written with another version is read by Avro's resolution. Without one, writer
and reader have the schema of the message type.
"""

import io
import json
from collections.abc import Callable
from contextlib import closing
from decimal import Decimal
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.errors import ConfigError, DecodeError
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.avro.versions import (
    END,
    END_BYTES,
    FAULTS,
    WRAPPED,
    Version,
    text_in,
    version_of,
)
from ros2_kafka_bridge.formats.looks import FRAME, another_format
from ros2_kafka_bridge.formats.registry import (
    Registry,
    framed_id,
    open_registry,
    strategy,
    subject,
)
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.values.read import make_read
from ros2_kafka_bridge.formats.values.structs import Style, explain, make_structs
from ros2_kafka_bridge.formats.values.write import make_write
from ros2_kafka_bridge.message_types.layout import Layout, dotted_name
from ros2_kafka_bridge.outside.extras import missing_extra

STYLE: Final = Style(integers='decimal', missing='default', unknown='ignore')
"""Where another version has fewer or more fields is the business of Avro's resolution."""

_KEPT: Final = (bytes, Decimal)


def make_encode(layout: Layout, scope: Scope) -> Callable[[bytes], bytes]:
    """Make the function from the CDR bytes of a message to a record's value.

    With a registry, the schema is registered or looked up here: the function asks no network.

    Returns:
        The function. It raises EncodeError for what is not one message of this type.

    Raises:
        ConfigError: The registry's properties are wrong, it refuses the schema, or does not have
            it; or the extra is missing.
        RouteError: The registry does not answer.
    """
    _check_extra()
    structs = make_structs(layout, STYLE)
    read = make_read(layout, structs, STYLE)
    sample = structs[layout.type_name]()
    to_avro = _registered(layout, scope, sample) if scope.schema.registry else _plain(layout)

    return lambda message: to_avro(_builtins(read(message)))


def make_decode(layout: Layout, scope: Scope) -> Callable[[bytes | None], bytes]:
    """Make the function from a record's value to the CDR bytes of a message.

    Returns:
        The function. It raises DecodeError for a null value and for what is not one message of
        this type; with a registry also RouteError, if that does not answer for the schema of an
        id that was not seen before.

    Raises:
        ConfigError: The registry's properties are wrong, or the extra is missing.
    """
    _check_extra()
    to_cdr = make_to_cdr(layout, scope.max_message_bytes)
    if scope.schema.registry:
        from_avro = read_by_id(layout, open_registry(scope))
    else:
        from_avro = _by_type(layout)

    def decode(value: bytes | None) -> bytes:
        if value is None:
            raise DecodeError('the value is null (a tombstone), and avro has no message for it')
        return to_cdr(from_avro(value))

    return decode


def make_to_cdr(layout: Layout, max_message_bytes: int) -> Callable[[Any], bytes]:
    """Make the function from what fastavro has read to the CDR bytes of a message."""
    struct = make_structs(layout, STYLE)[layout.type_name]
    write = make_write(layout, STYLE, max_message_bytes)

    def to_cdr(found: Any) -> bytes:
        try:
            made = msgspec.convert(found, struct, builtin_types=_KEPT)
        except msgspec.ValidationError as error:
            raise DecodeError(explain(error)) from None
        return write(made)

    return to_cdr


def _check_extra() -> None:
    problem = missing_extra('avro')
    if problem:
        raise ConfigError([problem])


def _builtins(made: msgspec.Struct) -> Any:
    return msgspec.to_builtins(made, builtin_types=_KEPT)


def _plain(layout: Layout) -> Callable[[Any], bytes]:
    """The writer without a registry."""
    # Not on the way of a route with another format, and of an extra.
    from fastavro import parse_schema, schemaless_writer  # noqa: PLC0415

    schema = parse_schema(avro_schema(layout))

    def to_avro(found: Any) -> bytes:
        stream = io.BytesIO()
        schemaless_writer(stream, schema, found)
        return stream.getvalue()

    return to_avro


def _by_type(layout: Layout) -> Callable[[bytes], Any]:
    """The reader without a registry."""
    from fastavro import parse_schema, schemaless_reader  # noqa: PLC0415 -- as above

    schema = parse_schema(avro_schema(layout))
    name = dotted_name(layout)

    def from_avro(value: bytes) -> Any:
        stream = io.BytesIO(value)
        try:
            found = schemaless_reader(stream, schema, None)
            _check_end(stream, name)
        except DecodeError as error:
            raise DecodeError(f'{error}{another_format(value, "avro")}') from None
        except FAULTS as error:
            hint = another_format(value, 'avro')
            raise DecodeError(f'not a value of {name}: {_why(error)}{hint}') from None
        return found

    return from_avro


def _registered(layout: Layout, scope: Scope, sample: msgspec.Struct) -> Callable[[Any], bytes]:
    """The writer with a registry; it has written the sample, and knows the id from then on."""
    registry = open_registry(scope)
    from confluent_kafka.schema_registry.avro import AvroSerializer  # noqa: PLC0415 -- as above
    from confluent_kafka.serialization import (  # noqa: PLC0415 -- as above
        MessageField,
        SerializationContext,
    )

    schema = avro_schema(layout)
    auto_register = scope.schema.auto_register
    place = subject(scope, layout)
    # From then on it asks no more: the connection is not needed either.
    with (
        closing(registry.client),
        registry.registering(place, layout.type_name, 'avro', auto_register=auto_register),
    ):
        known = None if auto_register else text_in(registry, place, schema)
        serializer = AvroSerializer(
            registry.client,
            known or json.dumps(schema),
            conf={
                'auto.register.schemas': auto_register,
                'subject.name.strategy.type': strategy(scope),
            },
        )
        context = SerializationContext(scope.topic, MessageField.VALUE)

        def to_avro(found: Any) -> bytes:
            value: bytes | None = serializer(found, context)
            assert value is not None, 'only None makes None'
            return value

        to_avro(_builtins(sample))
    return to_avro


def read_by_id(layout: Layout, registry: Registry) -> Callable[[bytes], Any]:
    """Make the reader with a registry; it asks once for the schema of each id.

    confluent's AvroDeserializer remembers a bad answer of the registry, and takes a record of
    another package for ours: its client asks here, and the schemas are compared before fastavro,
    by which it reads, reads a value.
    """
    from fastavro import schemaless_reader  # noqa: PLC0415 -- of an extra
    from fastavro.read import SchemaResolutionError  # noqa: PLC0415 -- the same

    schema = avro_schema(layout)
    versions: dict[int, Version] = {}

    def from_avro(value: bytes) -> Any:
        schema_id = framed_id(value)
        version = versions.get(schema_id)
        if version is None:
            version = versions[schema_id] = version_of(registry, schema_id, schema)
        if version.problem:
            raise DecodeError(f'schema {schema_id} {version.problem}')
        stream = _stream_of(value, version)
        stream.seek(FRAME)
        try:
            found: Any = schemaless_reader(stream, version.writer, version.reader)
        except SchemaResolutionError:
            # What the schemas themselves tell was found before.
            raise DecodeError(
                f'schema {schema_id} allows several types at one place (a union), and the value '
                f'has one there that does not fit {layout.type_name}'
            ) from None
        except FAULTS as error:
            raise DecodeError(f'not a value of schema {schema_id}: {_why(error)}') from None
        _check_end(stream, f'schema {schema_id}')
        if found.get(END, 1) != 1:
            raise DecodeError(f'not a value of schema {schema_id}: {_why(EOFError())}')
        return found[WRAPPED]

    registry.close_with(from_avro)
    return from_avro


def _stream_of(value: bytes, version: Version) -> io.BytesIO:
    """The value to be read, so that its end is seen also in what fastavro skips.

    There it asks for bytes and does not look at what it gets: what is missing is taken from what
    stands behind, and in a list it goes on for as many items as the value says, while no other
    thread runs.
    """
    if version.reader is None:
        return io.BytesIO(value)
    whole = value + END_BYTES
    return _StrictBytes(whole) if version.skips_lists else io.BytesIO(whole)


class _StrictBytes(io.BytesIO):
    """Bytes that end where they end, at twice the price of others."""

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        if size is not None and len(found) < size:
            raise EOFError
        return found


def _check_end(stream: io.BytesIO, what: str) -> None:
    at = stream.tell()
    behind = len(stream.read())
    if behind:
        noun = 'byte' if behind == 1 else 'bytes'
        raise DecodeError(f'{behind} {noun} behind the value of {what}, at {at}')


def _why(error: BaseException) -> str:
    match error:
        case EOFError() | IndexError():
            return 'it ends in the middle of a field, or has a length that it cannot have'
        case UnicodeDecodeError():
            return 'a text is not UTF-8'
        case _:
            return str(error)[:500] or type(error).__name__
