"""Avro with a Schema Registry: what is asked, what others read and write, other versions."""

import io
import json
import tracemalloc
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

import avro.io
import avro.schema
import pytest
from avro_messages import (
    ROBOT,
    WIDE,
    avro_bytes,
    cdr_from,
    fields_of,
    framed,
    json_text,
    make_cdr_from,
    scope_of,
)
from confluent_kafka.schema_registry import SchemaRegistryClient
from confluent_kafka.schema_registry.avro import AvroDeserializer, AvroSerializer
from confluent_kafka.serialization import MessageField, SerializationContext
from messages import cdr, extremes, layout_of
from registry_server import RegistryServer, Request

from benchmarks.fuzz_versions import registry_of
from ros2_kafka_bridge.errors import ConfigError, DecodeError, RecordTooLargeError, RouteError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.avro.versions import version_of
from ros2_kafka_bridge.message_types import load_layout, type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)

STRING = load_layout('std_msgs/msg/String')
TOPIC = SerializationContext('robots', MessageField.VALUE)
BY_TOPIC = {'subject.name.strategy.type': 'TOPIC'}


@pytest.fixture
def server() -> Iterator[RegistryServer]:
    with RegistryServer() as one:
        yield one
        assert one.problems == []


@pytest.fixture(scope='module')
def shared() -> Iterator[RegistryServer]:
    with RegistryServer() as one:
        yield one
        assert one.problems == []


def robot(**fields: Any) -> dict[str, Any]:
    found: dict[str, Any] = fields_of(cdr_from(ROBOT, fields), ROBOT)
    return found


def changed(layout: Layout, *fields: Field, without: str = '') -> Layout:
    """Another version of a type."""
    kept = tuple(field for field in layout.fields if field.name != without)
    return Layout(layout.type_name, (*kept, *fields))


@pytest.mark.parametrize('name', type_names())
def test_every_type_comes_back_from_a_registry_as_the_same_bytes(
    name: str, shared: RegistryServer
) -> None:
    scope = scope_of(shared.url, name.replace('/', '.'))
    encode, decode = make_encode(layout_of(name), scope), make_decode(layout_of(name), scope)
    for value in extremes(name):
        assert decode(encode(value)) == value


def test_a_value_has_the_id_of_its_schema_before_it(server: RegistryServer) -> None:
    server.register('elsewhere-value', '"int"')
    value = make_encode(STRING, scope_of(server.url))(cdr('std_msgs/msg/String', data='hi'))
    assert value == b'\0\0\0\0\x02' + b'\x04hi'
    (entry,) = server.versions('robots-value')
    assert json.loads(entry.text) == avro_schema(STRING)


def test_the_function_that_encodes_asks_no_network(server: RegistryServer) -> None:
    encode = make_encode(ROBOT, scope_of(server.url))
    assert server.requests == [
        Request('POST', '/subjects/robots-value/versions', {'normalize': 'False'})
    ]
    server.stop()
    for level in range(50):
        assert encode(cdr_from(ROBOT, {'level': level}))
    server.start()
    assert len(server.requests) == 1


def test_the_function_that_decodes_asks_once_for_each_id(server: RegistryServer) -> None:
    scope = scope_of(server.url)
    value = make_encode(ROBOT, scope)(cdr_from(ROBOT, {'level': 7}))
    other = framed(
        server.register('robots-value', json_text(avro_schema(changed(ROBOT, without='level')))),
        avro_bytes(avro_schema(changed(ROBOT, without='level')), robot()),
    )
    server.requests.clear()
    decode = make_decode(ROBOT, scope)
    assert server.requests == []
    for _ in range(10):
        assert fields_of(decode(value), ROBOT)['level'] == 7
        assert fields_of(decode(other), ROBOT)['level'] == 0
    assert [request.path for request in server.requests] == ['/schemas/ids/1', '/schemas/ids/2']


@pytest.mark.parametrize(
    ('strategy', 'subject'),
    [
        ('topic', 'robots-value'),
        ('record', 'demo_msgs.msg.Robot'),
        ('topic_record', 'robots-demo_msgs.msg.Robot'),
    ],
)
def test_the_subject_follows_the_strategy_of_the_route(
    server: RegistryServer, strategy: str, subject: str
) -> None:
    scope = scope_of(server.url, subject=strategy)
    value = cdr_from(ROBOT, {'level': 3})
    assert make_decode(ROBOT, scope)(make_encode(ROBOT, scope)(value)) == value
    assert server.subjects() == [subject]
    assert len(server.requests) == 2


def test_without_auto_register_the_schema_is_only_looked_up(server: RegistryServer) -> None:
    scope = scope_of(server.url, auto_register=False)
    with pytest.raises(ConfigError) as raised:
        make_encode(ROBOT, scope)
    assert str(raised.value) == (
        f'{server.url} has no schema of demo_msgs/msg/Robot in subject robots-value, and '
        'auto_register is false: register what `ros2-kafka-bridge schema demo_msgs/msg/Robot '
        '--format avro` prints, or set schema: {auto_register: true}'
    )
    # Spaces, as people print it, make no other schema.
    server.register('robots-value', json.dumps(avro_schema(ROBOT), indent=2))
    assert make_encode(ROBOT, scope)(cdr_from(ROBOT, {}))
    assert [request.path for request in server.requests] == ['/subjects/robots-value'] * 2


def test_a_registry_that_tells_schemas_apart_by_their_spaces_is_understood(
    server: RegistryServer,
) -> None:
    server.exact = True
    server.register('robots-value', json_text(avro_schema(STRING)))
    schema_id = server.register('robots-value', json.dumps(avro_schema(ROBOT), indent=2))
    server.register('robots-value', 'no JSON')
    value = make_encode(ROBOT, scope_of(server.url, auto_register=False))(cdr_from(ROBOT, {}))
    assert value[:5] == framed(schema_id, b'')


def test_another_schema_in_the_subject_is_not_taken_for_ours(server: RegistryServer) -> None:
    server.register('robots-value', json_text(avro_schema(STRING)))
    with pytest.raises(ConfigError, match='has no schema of demo_msgs/msg/Robot in subject'):
        make_encode(ROBOT, scope_of(server.url, auto_register=False))


def test_the_plain_deserializer_of_confluent_reads_what_is_written_here(
    shared: RegistryServer,
) -> None:
    names = ('std_msgs/msg/Empty', 'nav_msgs/msg/Odometry', 'test_msgs/msg/Defaults')
    with SchemaRegistryClient({'url': shared.url}) as client:
        read: Any = AvroDeserializer(client, conf=BY_TOPIC)
        for name in names:
            layout = layout_of(name)
            topic = f'plain-{name.replace("/", ".")}'
            encode = make_encode(layout, scope_of(shared.url, topic))
            for value in extremes(name):
                found = read(encode(value), SerializationContext(topic, MessageField.VALUE))
                # By their text, because NaN is not equal to itself.
                kept = {field.name: found[field.name] for field in layout.fields}
                assert repr(kept) == repr(fields_of(value, layout))


def test_the_library_of_apache_reads_what_is_written_here(server: RegistryServer) -> None:
    value = make_encode(ROBOT, scope_of(server.url))(cdr_from(ROBOT, {'tags': ['a', 'b']}))
    schema = avro.schema.parse(server.versions('robots-value')[0].text)
    found = avro.io.DatumReader(schema).read(avro.io.BinaryDecoder(io.BytesIO(value[5:])))
    assert found == robot(tags=['a', 'b'])


def test_what_the_plain_serializer_of_confluent_writes_is_read_here(
    server: RegistryServer,
) -> None:
    with SchemaRegistryClient({'url': server.url}) as client:
        write: Any = AvroSerializer(client, json_text(avro_schema(ROBOT)), conf=BY_TOPIC)
        value = write(robot(name='r7', stops=[{'x': 1.5, 'mark': 'ß'}]), TOPIC)
    found = fields_of(make_decode(ROBOT, scope_of(server.url))(value), ROBOT)
    assert found == robot(name='r7', stops=[{'x': 1.5, 'mark': 'ß'}])


def decoded(
    server: RegistryServer, schema: Any, found: Any, reader: Layout = ROBOT
) -> dict[str, Any]:
    """What is read of a value that another program has written with its schema."""
    value = framed(server.register('robots-value', json_text(schema)), avro_bytes(schema, found))
    fields: dict[str, Any] = fields_of(make_decode(reader, scope_of(server.url))(value), reader)
    return fields


def test_a_field_that_the_writer_did_not_have_is_as_the_definition_says(
    server: RegistryServer,
) -> None:
    wide = Primitive('uint64')
    stamp = Layout('demo_msgs/msg/Stamp', (Field('id', wide, 9), Field('raw', String(), 'x')))
    more = (
        Field('photo2', Array(Primitive('uint8'), 3), (1, 2, 255)),
        Field('serial', wide, 2**64 - 1),
        Field('serials', Sequence(wide), (1, 2)),
        Field('battery', Primitive('float32'), 0.25),
        Field('home', stamp),
        Field('names', Sequence(String()), ('a', 'b')),
    )
    found = decoded(server, avro_schema(ROBOT), robot(level=2), changed(ROBOT, *more))
    assert found['level'] == 2
    assert found['photo2'] == b'\x01\x02\xff'
    assert found['serial'] == 2**64 - 1
    assert found['serials'] == [1, 2]
    assert found['battery'] == 0.25
    assert found['home'] == {'id': 9, 'raw': 'x'}
    assert found['names'] == ['a', 'b']


def test_a_default_within_a_nested_message_is_as_the_definition_says(
    server: RegistryServer,
) -> None:
    old = Layout('demo_msgs/msg/Part', (Field('a', Primitive('int32')),))
    new = changed(old, Field('raw', Sequence(Primitive('uint8')), (7, 200)))
    whole = Layout('demo_msgs/msg/Whole', (Field('one', old), Field('all', Sequence(old))))
    ours = Layout('demo_msgs/msg/Whole', (Field('one', new), Field('all', Sequence(new))))
    found = decoded(
        server, avro_schema(whole), {'one': {'a': 1}, 'all': [{'a': 2}, {'a': 3}]}, ours
    )
    assert found == {
        'one': {'a': 1, 'raw': b'\x07\xc8'},
        'all': [{'a': 2, 'raw': b'\x07\xc8'}, {'a': 3, 'raw': b'\x07\xc8'}],
    }


def within(layout: Layout) -> Iterator[Layout]:
    """A type and all types in it, at any depth."""
    yield layout
    for field in layout.fields:
        kind = field.kind.item if isinstance(field.kind, Array | Sequence) else field.kind
        if isinstance(kind, Layout):
            yield from within(kind)


def older(kind: Kind, changed_type: str, without: str) -> Kind:
    """A kind as it was before a type in it had a field."""
    match kind:
        case Array():
            return Array(older(kind.item, changed_type, without), kind.length)
        case Sequence():
            return Sequence(older(kind.item, changed_type, without), kind.bound)
        case Layout():
            lacks = without if kind.type_name == changed_type else ''
            kept = [field for field in kind.fields if field.name != lacks]
            fields = [f._replace(kind=older(f.kind, changed_type, without)) for f in kept]
            return Layout(kind.type_name, tuple(fields))
        case _:
            return kind


def as_written(found: Any, kind: Kind) -> Any:
    """The fields that a version of a type has."""
    match kind:
        case Array() | Sequence() if isinstance(kind.item, Layout):
            return [as_written(item, kind.item) for item in found]
        case Layout():
            return {f.name: as_written(found[f.name], f.kind) for f in kind.fields}
        case _:
            return found


@pytest.mark.parametrize('name', type_names())
def test_every_field_that_the_writer_lacks_at_any_depth_is_as_the_definition_says(
    name: str, server: RegistryServer
) -> None:
    """One writer for each field of each type within."""
    layout = layout_of(name)
    found = fields_of(extremes(name)[0], layout)
    decode, cdr_of = make_decode(layout, scope_of(server.url)), make_cdr_from(layout)
    fields = {(one.type_name, field.name) for one in within(layout) for field in one.fields}
    for place in sorted(fields):
        written = older(layout, *place)
        assert isinstance(written, Layout)
        schema, values = avro_schema(written), as_written(found, written)
        schema_id = server.register('robots-value', json_text(schema))
        value = framed(schema_id, avro_bytes(schema, values))
        assert decode(value) == cdr_of(values), place


def test_a_default_deep_within_a_branch_of_a_union_is_as_the_definition_says(
    server: RegistryServer,
) -> None:
    """Only the value tells which version of the message it is."""
    stamp = Layout('demo_msgs/msg/Stamp', (Field('raw', Array(Primitive('uint8'), 2), (7, 200)),))
    mark = Layout(
        'demo_msgs/msg/Mark', (Field('stamp', stamp), Field('id', Primitive('uint64'), 9))
    )
    ours = Layout('demo_msgs/msg/Whole', (Field('mark', mark),))
    fields = avro_schema(ours)['fields'][0]['type']['fields']
    some = [
        {'type': 'record', 'name': f'{package}.msg.Mark', 'fields': kept}
        for package, kept in (('old_msgs', fields[:1]), ('new_msgs', fields[1:]))
    ]
    writer = avro_schema(ours) | {'fields': [{'name': 'mark', 'type': some}]}
    schema_id = server.register('robots-value', json_text(writer))
    decode = make_decode(ours, scope_of(server.url))
    for branch, payload, read in (
        (b'\x00', b'\x04\x01\x02', {'stamp': {'raw': b'\x01\x02'}, 'id': 9}),
        (b'\x02', bytes(8) + b'\x05', {'stamp': {'raw': b'\x07\xc8'}, 'id': 5}),
    ):
        assert fields_of(decode(framed(schema_id, branch + payload)), ours) == {'mark': read}


def test_a_field_that_is_not_here_any_more_is_passed_over(server: RegistryServer) -> None:
    writer = avro_schema(changed(ROBOT, Field('old', Sequence(String()))))
    assert decoded(server, writer, robot(level=4) | {'old': ['a', 'b']})['level'] == 4


def test_the_order_of_fields_does_not_matter(server: RegistryServer) -> None:
    writer = avro_schema(ROBOT)
    writer['fields'].reverse()
    assert decoded(server, writer, robot(name='r1', level=4)) == robot(name='r1', level=4)


@pytest.mark.parametrize(
    ('written', 'value', 'kind', 'read'),
    [
        ('int', 7, 'int64', 7),
        ('int', 7, 'float64', 7.0),
        ('long', 2**40, 'float64', 2.0**40),
        ('float', 0.5, 'float64', 0.5),
        ('int', 7, 'float32', 7.0),
        (['null', 'int'], 7, 'int32', 7),
        ({'type': 'int', 'other': 1}, 7, 'int32', 7),
    ],
)
def test_a_narrower_type_is_promoted(
    server: RegistryServer, written: Any, value: Any, kind: str, read: object
) -> None:
    layout = Layout('demo_msgs/msg/One', (Field('a', Primitive(kind)),))
    writer = {'type': 'record', 'name': 'One', 'fields': [{'name': 'a', 'type': written}]}
    assert decoded(server, writer, {'a': value}, layout) == {'a': read}


@pytest.mark.parametrize(
    ('written', 'value', 'said'),
    [
        ('string', '7', r'schema 1 does not fit: \$\.a: expected int, the schema has string'),
        ('long', 7, r'schema 1 does not fit: \$\.a: expected int, the schema has long'),
        (
            {'type': 'array', 'items': 'int'},
            [7],
            r'schema 1 does not fit: \$\.a: expected int, the schema has array',
        ),
        (
            {'type': 'enum', 'name': 'Colour', 'symbols': ['RED']},
            'RED',
            r'expected int, the schema has enum Colour',
        ),
        (
            ['null', 'int'],
            None,
            r'^schema 1 allows several types .* does not fit demo_msgs/msg/One$',
        ),
    ],
)
def test_a_type_that_avro_does_not_promote_is_an_error_with_its_path(
    server: RegistryServer, written: Any, value: Any, said: str
) -> None:
    layout = Layout('demo_msgs/msg/One', (Field('a', Primitive('int32')),))
    writer = {'type': 'record', 'name': 'One', 'fields': [{'name': 'a', 'type': written}]}
    with pytest.raises(DecodeError, match=said):
        decoded(server, writer, {'a': value}, layout)


def test_a_record_of_another_name_is_an_error(server: RegistryServer) -> None:
    writer = avro_schema(ROBOT) | {'name': 'Drone'}
    with pytest.raises(DecodeError) as raised:
        decoded(server, writer, robot())
    assert str(raised.value) == (
        'schema 1 does not fit: $: expected record demo_msgs.msg.Robot, '
        'the schema has record demo_msgs.msg.Drone'
    )


def test_a_record_of_the_same_short_name_in_another_package_is_an_error(
    server: RegistryServer,
) -> None:
    """Every field of ours has a default: read by Avro's rules, it would be a message of zeros."""
    fields = [{'name': 'text', 'type': 'string'}]
    other = {'type': 'record', 'name': 'String', 'namespace': 'com.acme', 'fields': fields}
    with pytest.raises(DecodeError) as raised:
        decoded(server, other, {'text': 'hello'}, STRING)
    assert str(raised.value) == (
        'schema 1 does not fit: $: expected record std_msgs.msg.String, '
        'the schema has record com.acme.String'
    )
    with pytest.raises(DecodeError, match=r'the schema has record com\.acme\.String'):
        decoded(server, [avro_schema(STRING), other], {'text': 'hello'}, STRING)


def test_a_writer_without_a_namespace_is_understood(server: RegistryServer) -> None:
    writer = avro_schema(ROBOT)
    del writer['namespace']
    assert decoded(server, writer, robot(level=6))['level'] == 6


def test_a_message_within_may_be_of_a_package_that_was_renamed(server: RegistryServer) -> None:
    writer = avro_schema(ROBOT)
    stop = writer['fields'][-1]['type']['items']
    stop['namespace'] = 'old_msgs.msg'
    stops = [{'x': 1.5, 'mark': 'm'}]
    assert decoded(server, writer, robot(stops=stops))['stops'] == stops
    stop['fields'] = [{'name': 'colour', 'type': 'string'}]
    with pytest.raises(DecodeError, match=r'\$\.stops\[\]: .*the schema has record old_msgs'):
        decoded(server, writer, robot() | {'stops': [{'colour': 'red'}]})


def test_a_field_without_default_that_the_writer_did_not_have_is_an_error(
    server: RegistryServer,
) -> None:
    ours = changed(ROBOT, Field('photo2', Array(Primitive('uint8'), 100_000)))
    with pytest.raises(DecodeError, match=r'^schema 1 has no photo2, and .* no default for it'):
        decoded(server, avro_schema(ROBOT), robot(), ours)


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


ONE = Layout('demo_msgs/msg/One', (Field('a', Primitive('int32')),))
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


def test_a_topic_may_have_records_of_several_types(server: RegistryServer) -> None:
    """As Confluent has it: the schema of the topic is a choice of schemas that it refers to."""
    references = []
    for layout in (STRING, ROBOT):
        name = layout.type_name.replace('/', '.')
        server.register(name, json_text(avro_schema(layout)))
        references.append((name, name, 1))
    union = ['std_msgs.msg.String', 'demo_msgs.msg.Robot']
    schema_id = server.register('robots-value', json_text(union), references=tuple(references))
    robots = b'\x02' + avro_bytes(avro_schema(ROBOT), robot(level=7))
    for other in (b'\0\x04hi', b'\x02'):
        decode = make_decode(ROBOT, scope_of(server.url))
        with pytest.raises(DecodeError):
            decode(framed(schema_id, other))
        assert fields_of(decode(framed(schema_id, robots)), ROBOT)['level'] == 7
    with pytest.raises(DecodeError, match='allows several types at one place'):
        decode(framed(schema_id, b'\0\x04hi'))


def test_a_schema_may_be_the_name_of_another(server: RegistryServer) -> None:
    server.register('robot', json_text(avro_schema(ROBOT)))
    references = (('demo_msgs.msg.Robot', 'robot', 1),)
    text = '"demo_msgs.msg.Robot"'
    schema_id = server.register('robots-value', text, references=references)
    value = framed(schema_id, avro_bytes(avro_schema(ROBOT), robot(level=7)))
    assert fields_of(make_decode(ROBOT, scope_of(server.url))(value), ROBOT)['level'] == 7


def test_each_schema_that_others_refer_to_is_asked_for_once(server: RegistryServer) -> None:
    """Each of 30 refers twice to the one before: there are 2^30 ways to the first."""
    references: tuple[tuple[str, str, int], ...] = ()
    for level in range(30):
        text = json_text({'type': 'record', 'name': f'R{level}', 'fields': []})
        server.register(f'r{level}', text, references=references)
        references = ((f'R{level}', f'r{level}', 1), (f'again{level}', f'r{level}', 1))
    writer = json_text(avro_schema(ONE))
    schema_id = server.register('robots-value', writer, references=references)
    decode = make_decode(ONE, scope_of(server.url))
    assert fields_of(decode(framed(schema_id, b'\x0e')), ONE) == {'a': 7}
    assert len(server.requests) == 31


@pytest.mark.parametrize('body', [b'{}', b'{"status": "maintenance"}'])
def test_an_answer_without_a_schema_says_nothing_about_its_records(
    server: RegistryServer, body: bytes
) -> None:
    scope = scope_of(server.url)
    value = make_encode(ROBOT, scope)(cdr_from(ROBOT, {'level': 7}))
    decode = make_decode(ROBOT, scope)
    for _ in range(2):
        server.answer(200, 1, body)
        with pytest.raises(RouteError, match='something else than a registry does'):
            decode(value)
    assert fields_of(decode(value), ROBOT)['level'] == 7


def test_a_schema_may_refer_to_others(server: RegistryServer) -> None:
    """As a diamond: two refer to a third."""
    leaf = {'type': 'record', 'name': 'Stop', 'namespace': 'demo_msgs.msg'}
    leaf['fields'] = avro_schema(ROBOT)['fields'][-1]['type']['items']['fields']
    half: Any = {'type': 'record', 'name': 'Half', 'namespace': 'demo_msgs.msg'}
    half['fields'] = [{'name': 'stop', 'type': 'demo_msgs.msg.Stop'}]
    server.register('leaf', json_text(leaf))
    leaf_reference = ('demo_msgs.msg.Stop', 'leaf', 1)
    server.register('half', json_text(half), references=(leaf_reference,))
    writer = avro_schema(ROBOT)
    writer['fields'][-1]['type']['items'] = 'demo_msgs.msg.Stop'
    writer['fields'].append({'name': 'half', 'type': 'demo_msgs.msg.Half'})
    references = (('demo_msgs.msg.Half', 'half', 1), leaf_reference)
    schema_id = server.register('robots-value', json_text(writer), references=references)
    stop = {'x': 2.5, 'mark': 'm'}
    whole = avro_schema(ROBOT)
    half['fields'][0]['type'] = 'demo_msgs.msg.Stop'
    whole['fields'].append({'name': 'half', 'type': half})
    payload = avro_bytes(whole, robot(stops=[stop]) | {'half': {'stop': stop}})
    decode = make_decode(ROBOT, scope_of(server.url))
    for _ in range(3):
        assert fields_of(decode(framed(schema_id, payload)), ROBOT)['stops'] == [stop]
    # One for the schema, one for each that it refers to.
    assert len(server.requests) == 3


@pytest.mark.parametrize('kind', ['domainRules', 'encodingRules'])
@pytest.mark.parametrize(
    ('rule', 'followed'),
    [
        ({'kind': 'TRANSFORM', 'mode': 'READ'}, False),
        ({'kind': 'TRANSFORM', 'mode': 'WRITEREAD'}, False),
        ({'kind': 'CONDITION', 'mode': 'READ'}, False),
        ({'kind': 'TRANSFORM', 'mode': 'WRITE'}, True),
        ({'kind': 'CONDITION', 'mode': 'WRITE'}, True),
        ({'kind': 'TRANSFORM', 'mode': 'READ', 'disabled': True}, True),
    ],
)
def test_a_schema_with_a_rule_for_its_readers_is_an_error(
    server: RegistryServer, kind: str, rule: dict[str, Any], *, followed: bool
) -> None:
    """As one that decrypts a field: without it, the message would be another."""
    rules = {kind: [{'name': 'decrypt', 'type': 'ENCRYPT', 'tags': [], **rule}]}
    schema_id = server.register('robots-value', json_text(avro_schema(STRING)), rules=rules)
    decode = make_decode(STRING, scope_of(server.url))
    if followed:
        assert decode(framed(schema_id, b'\x04hi')) == cdr('std_msgs/msg/String', data='hi')
        return
    with pytest.raises(DecodeError, match=r'^schema 1 has the rule decrypt for its readers'):
        decode(framed(schema_id, b'\x04hi'))


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        (b'', r'^0 bytes: a value with the id of its schema has at least 5; was it written'),
        (b'\0\0\0\0', r'^4 bytes: '),
        (b'{"data": 1}', r'^begins with 0x7b, and the id of a schema has a zero byte before it'),
        (b'\x01' + bytes(20), r'^begins with 0x01, '),
        (framed(77, b'\x04hi'), r'has no schema with the id 77$'),
        (framed(1, b''), r'^not a value of schema 1: '),
        (framed(1, b'\x04h'), r'^not a value of schema 1: it ends in the middle of a field'),
        (framed(1, b'\x04hi!!'), r'^2 bytes behind the value of schema 1, at 8$'),
        (framed(1, b'\x04\xff\xff'), r'^not a value of schema 1: a text is not UTF-8$'),
        (None, r'^the value is null'),
    ],
)
def test_a_value_that_is_none_says_why(
    server: RegistryServer, value: bytes | None, said: str
) -> None:
    server.register('robots-value', json_text(avro_schema(STRING)))
    decode = make_decode(STRING, scope_of(server.url))
    with pytest.raises(DecodeError, match=said):
        decode(value)
    assert decode(framed(1, b'\x04hi')) == cdr('std_msgs/msg/String', data='hi')


def test_a_registry_that_dies_stops_no_encoding_and_the_decoding_of_new_ids_alone(
    server: RegistryServer,
) -> None:
    scope = scope_of(server.url, 'robots', {'max.retries': 0})
    value = cdr_from(ROBOT, {'level': 5})
    encode, decode = make_encode(ROBOT, scope), make_decode(ROBOT, scope)
    known = encode(value)
    assert decode(known) == value
    old = avro_schema(changed(ROBOT, without='level'))
    fresh = framed(server.register('robots-value', json_text(old)), avro_bytes(old, robot()))
    server.stop()
    assert decode(encode(value)) == value
    with pytest.raises(
        RouteError, match=r'^Schema Registry http://127.0.0.1:\d+: does not answer'
    ):
        decode(fresh)
    assert decode(known) == value
    server.start()
    assert fields_of(decode(fresh), ROBOT)['level'] == 0


def test_a_uint64_beyond_int64_comes_back_through_a_registry(server: RegistryServer) -> None:
    scope = scope_of(server.url)
    value = cdr_from(WIDE, {'a': Decimal(2**64 - 1), 'many': [Decimal(2**63), Decimal(0)]})
    assert make_decode(WIDE, scope)(make_encode(WIDE, scope)(value)) == value


def test_the_registry_that_confluent_mocks_is_one_too() -> None:
    encode = make_encode(ROBOT, scope_of('mock://'))
    assert encode(cdr_from(ROBOT, {}))[:1] == b'\0'
