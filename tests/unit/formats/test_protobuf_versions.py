"""protobuf whose writer has another schema: what is made of each difference."""

import base64
from typing import Any

import pytest
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from support.formats.protobuf import NUMBER, SEVEN, mine, scope, serialized
from support.registry.server import RegistryServer

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.protobuf.schema import make_class, make_files
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String


def read_by(server: RegistryServer, writer: Layout, reader: Layout, **fields: Any) -> bytes:
    """What a route for one version reads of a record that another one has written."""
    server.set_compatibility('NONE')
    prefix = make_encode(writer, scope(server))(b'\0\1\0\0' + bytes(64)[: _size(writer)])[:6]
    written = make_class(writer)(**fields).SerializeToString()
    return make_decode(reader, scope(server))(prefix + written)


def _size(layout: Layout) -> int:
    """Of the shortest message; all fields of these tests have 4 bytes, a string 5."""
    return 4 * len(layout.fields) + any(isinstance(f.kind, String) for f in layout.fields) or 1


def test_a_field_that_the_writer_did_not_know_is_zero(server: RegistryServer) -> None:
    newer = mine(('number', Primitive('int32')), ('more', Array(Primitive('float32'), 2)))
    assert read_by(server, NUMBER, newer, number=7) == SEVEN + bytes(8)


def test_a_field_that_the_reader_does_not_know_is_left_out(server: RegistryServer) -> None:
    newer = mine(('number', Primitive('int32')), ('more', Primitive('float32')))
    assert read_by(server, newer, NUMBER, number=7, more=0.5) == SEVEN


def test_a_field_that_was_put_in_between_is_refused(server: RegistryServer) -> None:
    """All of one kind: every value would become that of its neighbour."""
    whole = Primitive('int32')
    here = mine(*((name, whole) for name in 'xyz'))
    with pytest.raises(DecodeError) as caught:
        read_by(server, mine(*((name, whole) for name in 'wxyz')), here, w=9, x=1, y=2, z=3)
    assert str(caught.value) == 'schema 1: $.x: was written with the number 2, and has 1 here'
    with pytest.raises(DecodeError, match=r'\$\.x: was written with the number 3'):
        read_by(server, mine(*((name, whole) for name in 'zyx')), here, x=1)


def test_a_schema_without_any_field_of_the_type_makes_no_message_of_zeros(
    server: RegistryServer,
) -> None:
    file = FileDescriptorProto(name='other.proto', package='robot.msg', syntax='proto3')
    text = FieldDescriptorProto.TYPE_STRING
    file.message_type.add(name='Mine').field.add(name='text', number=5, type=text)
    schema = base64.b64encode(file.SerializeToString()).decode()
    schema_id = server.register('robots-value', schema, 'PROTOBUF')
    with pytest.raises(DecodeError) as caught:
        make_decode(NUMBER, scope(server))(
            b'\0' + schema_id.to_bytes(4, 'big') + b'\0\x2a\x05hello'
        )
    assert str(caught.value) == (
        'schema 1: no field of robot.msg.Mine there is one of it here: all would be zero'
    )


def test_a_version_without_fields_is_one_of_zeros(server: RegistryServer) -> None:
    assert read_by(server, mine(), NUMBER) == SEVEN[:4] + bytes(4)
    assert read_by(server, NUMBER, mine(), number=7) == SEVEN[:4] + bytes(1)


def test_a_field_that_was_renamed_is_the_same_field(server: RegistryServer) -> None:
    renamed = mine(('count', Primitive('int32')))
    assert read_by(server, NUMBER, renamed, number=7) == SEVEN


def test_a_wider_integer_takes_a_narrower_one(server: RegistryServer) -> None:
    wide = mine(('number', Primitive('int64')))
    assert read_by(server, NUMBER, wide, number=-7)[4:] == (-7).to_bytes(8, 'little', signed=True)


@pytest.mark.parametrize(
    ('there', 'here', 'said'),
    [
        (Primitive('float32'), Primitive('int32'), 'was written as float it, and is int32 here'),
        (Primitive('int32'), String(), 'was written as int32 it, and is string here'),
        (Primitive('uint32'), Primitive('int32'), 'was written as uint32 it, and is int32 here'),
        (
            Sequence(Primitive('int8')),
            Sequence(Primitive('uint8')),
            'was written as repeated int32 it, and is bytes here',
        ),
        (
            Sequence(Primitive('int32')),
            Primitive('int32'),
            'was written as repeated int32 it, and is int32 here',
        ),
    ],
)
def test_a_field_whose_value_would_change_is_refused(
    server: RegistryServer, there: Kind, here: Kind, said: str
) -> None:
    with pytest.raises(DecodeError) as caught:
        read_by(server, mine(('it', there)), mine(('it', here)))
    assert str(caught.value) == f'schema 1: $.it: {said}'


def test_a_change_deep_inside_is_refused_with_its_path(server: RegistryServer) -> None:
    def outer(kind: Kind) -> Layout:
        return mine(('inner', mine(('it', kind), name='robot/msg/Inner')))

    record = make_encode(outer(Primitive('int32')), scope(server))(SEVEN)
    with pytest.raises(DecodeError, match=r'\$\.inner\.it: was written as int32 it'):
        make_decode(outer(Primitive('float32')), scope(server))(record)


def test_a_record_of_another_type_is_refused(server: RegistryServer) -> None:
    other = mine(('number', Primitive('int32')), name='robot/msg/Other')
    record = make_encode(other, scope(server))(SEVEN)
    said = 'schema 1: is of robot.msg.Other, and this route reads robot.msg.Mine'
    with pytest.raises(DecodeError, match=said):
        make_decode(NUMBER, scope(server))(record)


@pytest.mark.parametrize(
    ('kind', 'text', 'said'),
    [
        ('AVRO', '"int"', 'schema 1: is AVRO, not PROTOBUF'),
        ('PROTOBUF', 'syntax = "proto3";', 'does not serve .format=serialized'),
        ('PROTOBUF', base64.b64encode(b'\xff').decode(), 'does not serve .format=serialized'),
        (
            'PROTOBUF',
            base64.b64encode(
                FileDescriptorProto(dependency=['missing.proto']).SerializeToString()
            ).decode(),
            'cannot be used',
        ),
        (
            'PROTOBUF',
            base64.b64encode(
                FileDescriptorProto(dependency=['google/none.proto']).SerializeToString()
            ).decode(),
            'cannot be used',
        ),
    ],
)
def test_a_schema_that_is_none_of_protobuf_is_refused(
    server: RegistryServer, kind: str, text: str, said: str
) -> None:
    server.register('robots-value', text, kind)
    with pytest.raises(DecodeError, match=said):
        make_decode(NUMBER, scope(server))(b'\x00\x00\x00\x00\x01\x00\x08\x07')


def test_the_message_may_be_one_of_many_in_a_schema_with_what_protobuf_ships(
    server: RegistryServer,
) -> None:
    [ours] = make_files(NUMBER)
    file = FileDescriptorProto(
        name='all.proto',
        package='robot.msg',
        syntax='proto3',
        dependency=[TIMESTAMP.name],
    )
    file.message_type.add(name='Other').field.add(
        name='stamp',
        number=1,
        type=FieldDescriptorProto.TYPE_MESSAGE,
        type_name='.google.protobuf.Timestamp',
    )
    file.message_type.add().CopyFrom(ours.message_type[0])
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(TIMESTAMP.serialized_pb)
    pool.Add(file)
    descriptor = pool.FindMessageTypeByName('robot.msg.Mine')
    message_class: Any = message_factory.GetMessageClass(descriptor)
    record = serialized(server, message_class(number=7))
    assert record[5:7] == b'\x02\x02'
    assert make_decode(NUMBER, scope(server))(record) == SEVEN
