"""Avro with a Schema Registry: what is asked, what others read and write, other versions."""

import io
import json
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

import avro.io
import avro.schema
import pytest
from confluent_kafka.schema_registry import SchemaRegistryClient
from confluent_kafka.schema_registry.avro import AvroDeserializer, AvroSerializer
from confluent_kafka.serialization import MessageField, SerializationContext
from support.formats.avro import (
    ONE,
    ROBOT,
    STRING,
    WIDE,
    avro_bytes,
    cdr_from,
    changed,
    fields_of,
    framed,
    json_text,
    robot,
    scope_of,
)
from support.formats.messages import cdr, extremes, layout_of
from support.registry.server import RegistryServer, Request

from ros2_kafka_bridge.errors import ConfigError, DecodeError, RouteError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.message_types import type_names

TOPIC = SerializationContext('robots', MessageField.VALUE)
BY_TOPIC = {'subject.name.strategy.type': 'TOPIC'}


@pytest.fixture(scope='module')
def shared() -> Iterator[RegistryServer]:
    with RegistryServer() as one:
        yield one
        assert one.problems == []


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
