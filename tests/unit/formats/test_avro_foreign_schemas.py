"""Schemas of others that a registry gives out: odd ones, wrong ones, hostile ones."""

import tracemalloc
from typing import Any

import pytest
from support.formats.avro import (
    ONE,
    ROBOT,
    WIDE,
    avro_bytes,
    decoded,
    fields_of,
    framed,
    json_text,
    robot,
    scope_of,
)
from support.registry.server import RegistryServer

from benchmarks.fuzz_versions import registry_of
from ros2_kafka_bridge.errors import DecodeError, RecordTooLargeError
from ros2_kafka_bridge.formats.avro import make_decode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.avro.versions import version_of
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)


@pytest.mark.parametrize(
    ('schema', 'found', 'said'),
    [
        ('string', 'hi', r'expected record demo_msgs.msg.Robot, the schema has string'),
        ({'type': 'array', 'items': 'int'}, [1], r'the schema has array'),
        (['null', 'string'], 'hi', r'expected record demo_msgs.msg.Robot, the schema has null'),
    ],
)
def test_a_schema_that_is_no_record_is_an_error(
    server: RegistryServer, schema: Any, found: Any, said: str
) -> None:
    with pytest.raises(DecodeError, match=said):
        decoded(server, schema, found)


@pytest.mark.parametrize(
    ('kind', 'text', 'said'),
    [
        ('JSON', '{"type": "string"}', 'schema 1 is a schema of JSON, and the route reads avro'),
        ('PROTOBUF', 'message A {}', 'schema 1 is a schema of PROTOBUF, and the route reads avro'),
        ('AVRO', '{"type": "recor"}', 'schema 1 is no Avro schema: '),
        ('AVRO', '{"type": "record"}', 'schema 1 is no Avro schema: '),
        ('AVRO', '{"type": ', 'schema 1 is no Avro schema: '),
        ('AVRO', '[' * 100_000, 'schema 1 is '),
        ('AVRO', '7', 'schema 1 '),
        ('AVRO', '{"type": {"type": {}}}', 'schema 1 is no Avro schema: '),
        (
            'AVRO',
            '{"type": "record", "name": "Robot", "fields": [{"name": {}, "type": "int"}]}',
            'schema 1 is no Avro schema: ',
        ),
    ],
)
def test_what_is_no_avro_schema_is_an_error(
    server: RegistryServer, kind: str, text: str, said: str
) -> None:
    value = framed(server.register('robots-value', text, kind), b'\x02')
    decode = make_decode(ROBOT, scope_of(server.url))
    for _ in range(2):
        with pytest.raises(DecodeError, match=f'^{said}'):
            decode(value)


EMPTY = {'type': 'record', 'name': 'Empty', 'fields': []}
LIST = {'type': 'record', 'name': 'Node', 'fields': [{'name': 'next', 'type': ['null', 'Node']}]}
ZIGZAG_2_60 = b'\x80' * 8 + b'\x20'


@pytest.mark.parametrize(
    ('more', 'payload', 'said'),
    [
        # fastavro would loop 2^60 times, be it that it keeps the items or passes over them.
        ({'type': 'array', 'items': 'null'}, ZIGZAG_2_60, 'an array of items without bytes'),
        ({'type': 'array', 'items': EMPTY}, ZIGZAG_2_60, 'an array of items without bytes'),
        (
            {'type': 'map', 'values': {'type': 'array', 'items': ['null', EMPTY]}},
            b'\x00',
            None,
        ),
        # fastavro would recurse until the process ends.
        (LIST, b'\x02' * 1_000_000 + b'\0', 'has the type Node within itself'),
        ({'type': 'array', 'items': LIST}, b'\x02' * 1_000_000 + b'\0', 'Node within itself'),
    ],
)
def test_a_schema_whose_values_could_hang_or_crash_a_reader_is_an_error(
    server: RegistryServer, more: Any, payload: bytes, said: str | None
) -> None:
    fields = [{'name': 'more', 'type': more}, {'name': 'a', 'type': 'int'}]
    writer = {'type': 'record', 'name': 'One', 'fields': fields}
    value = framed(server.register('robots-value', json_text(writer)), payload + b'\x0e')
    decode = make_decode(ONE, scope_of(server.url))
    if said is None:
        assert fields_of(decode(value), ONE) == {'a': 7}
        return
    with pytest.raises(DecodeError, match=said):
        decode(value)


def bomb(levels: int) -> list[dict[str, Any]]:
    """Fields with types of which each holds the one before twice, and none has bytes."""
    fields = []
    for level in range(levels):
        inner = f'R{level - 1}' if level else 'null'
        halves = [{'name': name, 'type': inner} for name in 'ab']
        record = {'type': 'record', 'name': f'R{level}', 'fields': halves}
        fields.append({'name': f'f{level}', 'type': ['null', record]})
    return fields


@pytest.mark.parametrize(
    ('last', 'said'),
    [
        ({'type': 'array', 'items': 'R39'}, 'has 100 fields without bytes'),
        ('R39', 'has 100 fields without bytes'),
        ('int', 'has 100 fields without bytes'),
    ],
)
def test_a_small_schema_of_a_huge_value_without_bytes_is_an_error(
    server: RegistryServer, last: Any, said: str
) -> None:
    """Its 2^40 fields take no byte, and for ever."""
    fields = [*bomb(40), {'name': 'last', 'type': last}, {'name': 'a', 'type': 'int'}]
    writer = {'type': 'record', 'name': 'One', 'fields': fields}
    value = framed(server.register('robots-value', json_text(writer)), b'\0' * 100)
    with pytest.raises(DecodeError, match=said):
        make_decode(ONE, scope_of(server.url))(value)


def test_a_few_fields_without_bytes_do_no_harm(server: RegistryServer) -> None:
    fields = [*bomb(5), {'name': 'last', 'type': 'R4'}, {'name': 'a', 'type': 'int'}]
    writer = {'type': 'record', 'name': 'One', 'fields': fields}
    value = framed(server.register('robots-value', json_text(writer)), b'\0' * 5 + b'\x0e')
    assert fields_of(make_decode(ONE, scope_of(server.url))(value), ONE) == {'a': 7}


ITEM = Layout(
    'demo_msgs/msg/Item',
    (Field('a', Primitive('bool')), Field('covariance', Array(Primitive('float64'), 4000))),
)
LIST_OF_ITEMS = Layout('demo_msgs/msg/Items', (Field('items', Sequence(ITEM)),))


@pytest.mark.parametrize(
    ('written', 'value', 'kind', 'read'),
    [
        ('string', 'hi', Sequence(Primitive('uint8')), b'hi'),
        ('bytes', b'hi', String(), 'hi'),
    ],
)
def test_text_and_bytes_are_read_as_each_other(
    server: RegistryServer, written: str, value: object, kind: Kind, read: object
) -> None:
    layout = Layout('demo_msgs/msg/One', (Field('a', kind),))
    writer = {'type': 'record', 'name': 'One', 'fields': [{'name': 'a', 'type': written}]}
    assert decoded(server, writer, {'a': value}, layout) == {'a': read}


@pytest.mark.parametrize(
    ('written', 'default'), [('double', 0), ('string', None), ('int', 'x'), (['null', 'int'], 7)]
)
def test_a_default_of_the_writer_says_nothing(
    server: RegistryServer, written: Any, default: object
) -> None:
    """No reader needs it, and not every registry looks at it."""
    fields = [{'name': 'more', 'type': written, 'default': default}, {'name': 'a', 'type': 'int'}]
    writer = {'type': 'record', 'name': 'One', 'fields': fields}
    without = {'double': bytes(8), 'string': b'\0', 'int': b'\0'}.get(str(written), b'\0')
    value = framed(server.register('robots-value', json_text(writer)), without + b'\x0e')
    assert fields_of(make_decode(ONE, scope_of(server.url))(value), ONE) == {'a': 7}


MARKED: dict[str, Any] = {
    'type': 'record',
    'name': 'One',
    'fields': [
        {
            'name': 'more',
            'type': {
                'type': 'array',
                'items': {
                    'type': 'record',
                    'name': 'K',
                    'fields': [{'name': 'y', 'type': 'int'}],
                },
            },
        },
        {'name': 'n', 'type': 'K'},
        {'name': 'a', 'type': 'int'},
    ],
}


@pytest.mark.parametrize(
    'named',
    [
        {'K': {'type': 'record', 'name': 'Q', 'fields': [{'name': 'y', 'type': ['null', 'K']}]}},
        {'K': {'type': 'record', 'name': 'Q', 'fields': []}},
        [],
        7,
    ],
)
def test_a_schema_with_the_marks_of_fastavro_is_parsed_like_any_other(
    server: RegistryServer, named: object
) -> None:
    """With the first of them, the process ended where a record nested a million times."""
    writer = MARKED | {'__fastavro_parsed': True, '__named_schemas': named}
    schema_id = server.register('robots-value', json_text(writer))
    decode = make_decode(ONE, scope_of(server.url))
    with pytest.raises(DecodeError):
        decode(framed(schema_id, b'\x02\0' + b'\x02' * 1_000_000 + b'\0\x0e'))
    assert fields_of(decode(framed(schema_id, b'\x02\x04\0\x06\x0e')), ONE) == {'a': 7}


@pytest.mark.parametrize('size', [-1, 0, None, 1.5, 'x'])
def test_a_fixed_type_without_bytes_is_an_error(server: RegistryServer, size: object) -> None:
    """An array of it would never end."""
    items = {'type': 'fixed', 'name': 'F', 'size': size}
    fields = [{'name': 'a', 'type': 'int'}]
    for more in ({'type': 'map', 'values': items}, {'type': 'array', 'items': items}):
        writer = {
            'type': 'record',
            'name': 'One',
            'fields': [{'name': 'more', 'type': more}, *fields],
        }
        value = framed(server.register('robots-value', json_text(writer)), ZIGZAG_2_60 + b'\x0e')
        with pytest.raises(DecodeError, match=r'has a fixed type of|is no Avro schema'):
            make_decode(ONE, scope_of(server.url))(value)


def nested(types: int, arrays: int) -> dict[str, Any]:
    """A schema of types of which each holds the one before within many arrays."""
    fields: list[dict[str, Any]] = [{'name': 'a', 'type': 'int'}]
    inner: Any = 'int'
    for number in range(types):
        for _ in range(arrays):
            inner = {'type': 'array', 'items': inner}
        record = {'type': 'record', 'name': f'R{number}', 'fields': [{'name': 'x', 'type': inner}]}
        fields.append({'name': f'f{number}', 'type': ['null', record]})
        inner = f'R{number}'
    return {'type': 'record', 'name': 'One', 'fields': fields}


def test_a_schema_that_nests_too_deeply_through_names_is_an_error(server: RegistryServer) -> None:
    """From 40,000 levels on the process ended."""
    value = framed(
        server.register('robots-value', json_text(nested(800, 60))), b'\x0e' + bytes(800)
    )
    with pytest.raises(DecodeError, match='is nested too deeply: more than 200 levels'):
        make_decode(ONE, scope_of(server.url))(value)


def test_a_schema_may_nest_as_deeply_as_people_do(server: RegistryServer) -> None:
    value = framed(server.register('robots-value', json_text(nested(20, 5))), b'\x0e' + bytes(20))
    assert fields_of(make_decode(ONE, scope_of(server.url))(value), ONE) == {'a': 7}


def test_a_schema_as_java_prints_it_is_known_for_ours(server: RegistryServer) -> None:
    """It leaves out what a type has of the one around it; read without resolution it is faster."""
    schema = avro_schema(ROBOT)
    del schema['fields'][-1]['type']['items']['namespace']
    found = version_of(registry_of('AVRO', {'java': json_text(schema)}), 1, avro_schema(ROBOT))
    assert (found.problem, found.reader) == (None, None)
    assert decoded(server, schema, robot(level=7))['level'] == 7


def test_a_default_is_not_made_for_each_item_of_a_list(server: RegistryServer) -> None:
    """100 kB of small items would be 3 GiB of defaults before their message is too large."""
    writer = avro_schema(LIST_OF_ITEMS)
    del writer['fields'][0]['type']['items']['fields'][1]
    count = 100_000
    payload = avro_bytes('long', count) + b'\x01' * count + b'\0'
    value = framed(server.register('robots-value', json_text(writer)), payload)
    scope = scope_of(server.url)._replace(max_message_bytes=1_000_000)
    decode = make_decode(LIST_OF_ITEMS, scope)
    tracemalloc.start()
    try:
        with pytest.raises(RecordTooLargeError):
            decode(value)
        assert tracemalloc.get_traced_memory()[1] < 1_000 * count
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ('logical', 'payload', 'kind', 'read'),
    [
        ({'type': 'int', 'logicalType': 'date'}, b'\x02', Primitive('int32'), 1),
        ({'type': 'long', 'logicalType': 'timestamp-millis'}, b'\x04', Primitive('int64'), 2),
        ({'type': 'string', 'logicalType': 'uuid'}, b'\x02x', String(), 'x'),
        (
            # As a number it takes fastavro minutes.
            {'type': 'bytes', 'logicalType': 'decimal', 'precision': 3_000_000},
            avro_bytes('bytes', b'\x7f' * 1_000_000),
            Sequence(Primitive('uint8')),
            b'\x7f' * 1_000_000,
        ),
        (
            {'type': 'array', 'items': {'type': 'int', 'logicalType': 'time-millis'}},
            b'\x02\x06\0',
            Sequence(Primitive('int32')),
            [3],
        ),
        (['null', {'type': 'int', 'logicalType': 'date'}], b'\x02\x08', Primitive('int32'), 4),
    ],
)
def test_a_logical_type_is_read_as_what_is_under_it(
    server: RegistryServer, logical: Any, payload: bytes, kind: Kind, read: object
) -> None:
    layout = Layout('demo_msgs/msg/One', (Field('a', kind),))
    writer = {'type': 'record', 'name': 'One', 'fields': [{'name': 'a', 'type': logical}]}
    value = framed(server.register('robots-value', json_text(writer)), payload)
    found = make_decode(layout, scope_of(server.url))(value)
    assert fields_of(found, layout) == {'a': read}


@pytest.mark.parametrize(
    ('change', 'shown'),
    [
        ({'scale': 2}, '9 bytes, decimal(20, 2)'),
        # fastavro would round to three digits.
        ({'precision': 3}, '9 bytes, decimal(3, 0)'),
        ({'logicalType': 'other'}, '9 bytes'),
        ({'size': 10}, '10 bytes, decimal(20, 0)'),
    ],
)
def test_a_uint64_of_another_scale_is_an_error(
    server: RegistryServer, change: dict[str, Any], shown: str
) -> None:
    writer = avro_schema(WIDE)
    writer['fields'][0]['type'] |= change
    value = framed(server.register('robots-value', json_text(writer)), bytes(11))
    with pytest.raises(DecodeError) as raised:
        make_decode(WIDE, scope_of(server.url))(value)
    assert str(raised.value) == (
        'schema 1 does not fit: $.a: expected fixed ros2.uint64 (9 bytes, decimal(20, 0)), '
        f'the schema has fixed ros2.uint64 ({shown})'
    )


def choices(levels: int, width: int) -> tuple[dict[str, Any], Layout]:
    """A schema with a choice of records in each record of a choice, and its message type."""
    layout = Layout('demo_msgs/msg/L0', (Field('a', Primitive('int32')),))
    fields: list[dict[str, Any]] = []
    inner: Any = {'name': 'a', 'type': 'int'}
    for level in range(levels):
        records = [
            {'type': 'record', 'name': f'p{number}.L{level}', 'fields': [inner]}
            for number in range(width)
        ]
        fields.append({'name': f'd{level}', 'type': ['null', *records]})
        inner = {'name': 'a', 'type': [f'p{number}.L{level}' for number in range(width)]}
        layout = Layout(f'demo_msgs/msg/L{level + 1}', (Field('a', layout),))
    writer = {'type': 'record', 'name': f'demo_msgs.msg.L{levels}', 'fields': [*fields, inner]}
    return writer, layout


def test_a_small_schema_with_many_ways_to_a_record_is_read_at_once(server: RegistryServer) -> None:
    """There are 40^6 ways to the last field."""
    writer, layout = choices(6, 40)
    payload = b'\0' * 6 + b'\x02\x04\x06\x08\x0a\x0c' + b'\x0e'
    value = framed(server.register('robots-value', json_text(writer)), payload)
    found = fields_of(make_decode(layout, scope_of(server.url))(value), layout)
    for _ in range(6):
        found = found['a']
    assert found == {'a': 7}
