"""protobuf: the record's value is the message in Protobuf, behind the id of its schema.

With a Schema Registry this is Confluent's wire format: a zero byte, the id of the schema, and
which message of it. Without one the value is the plain message, of the route's own type.
"""

from collections.abc import Callable
from typing import Any

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.looks import another_format
from ros2_kafka_bridge.formats.protobuf.convert import (
    STYLE,
    make_fill,
    make_message_read,
)
from ros2_kafka_bridge.formats.protobuf.schema import make_class, make_files, protobuf_sources
from ros2_kafka_bridge.formats.registry import Registry, open_registry
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.values.read import make_read
from ros2_kafka_bridge.formats.values.structs import make_structs
from ros2_kafka_bridge.formats.values.write import make_write
from ros2_kafka_bridge.message_types.layout import Layout


def make_decode(layout: Layout, scope: Scope) -> Callable[[bytes | None], bytes]:
    """Make the function from a record's value to the CDR bytes of a message.

    Returns:
        The function. It raises DecodeError for a null value and for what is not one message of
        this type. With a registry it asks for each schema once, and may raise RouteError.

    Raises:
        ConfigError: The type cannot be carried, the registry is not configured rightly, or the
            extra is missing.
    """
    message_class = make_class(layout)
    write = make_write(layout, STYLE, scope.max_message_bytes)
    if scope.schema.registry:
        message_of = make_read_by_id(layout, message_class)(open_registry(scope))
    else:
        message_of = _make_plain(layout, message_class)

    def decode(value: bytes | None) -> bytes:
        if value is None:
            raise DecodeError('the value is null (a tombstone): there is no message in it')
        return write(message_of(value))

    return decode


def make_encode(layout: Layout, scope: Scope) -> Callable[[bytes], bytes]:
    """Make the function from the CDR bytes of a message to a record's value.

    With a registry the schema is registered or looked up here, with the types in it as
    references: the function made asks nobody.

    Returns:
        The function. It raises EncodeError for what is not one message of this type.

    Raises:
        ConfigError: The type cannot be carried, the registry refuses the schema or is not
            configured rightly, or the extra is missing.
        RouteError: The registry does not answer.
    """
    message_class = make_class(layout)
    read = make_read(layout, make_structs(layout, STYLE), STYLE)
    fill = make_fill(layout)
    prefix = _prefix(layout, message_class, scope) if scope.schema.registry else b''

    def encode(value: bytes) -> bytes:
        message = message_class()
        fill(message, read(value))
        encoded: bytes = message.SerializeToString()
        return prefix + encoded if prefix else encoded

    return encode


def _prefix(layout: Layout, message_class: Any, scope: Scope) -> bytes:
    # Loads all of confluent's part for Protobuf.
    from ros2_kafka_bridge.formats.protobuf.register import registered  # noqa: PLC0415

    return registered(layout, message_class, scope)


def _make_plain(layout: Layout, message_class: Any) -> Callable[[bytes], Any]:
    # No schema tells who wrote the record: a field without a name is the only sign that it was
    # another type.
    read = make_message_read(layout, strict=True)
    parse = _make_parse(message_class)

    def message_of(value: bytes) -> Any:
        try:
            return read(parse(value))
        except DecodeError as error:
            raise DecodeError(f'{error}{another_format(value, "protobuf")}') from None

    return message_of


def make_read_by_id(
    layout: Layout, message_class: Any
) -> Callable[[Registry], Callable[[bytes], Any]]:
    """Make the function from a registry to the reader with it.

    That reader makes the struct of a record's value, and asks once for the schema of each id.
    """
    # Loads all of confluent's part for Protobuf.
    from ros2_kafka_bridge.formats.protobuf.writers import Writers  # noqa: PLC0415

    by_source = _by_source(layout)
    by_strictness = {strict: make_message_read(layout, strict=strict) for strict in (True, False)}
    parse = _make_parse(message_class)

    def read_by_id(registry: Registry) -> Callable[[bytes], Any]:
        writers = Writers(registry, message_class.DESCRIPTOR, by_source)

        def message_of(value: bytes) -> Any:
            writer = writers.of(value)
            return by_strictness[writer.strict](parse(value[writer.start :]))

        return message_of

    return read_by_id


def _by_source(layout: Layout) -> dict[str, Any]:
    """The files of a type by the source text that the bridge prints."""
    sources = protobuf_sources(layout)
    return {sources[file.name].strip(): file for file in make_files(layout)}


def _make_parse(message_class: Any) -> Callable[[bytes], Any]:
    from google.protobuf.message import DecodeError as MalformedError  # noqa: PLC0415 -- heavy

    from_bytes = message_class.FromString

    def parse(value: bytes) -> Any:
        try:
            return from_bytes(value)
        except MalformedError as error:
            raise DecodeError(f'not a message in Protobuf: {error}') from None

    return parse
