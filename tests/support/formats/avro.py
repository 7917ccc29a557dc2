"""Messages in Avro: types of no package, and records of a robot as another program writes them."""

import io
import json
from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any, Final

import fastavro
import msgspec
from support.registry.server import RegistryServer

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats.avro import STYLE, make_decode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.values.read import make_read
from ros2_kafka_bridge.formats.values.structs import make_structs
from ros2_kafka_bridge.formats.values.write import make_write
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)

LOCAL: Final = Scope('robots', schema=SchemaSettings(registry=False))
"""A route without a registry."""

STOP: Final = Layout(
    'demo_msgs/msg/Stop', (Field('x', Primitive('float64')), Field('mark', String()))
)
ROBOT: Final = Layout(
    'demo_msgs/msg/Robot',
    (
        Field('name', String(8)),
        Field('level', Primitive('uint8')),
        Field('speed', Primitive('float32'), 0.5, 'Metres per second.'),
        Field('corners', Array(Primitive('float64'), 2)),
        Field('photo', Array(Primitive('uint8'), 4)),
        Field('tags', Sequence(String(), 3)),
        Field('stops', Sequence(STOP)),
    ),
    doc='A robot.',
)
WIDE: Final = Layout(
    'demo_msgs/msg/Wide',
    (Field('a', Primitive('uint64')), Field('many', Sequence(Primitive('uint64')))),
)


def scope_of(
    url: str, topic: str = 'robots', /, properties: Mapping[str, Any] | None = None, **schema: Any
) -> Scope:
    """What a format knows of a route with a registry."""
    registry = {'url': url, **(properties or {})}
    return Scope(topic, schema=SchemaSettings(**schema), registry=registry)


def cdr_from(layout: Layout, fields: Mapping[str, Any]) -> bytes:
    """The CDR bytes of a message; the fields that are not given are as the definition says."""
    return make_cdr_from(layout)(fields)


def make_cdr_from(layout: Layout) -> Callable[[Mapping[str, Any]], bytes]:
    """Make `cdr_from` of one type: that takes longer than to call it."""
    struct = make_structs(layout, STYLE)[layout.type_name]
    write = make_write(layout, STYLE)
    return lambda fields: write(msgspec.convert(fields, struct, builtin_types=(bytes, Decimal)))


def fields_of(value: bytes, layout: Layout) -> Any:
    """The fields of a message by name."""
    made = make_read(layout, make_structs(layout, STYLE), STYLE)(value)
    return _listed(msgspec.to_builtins(made, builtin_types=(bytes, Decimal)))


def _listed(found: Any) -> Any:
    if isinstance(found, dict):
        return {name: _listed(value) for name, value in found.items()}
    return [_listed(item) for item in found] if isinstance(found, list | tuple) else found


def json_text(schema: Any) -> str:
    """A schema as a registry takes it."""
    return json.dumps(schema, allow_nan=False)


def framed(schema_id: int, payload: bytes) -> bytes:
    """A value behind the id of its schema."""
    return b'\0' + schema_id.to_bytes(4, 'big') + payload


def avro_bytes(schema: Any, found: Any) -> bytes:
    """A value as another program writes it."""
    stream = io.BytesIO()
    fastavro.schemaless_writer(stream, fastavro.parse_schema(schema), found)
    return stream.getvalue()


STRING = load_layout('std_msgs/msg/String')
ONE = Layout('demo_msgs/msg/One', (Field('a', Primitive('int32')),))


def robot(**fields: Any) -> dict[str, Any]:
    found: dict[str, Any] = fields_of(cdr_from(ROBOT, fields), ROBOT)
    return found


def changed(layout: Layout, *fields: Field, without: str = '') -> Layout:
    """Another version of a type."""
    kept = tuple(field for field in layout.fields if field.name != without)
    return Layout(layout.type_name, (*kept, *fields))


def decoded(
    server: RegistryServer, schema: Any, found: Any, reader: Layout = ROBOT
) -> dict[str, Any]:
    """What is read of a value that another program has written with its schema."""
    value = framed(server.register('robots-value', json_text(schema)), avro_bytes(schema, found))
    fields: dict[str, Any] = fields_of(make_decode(reader, scope_of(server.url))(value), reader)
    return fields
