"""Records of a robot in Avro, as another program writes them."""

from typing import Any

from avro_messages import ROBOT, avro_bytes, cdr_from, fields_of, framed, json_text, scope_of
from registry_server import RegistryServer

from ros2_kafka_bridge.formats.avro import make_decode
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive

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
