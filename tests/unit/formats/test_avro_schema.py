"""The Avro schemas of message types."""

import io
import json
import math
from typing import Any

import avro.io
import avro.schema
import fastavro
import pytest
from support.formats.messages import layout_of

from ros2_kafka_bridge.formats.avro.schema import FILLER, avro_schema
from ros2_kafka_bridge.message_types import load_layout, type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Kind,
    Layout,
    Primitive,
    Scalar,
    Sequence,
    String,
)

FLOAT = Primitive('float64')
POINT = Layout('geo_msgs/msg/Point', (Field('x', FLOAT), Field('y', FLOAT)))


def one_field(
    kind: Kind, default: Scalar | tuple[Scalar, ...] | None = None, doc: str = ''
) -> dict[str, Any]:
    schema = avro_schema(Layout('demo_msgs/msg/One', (Field('a', kind, default, doc),)))
    field: dict[str, Any] = schema['fields'][0]
    return field


@pytest.mark.parametrize('name', type_names())
def test_the_schema_of_every_type_is_one_for_both_libraries_of_avro(name: str) -> None:
    text = json.dumps(avro_schema(load_layout(name)), allow_nan=False)
    known: dict[str, Any] = {}
    fastavro.parse_schema(json.loads(text), known)
    assert name.replace('/', '.') in known
    found = avro.schema.parse(text)
    assert isinstance(found, avro.schema.RecordSchema)
    assert found.fullname == name.replace('/', '.')


@pytest.mark.parametrize('name', type_names())
def test_every_default_in_a_schema_is_a_value_of_its_field(name: str) -> None:
    schema = avro_schema(load_layout(name))
    reader = fastavro.parse_schema(schema)
    # All fields are missing, so that every one is filled in with its default.
    empty = fastavro.parse_schema({**schema, 'fields': []})
    found: Any = fastavro.schemaless_reader(io.BytesIO(), empty, reader)
    fields = schema['fields']
    assert set(found) == {field['name'] for field in fields if 'default' in field}
    # The library of Apache reads defaults by their types.
    written = avro.schema.parse(json.dumps({**schema, 'fields': []}))
    decoder = avro.io.BinaryDecoder(io.BytesIO())
    read: Any = avro.io.DatumReader(written, avro.schema.parse(json.dumps(schema))).read(decoder)
    assert isinstance(read, dict)
    assert set(read) == set(found)


def test_a_type_that_appears_twice_is_defined_once_and_then_stands_by_its_full_name() -> None:
    fields = (Field('a', POINT), Field('b', POINT), Field('c', Sequence(POINT)))
    a, b, c = avro_schema(Layout('demo_msgs/msg/Line', fields))['fields']
    assert a['type']['namespace'] == 'geo_msgs.msg'
    assert a['type']['name'] == 'Point'
    assert b['type'] == 'geo_msgs.msg.Point'
    assert c['type'] == {'type': 'array', 'items': 'geo_msgs.msg.Point'}


def test_two_types_of_one_short_name_do_not_clash() -> None:
    other = Layout('other_msgs/msg/Point', (Field('x', String()),))
    schema = avro_schema(Layout('demo_msgs/msg/Point', (Field('a', POINT), Field('b', other))))
    known: dict[str, Any] = {}
    fastavro.parse_schema(schema, known)
    assert set(known) == {'demo_msgs.msg.Point', 'geo_msgs.msg.Point', 'other_msgs.msg.Point'}


def test_a_schema_tells_what_the_definition_says() -> None:
    constants = (
        Constant('FULL', Primitive('uint8'), 3, 'Nothing fits in.'),
        Constant('UNKNOWN', FLOAT, math.nan),
        Constant('HOME', String(), 'dock'),
    )
    speed = Field('speed', Primitive('float32'), 0.5, 'Metres per second.')
    layout = Layout('demo_msgs/msg/Robot', (speed,), constants, 'A robot.', 'RIHS01_' + 'ab' * 32)
    assert avro_schema(layout) == {
        'type': 'record',
        'name': 'Robot',
        'namespace': 'demo_msgs.msg',
        'doc': 'A robot.',
        'ros.type': 'demo_msgs/msg/Robot',
        'ros.type_hash': 'RIHS01_' + 'ab' * 32,
        'ros.constants': [
            {'name': 'FULL', 'type': 'uint8', 'value': 3, 'doc': 'Nothing fits in.'},
            {'name': 'UNKNOWN', 'type': 'float64', 'value': 'nan'},
            {'name': 'HOME', 'type': 'string', 'value': 'dock'},
        ],
        'fields': [
            {'name': 'speed', 'type': 'float', 'default': 0.5, 'doc': 'Metres per second.'}
        ],
    }


@pytest.mark.parametrize(
    ('kind', 'shown', 'default'),
    [
        (Primitive('bool'), 'boolean', False),
        (Primitive('int8'), {'type': 'int', 'ros.type': 'int8'}, 0),
        (Primitive('uint16'), {'type': 'int', 'ros.type': 'uint16'}, 0),
        (Primitive('int32'), 'int', 0),
        (Primitive('uint32'), {'type': 'long', 'ros.type': 'uint32'}, 0),
        (Primitive('int64'), 'long', 0),
        (Primitive('float32'), 'float', 0.0),
        (FLOAT, 'double', 0.0),
        (String(), 'string', ''),
        (String(8), {'type': 'string', 'ros.bound': 8}, ''),
        (String(wide=True), {'type': 'string', 'ros.type': 'wstring'}, ''),
        (Sequence(Primitive('uint8')), {'type': 'bytes', 'ros.type': 'uint8'}, ''),
        (
            Array(Primitive('byte'), 2),
            {'type': 'bytes', 'ros.type': 'byte', 'ros.length': 2},
            '\0\0',
        ),
        (Array(FLOAT, 2), {'type': 'array', 'items': 'double', 'ros.length': 2}, [0.0, 0.0]),
        (
            Sequence(String(3), 5),
            {'type': 'array', 'items': {'type': 'string', 'ros.bound': 3}, 'ros.bound': 5},
            [],
        ),
    ],
)
def test_every_kind_has_its_type_and_a_default_of_zero(
    kind: Kind, shown: object, default: object
) -> None:
    assert one_field(kind) == {'name': 'a', 'type': shown, 'default': default}


def test_a_nested_message_defaults_to_the_defaults_of_its_fields() -> None:
    assert one_field(POINT)['default'] == {}


@pytest.mark.parametrize(
    ('kind', 'default', 'shown'),
    [
        (FLOAT, 1.5, 1.5),
        (Array(Primitive('uint8'), 3), (1, 2, 255), '\x01\x02\xff'),
        (Sequence(Primitive('int16')), (-1, 7), [-1, 7]),
        (Primitive('uint64'), 2**64 - 1, '\0' + '\xff' * 8),
        (Array(Primitive('uint64'), 1), (258,), ['\0' * 7 + '\x01\x02']),
    ],
)
def test_a_default_of_the_definition_stands_in_avros_spelling(
    kind: Kind, default: Any, shown: object
) -> None:
    assert one_field(kind, default)['default'] == shown


@pytest.mark.parametrize('default', [math.nan, math.inf])
def test_a_default_that_json_has_no_number_for_is_left_out(default: float) -> None:
    assert 'default' not in one_field(FLOAT, default)
    assert 'default' not in one_field(Array(FLOAT, 1), (default,))


def test_a_default_does_not_fill_the_registry_with_zeros() -> None:
    assert 'default' not in one_field(Array(Primitive('uint8'), 1_000_000))


@pytest.mark.parametrize('inner', [Field('v', FLOAT, math.nan), Field('v', Array(FLOAT, 5000))])
def test_a_message_with_a_field_without_default_has_none(inner: Field) -> None:
    """Libraries of Java refuse a schema with one that says nothing of that field."""
    layout = Layout('demo_msgs/msg/Inner', (inner, Field('w', FLOAT)))
    for kind in (layout, Layout('demo_msgs/msg/Middle', (Field('in', layout),)), Array(layout, 2)):
        assert 'default' not in one_field(kind)
    for empty in (Sequence(layout), Array(layout, 0)):
        assert one_field(empty)['default'] == []


def test_a_constant_beyond_what_java_holds_is_text() -> None:
    constants = tuple(
        Constant(name, Primitive('uint64'), value)
        for name, value in (('BIG', 2**64 - 1), ('SMALL', 2**63 - 1))
    )
    [big, small] = avro_schema(Layout('demo_msgs/msg/One', (), constants))['ros.constants']
    assert (big['value'], small['value']) == ('18446744073709551615', 2**63 - 1)


def test_uint64_is_a_decimal_of_fixed_size_defined_once() -> None:
    wide = Primitive('uint64')
    layout = Layout('demo_msgs/msg/Wide', (Field('a', wide), Field('b', Sequence(wide))))
    a, b = avro_schema(layout)['fields']
    assert a['type']['type'] == 'fixed'
    assert a['type']['size'] == 9
    assert a['type']['logicalType'] == 'decimal'
    assert (a['type']['precision'], a['type']['scale']) == (20, 0)
    assert b['type'] == {'type': 'array', 'items': 'ros2.uint64'}


def test_a_message_without_fields_has_the_one_that_ros_lays_down() -> None:
    (field,) = avro_schema(layout_of('std_msgs/msg/Empty'))['fields']
    assert field['name'] == FILLER
    assert field['default'] == 0
