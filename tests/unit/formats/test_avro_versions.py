"""Avro whose writer has another version of the type: what is made of each difference."""

from collections.abc import Iterator
from typing import Any

import pytest
from support.formats.avro import (
    ROBOT,
    STRING,
    avro_bytes,
    changed,
    decoded,
    fields_of,
    framed,
    json_text,
    make_cdr_from,
    robot,
    scope_of,
)
from support.formats.messages import extremes, layout_of
from support.registry.server import RegistryServer

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.avro import make_decode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.message_types import type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)


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


def test_a_schema_without_any_field_of_the_type_makes_no_message_of_defaults(
    server: RegistryServer,
) -> None:
    """Also where a program has given its own record the name of ours."""
    message = {'name': 'message', 'type': 'string'}
    for name in ('String', 'std_msgs.msg.String'):
        schema = {'type': 'record', 'name': name, 'fields': [message]}
        with pytest.raises(DecodeError) as caught:
            decoded(server, schema, {'message': 'hello'}, STRING)
        assert str(caught.value).endswith(
            f' does not fit: $: no field of record {name} is one of std_msgs.msg.String'
        )


def test_a_message_within_that_has_other_fields_now_has_its_defaults(
    server: RegistryServer,
) -> None:
    """A list of them may be empty, and the rest of such a record is what was meant."""
    part = Layout('demo_msgs/msg/Part', (Field('a', Primitive('int32')),))
    other = Layout(part.type_name, (Field('b', Primitive('int32')),))
    theirs, ours = (
        Layout('demo_msgs/msg/Whole', (Field('id', String()), Field('parts', Sequence(one))))
        for one in (other, part)
    )
    schema = avro_schema(theirs)
    assert decoded(server, schema, {'id': 'x', 'parts': []}, ours) == {'id': 'x', 'parts': []}
    written = {'id': 'x', 'parts': [{'b': 7}]}
    assert decoded(server, schema, written, ours) == {'id': 'x', 'parts': [{'a': 0}]}


def test_a_version_without_fields_is_one_of_defaults(server: RegistryServer) -> None:
    empty = Layout(STRING.type_name, ())
    nothing = {'structure_needs_at_least_one_member': 0}
    assert decoded(server, avro_schema(empty), nothing, STRING) == {'data': ''}
    server.set_compatibility('NONE')
    assert decoded(server, avro_schema(STRING), {'data': 'x'}, empty) == {}


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
