"""protobuf with a Schema Registry: what is registered, and whose records are read."""

import json
from typing import Any

import pytest
from confluent_kafka.schema_registry import SchemaRegistryClient
from confluent_kafka.schema_registry.protobuf import ProtobufDeserializer
from support.formats.messages import cdr, extremes
from support.formats.protobuf import BY_TOPIC, NUMBER, SEVEN, VALUE, mine, scope, serialized
from support.registry.server import RegistryServer

from ros2_kafka_bridge.errors import ConfigError, DecodeError, RouteError
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.protobuf.schema import make_class, protobuf_sources
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import document, load_layout
from ros2_kafka_bridge.message_types.layout import Layout, String

ODOMETRY = 'nav_msgs/msg/Odometry'


def odometry() -> Layout:
    return document(load_layout(ODOMETRY))


def test_a_record_comes_back_and_confluents_deserializer_reads_it(server: RegistryServer) -> None:
    layout = odometry()
    encode, decode = (make(layout, scope(server)) for make in (make_encode, make_decode))
    with SchemaRegistryClient({'url': server.url}) as client:
        deserialize: Any = ProtobufDeserializer(make_class(layout), BY_TOPIC, client)
        for value in extremes(ODOMETRY):
            record = encode(value)
            assert decode(record) == value
            assert deserialize(record, VALUE).SerializeToString() == record[6:]


def test_a_record_of_confluents_serializer_is_read(server: RegistryServer) -> None:
    layout = odometry()
    record = serialized(server, make_class(layout)(child_frame_id='base_link'))
    assert b'base_link' in make_decode(layout, scope(server))(record)


def test_the_types_in_a_type_are_registered_as_references(server: RegistryServer) -> None:
    make_encode(odometry(), scope(server))
    assert 'geometry_msgs/msg/Vector3.proto' in server.subjects()
    [entry] = server.versions('robots-value')
    assert entry.references == tuple(
        (f'{name}.proto', f'{name}.proto', 1)
        for name in (
            'std_msgs/msg/Header',
            'geometry_msgs/msg/PoseWithCovariance',
            'geometry_msgs/msg/TwistWithCovariance',
        )
    )
    # What every reader has is no reference.
    assert 'confluent/meta.proto' not in server.subjects()


def test_the_same_schema_is_registered_once(server: RegistryServer) -> None:
    for _ in range(3):
        make_encode(odometry(), scope(server))
    assert len(server.versions('robots-value')) == 1


@pytest.mark.parametrize(
    ('settings', 'subject'),
    [
        ({}, 'robots-value'),
        ({'subject': 'record'}, 'robot.msg.Mine'),
        ({'subject': 'topic_record'}, 'robots-robot.msg.Mine'),
    ],
)
def test_the_subject_has_the_name_that_the_route_asks_for(
    server: RegistryServer, settings: dict[str, str], subject: str
) -> None:
    make_encode(NUMBER, scope(server, **settings))
    assert server.subjects() == [subject]


def test_the_function_made_asks_nobody(server: RegistryServer) -> None:
    encode = make_encode(NUMBER, scope(server))
    server.stop()
    assert encode(SEVEN)[5:] == b'\x00\x08\x07'


def test_a_schema_is_asked_for_once(server: RegistryServer) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    decode = make_decode(NUMBER, scope(server))
    assert decode(record) == SEVEN
    server.stop()
    assert decode(record) == SEVEN


def test_a_schema_is_looked_up_where_it_may_not_be_registered(server: RegistryServer) -> None:
    with pytest.raises(ConfigError, match='auto_register') as caught:
        make_encode(NUMBER, scope(server, auto_register=False))
    assert 'schema robot/msg/Mine --format protobuf' in str(caught.value)
    assert server.subjects() == []
    make_encode(NUMBER, scope(server))
    assert make_encode(NUMBER, scope(server, auto_register=False))(SEVEN)[5:] == b'\x00\x08\x07'


def test_what_is_printed_may_be_registered_by_hand(server: RegistryServer) -> None:
    layout = document(load_layout('std_msgs/msg/Header'))
    time, header = 'builtin_interfaces/msg/Time.proto', 'std_msgs/msg/Header.proto'
    sources = protobuf_sources(layout)
    server.register(time, sources[time], 'PROTOBUF')
    number = server.register('robots-value', sources[header], 'PROTOBUF', ((time, time, 1),))
    record = make_encode(layout, scope(server, auto_register=False))(cdr('std_msgs/msg/Header'))
    assert int.from_bytes(record[1:5], 'big') == number
    assert make_decode(layout, scope(server))(record) == cdr('std_msgs/msg/Header')


def test_a_schema_that_the_registry_refuses_is_a_mistake_of_the_configuration(
    server: RegistryServer,
) -> None:
    make_encode(NUMBER, scope(server))
    with pytest.raises(ConfigError, match='not compatible') as caught:
        make_encode(mine(('number', String())), scope(server))
    assert 'subject robots-value' in str(caught.value)


def test_a_registry_that_is_away_fails_the_route(server: RegistryServer) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    decode = make_decode(NUMBER, scope(server))
    server.stop()
    with pytest.raises(RouteError, match='does not answer'):
        make_encode(NUMBER, scope(server))
    with pytest.raises(RouteError, match='does not answer'):
        decode(record)
    server.start()
    assert decode(record) == SEVEN


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        (b'', 'at least 5'),
        (b'\x00\x00\x00', 'at least 5'),
        (b'\x08\x07\x00\x00\x00\x00', 'registry: false'),
        (b'\x00\x00\x00\x00\x63\x00\x08\x07', 'has no schema with the id 99'),
        (b'\x00\x00\x00\x00\x01', 'which message of its schema'),
        (b'\x00\x00\x00\x00\x01\x03', 'which message of its schema'),
        (b'\x00\x00\x00\x00\x01' + b'\xff' * 2_000_000, 'which message of its schema'),
        (b'\x00\x00\x00\x00\x01\x02\x02\x08\x07', r'schema 1: has no message \[1\]'),
        (b'\x00\x00\x00\x00\x01\x02\x01\x08\x07', r'schema 1: has no message \[-1\]'),
        (b'\x00\x00\x00\x00\x01\x00\x08', 'not a message in Protobuf'),
        (b'\x00\x00\x00\x00\x01\x00\x10\x07', r'\$: unknown field 2'),
    ],
)
def test_a_value_that_is_no_record_is_refused(
    server: RegistryServer, value: bytes, said: str
) -> None:
    make_encode(NUMBER, scope(server))
    with pytest.raises(DecodeError, match=said):
        make_decode(NUMBER, scope(server))(value)


@pytest.mark.parametrize('body', [b'{}', b'{"status": "maintenance"}'])
def test_an_answer_without_a_schema_says_nothing_about_its_records(
    server: RegistryServer, body: bytes
) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    decode = make_decode(NUMBER, scope(server))
    for _ in range(2):
        server.answer(200, 1, body)
        with pytest.raises(RouteError, match='something else than a registry does'):
            decode(record)
    assert decode(record) == SEVEN


def test_a_reference_without_a_schema_says_nothing_about_its_records(
    server: RegistryServer,
) -> None:
    layout = load_layout('std_msgs/msg/Header')
    record = make_encode(layout, scope(server))(cdr('std_msgs/msg/Header'))
    decode = make_decode(layout, scope(server))
    text = server.versions('robots-value')[0].shown
    server.answer(200, 1, json.dumps(text).encode())
    server.answer(200, 1, b'{}')
    with pytest.raises(RouteError, match='something else than a registry does'):
        decode(record)
    assert decode(record) == cdr('std_msgs/msg/Header')


def test_schemas_that_refer_to_others_without_end_are_an_error_of_the_record(
    server: RegistryServer,
) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    shown = server.versions('robots-value')[0].shown
    for level in range(1200):
        place = {'name': f'r{level}.proto', 'subject': 'r', 'version': level + 1}
        answer = shown | {'subject': 'r', 'version': level, 'id': 1, 'references': [place]}
        server.answer(200, 1, json.dumps(answer).encode())
    decode = make_decode(NUMBER, scope(server))
    for _ in range(2):
        with pytest.raises(DecodeError, match=r'^schema 1: refers to other schemas without end$'):
            decode(record)


def test_messages_that_a_schema_does_not_have_are_not_asked_for(server: RegistryServer) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    decode = make_decode(NUMBER, scope(server))
    server.requests.clear()
    for number in range(1, 50):
        with pytest.raises(DecodeError, match=rf'has no message \[{number}\]'):
            decode(record[:5] + bytes([2, 2 * number]) + record[6:])
    assert decode(record) == SEVEN
    assert len(server.requests) == 1


def test_the_message_of_a_schema_may_be_written_out(server: RegistryServer) -> None:
    record = make_encode(NUMBER, scope(server))(SEVEN)
    decode = make_decode(NUMBER, scope(server))
    assert decode(record[:5] + b'\x02\x00' + record[6:]) == SEVEN


def test_a_route_without_a_registry_says_what_to_write() -> None:
    for make in (make_encode, make_decode):
        with pytest.raises(ConfigError, match='schema_registry'):
            make(NUMBER, Scope('robots'))
