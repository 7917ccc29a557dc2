"""The functions of a route's format, made of its settings."""

from collections.abc import Callable

from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings
from ros2_kafka_bridge.config.routes import BLOCKS, AnyRoute
from ros2_kafka_bridge.config.settings import Config, RosToKafkaRoute
from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats import FORMATS, Decode, Encode, guarded
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import document
from ros2_kafka_bridge.message_types.layout import Layout

_EVEN = frozenset({'text', 'cdr'})
"""Formats whose values are about as large as their messages."""

_LIMIT = 'max_message_bytes of the route'


def scope_of(route: AnyRoute, config: Config) -> Scope:
    """What a format knows of a route."""
    registry = config.schema_registry
    return Scope(
        route.kafka_topic,
        route.json_settings or JsonSettings(),
        route.schema_settings or SchemaSettings(),
        {} if registry is None else registry.properties(),
        route.max_message_bytes,
    )


def decode_of(route: AnyRoute, config: Config, layout: Layout) -> Decode:
    """Make the decode function of a route: no value and no message larger than it allows.

    Raises:
        ConfigError: The format cannot carry the type, or its settings are wrong.
        RouteError: A Schema Registry does not answer.
    """
    scope, whole = scope_of(route, config), with_docs(route, config, layout)
    decode = FORMATS[route.format].make_decode(whole, scope)
    return guarded(decode, route.max_message_bytes, DecodeError)


def encode_of(route: RosToKafkaRoute, config: Config, layout: Layout) -> Encode:
    """Make the encode function of a route: no message and no value larger than it allows.

    Raises:
        ConfigError: The format cannot carry the type, or its settings are wrong.
        RouteError: A Schema Registry does not answer.
    """
    scope, whole = scope_of(route, config), with_docs(route, config, layout)
    encode = FORMATS[route.format].make_encode(whole, scope)
    if route.format not in _EVEN:
        encode = _not_grown(encode, route.format, route.max_message_bytes)
    return guarded(encode, route.max_message_bytes, EncodeError)


def reads_fields(route: AnyRoute) -> bool:
    """Whether a route would misread the messages of another definition of its type."""
    return route.format not in _EVEN


def with_docs(route: AnyRoute, config: Config, layout: Layout) -> Layout:
    """Add the docs to the layout of a route that registers them with its schema."""
    in_schema = route.format in BLOCKS['schema']
    return document(layout, config.ros.message_path) if in_schema else layout


def asks_registry(route: AnyRoute) -> bool:
    """Whether the format of a route looks its schema up in a Schema Registry."""
    schema = route.schema_settings or SchemaSettings()
    return route.format in BLOCKS['schema'] and schema.registry


def _not_grown(
    encode: Callable[[bytes], bytes | None], name: str, max_bytes: int
) -> Callable[[bytes], bytes | None]:
    """Refuse a value that a message of the right size has become.

    The message itself is not too large: its dead letter keeps it.
    """

    def encode_small(message: bytes) -> bytes | None:
        value = encode(message)
        if value is not None and len(value) > max_bytes:
            raise EncodeError(
                f'{len(message)} bytes as a message, {len(value)} bytes as {name}: more than '
                f'{_LIMIT} ({max_bytes} bytes)'
            )
        return value

    return encode_small
