"""Records whose Protobuf schema another program has registered: what of it is read, and how."""

import base64
from typing import Any

import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from support.formats.avro import fields_of, framed
from support.registry.server import RegistryServer

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Kind, Layout, Primitive, Sequence, String

BYTES = Sequence(Primitive('uint8'))


def scope(server: RegistryServer) -> Scope:
    return Scope('robots', schema=SchemaSettings(), registry={'url': server.url})


def one(kind: Kind) -> Layout:
    return Layout('robot/msg/One', (Field('it', kind),))


def file_of(kind: str, **more: Any) -> FileDescriptorProto:
    """A schema of a message with one field, as another program registers it."""
    file = FileDescriptorProto(name='one.proto', package='robot.msg', syntax='proto3')
    file.enum_type.add(name='Colour').value.add(name='RED', number=0)
    file.enum_type[0].value.add(name='BLUE', number=2)
    field = file.message_type.add(name='One').field.add(name='it', number=1, label=1)
    field.type = FieldDescriptorProto.Type.Value(f'TYPE_{kind.upper()}')
    if kind == 'enum':
        field.type_name = '.robot.msg.Colour'
    for name, value in more.items():
        setattr(field, name, value)
    if more.get('proto3_optional'):
        file.message_type[0].oneof_decl.add(name='_it')
        field.oneof_index = 0
    return file


def text_of(file: FileDescriptorProto) -> str:
    return base64.b64encode(file.SerializeToString()).decode()


def read(server: RegistryServer, file: FileDescriptorProto, value: bytes, kind: Kind) -> Any:
    """What a route reads of a record of a schema."""
    schema_id = server.register('robots-value', text_of(file), 'PROTOBUF')
    found = make_decode(one(kind), scope(server))(framed(schema_id, b'\0' + value))
    return fields_of(found, one(kind))['it']


@pytest.mark.parametrize(
    ('written', 'value', 'kind', 'expected'),
    [
        ('enum', b'\x08\x02', Primitive('int32'), 2),
        ('enum', b'\x08\x02', Primitive('int64'), 2),
        ('bool', b'\x08\x01', Primitive('int32'), 1),
        ('bool', b'\x08\x01', Primitive('uint64'), 1),
        ('uint32', b'\x08\xff\xff\xff\xff\x0f', Primitive('int64'), 2**32 - 1),
        ('string', b'\x0a\x02hi', BYTES, b'hi'),
        ('bytes', b'\x0a\x02hi', String(), 'hi'),
    ],
)
def test_what_has_the_same_bytes_and_the_same_values_is_taken(
    server: RegistryServer, written: str, value: bytes, kind: Kind, expected: object
) -> None:
    assert read(server, file_of(written), value, kind) == expected


def test_bytes_that_are_no_text_are_no_text(server: RegistryServer) -> None:
    with pytest.raises(DecodeError):
        read(server, file_of('bytes'), b'\x0a\x02\xff\xff', String())


@pytest.mark.parametrize('written', ['sint32', 'fixed32', 'float', 'enum'])
def test_another_number_is_refused(server: RegistryServer, written: str) -> None:
    with pytest.raises(DecodeError, match=rf'\$\.it: was written as {written}.* it, and is uint'):
        read(server, file_of(written), b'', Primitive('uint32'))


@pytest.mark.parametrize(('value', 'items'), [(b'\x08\x07', [7]), (b'\x08\0', [0]), (b'', [])])
def test_a_value_that_may_be_missing_becomes_a_list(
    server: RegistryServer, value: bytes, items: list[int]
) -> None:
    file = file_of('int32', proto3_optional=True)
    assert read(server, file, value, Sequence(Primitive('int32'))) == items


def test_one_number_becomes_no_list_because_a_zero_is_not_written(server: RegistryServer) -> None:
    said = r'\$\.it: was written as int32 it, and is repeated int32 here'
    with pytest.raises(DecodeError, match=said):
        read(server, file_of('int32'), b'\x08\x07', Sequence(Primitive('int32')))


def test_one_message_becomes_a_list_of_one(server: RegistryServer) -> None:
    inner = Layout('robot/msg/Inner', (Field('x', Primitive('int32')),))
    server.set_compatibility('NONE')
    record = make_encode(one(inner), scope(server))(b'\0\1\0\0\0\0\0\0')
    found = make_decode(one(Sequence(inner)), scope(server))(record)
    assert fields_of(found, one(Sequence(inner))) == {'it': [{'x': 0}]}


def test_a_field_that_only_the_writer_has_is_left_out_at_any_depth(server: RegistryServer) -> None:
    old = Layout('robot/msg/Inner', (Field('x', Primitive('int32')),))
    new = Layout('robot/msg/Inner', (*old.fields, Field('y', Primitive('int32'))))
    record = make_encode(one(new), scope(server))(b'\0\1\0\0\7\0\0\0\x08\0\0\0')
    assert make_decode(one(old), scope(server))(record) == b'\0\1\0\0\7\0\0\0'


@pytest.mark.parametrize(('default', 'refused'), [('5', True), ('0', False)])
def test_a_default_of_the_writer_is_refused(
    server: RegistryServer, default: str, *, refused: bool
) -> None:
    """Its record has nothing where 5 is meant, and a reader of Protobuf sees zero."""
    file = file_of('int32', default_value=default)
    file.syntax = 'proto2'
    if not refused:
        assert read(server, file, b'', Primitive('int32')) == 0
        return
    with pytest.raises(DecodeError, match=r'\$\.it: was written with a default of its own \(5\)'):
        read(server, file, b'\x08\x07', Primitive('int32'))


@pytest.mark.parametrize('kind', ['domainRules', 'encodingRules'])
def test_the_records_of_a_schema_with_rules_are_refused(server: RegistryServer, kind: str) -> None:
    rules = {kind: [{'name': 'decrypt', 'type': 'ENCRYPT', 'kind': 'TRANSFORM', 'mode': 'READ'}]}
    text = text_of(file_of('int32'))
    schema_id = server.register('robots-value', text, 'PROTOBUF', rules=rules)
    with pytest.raises(DecodeError, match='has rules'):
        make_decode(one(Primitive('int32')), scope(server))(framed(schema_id, b'\0\x08\7'))


@pytest.mark.parametrize('changed', [False, True])
def test_what_protobuf_ships_may_be_a_reference_as_well(
    server: RegistryServer, *, changed: bool
) -> None:
    """As of producers that register all that a schema imports."""
    stamp = FileDescriptorProto.FromString(TIMESTAMP.serialized_pb)
    if changed:
        stamp.options.java_package = 'com.example'
    place = FileDescriptorProto(
        name='google/type/place.proto', package='google.type', dependency=[stamp.name]
    )
    place.message_type.add(name='Place')
    whole = file_of('int32')
    whole.dependency.extend([place.name, stamp.name])
    references = []
    for file in (place, stamp):
        needs = ((stamp.name, stamp.name, 1),) if file is place else ()
        server.register(file.name, text_of(file), 'PROTOBUF', references=needs)
        references.append((file.name, file.name, 1))
    schema_id = server.register(
        'robots-value', text_of(whole), 'PROTOBUF', references=tuple(references)
    )
    found = make_decode(one(Primitive('int32')), scope(server))(framed(schema_id, b'\0\x08\7'))
    assert found == b'\0\1\0\0\7\0\0\0'
