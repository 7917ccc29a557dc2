"""What a route is given that is of another format, or in an envelope: no message by chance."""

import contextlib
import json
import math
import tracemalloc
from typing import Any, Final

import pytest
from support.formats.json import STRING, from_json, refusal, scope
from support.formats.messages import cdr, layout_of
from support.registry.server import RegistryServer

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.json import make_decode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import type_names
from ros2_kafka_bridge.message_types.layout import Field, Kind, Layout, Primitive, Sequence, String

LENIENT: Final[dict[str, Any]] = {'missing': 'default', 'unknown': 'ignore'}
SETTINGS: Final[tuple[dict[str, Any], ...]] = ({}, {'unknown': 'ignore'}, LENIENT)

# As Kafka Connect 4.3's JsonConverter writes them, with its default schemas.enable=true.
STRUCT: Final = (
    '{"schema":{"type":"struct","fields":[{"type":"string","optional":false,"field":"data"}],'
    '"optional":true,"name":"std_msgs.String"},"payload":{"data":"hello"}}'
)
SCHEMALESS: Final = '{"schema":null,"payload":{"data":"hello"}}'
MAP: Final = (
    '{"schema":{"type":"map","keys":{"type":"string","optional":false},"values":'
    '{"type":"string","optional":false},"optional":false},"payload":{"data":"hello"}}'
)
TEXT: Final = '{"schema":{"type":"string","optional":false},"payload":"{\\"data\\":\\"hello\\"}"}'
TOMBSTONE: Final = (
    '{"schema":{"type":"struct","fields":[{"type":"string","optional":false,"field":"data"}],'
    '"optional":true,"name":"std_msgs.String"},"payload":null}'
)
NESTED: Final = (
    '{"schema":{"type":"struct","fields":[{"type":"struct","fields":[{"type":"double","optional"'
    ':false,"field":"x"},{"type":"double","optional":false,"field":"y"}],"optional":false,'
    '"field":"payload"}],"optional":false,"name":"n","version":1,"doc":"d"},"payload":'
    '{"payload":{"x":1.0,"y":"NaN"}}}'
)
CURE: Final = ': set value.converter.schemas.enable=false for the connector that writes it'
IN_ENVELOPE: Final = f"in Kafka Connect's envelope{CURE}, or for its worker"


def type_of(**kinds: Kind) -> Layout:
    return Layout('odd_msgs/msg/Odd', tuple(Field(name, kind) for name, kind in kinds.items()))


def said_of(record: str | bytes, layout: Layout, **settings: Any) -> str:
    value = record.encode() if isinstance(record, str) else record
    with pytest.raises(DecodeError) as refused:
        make_decode(layout, scope(settings))(value)
    return str(refused.value)


@pytest.mark.parametrize('settings', SETTINGS)
@pytest.mark.parametrize(
    'record',
    [
        STRUCT,
        SCHEMALESS,
        MAP,
        json.dumps(json.loads(STRUCT), indent=2),
        json.dumps(dict(reversed(json.loads(STRUCT).items()))),
        '{"payload":{"data":"old"},' + STRUCT[1:],
        '{"schema":{"type":"int32","optional":false},"payload":1}',
    ],
)
def test_kafka_connects_envelope_is_named_with_its_cure(
    record: str, settings: dict[str, Any]
) -> None:
    assert refusal(record, STRING, **settings) == IN_ENVELOPE


def test_an_envelope_around_null_or_a_text_has_words_of_its_own() -> None:
    assert f'envelope around null (a tombstone){CURE}' in refusal(TOMBSTONE, STRING, **LENIENT)
    said = refusal(TEXT, STRING)
    assert 'set value.converter=org.apache.kafka.connect.storage.StringConverter for' in said


@pytest.mark.parametrize('name', [STRING, 'nav_msgs/msg/Odometry', 'std_msgs/msg/Float64'])
def test_an_object_that_has_no_field_of_the_type_is_no_message(name: str) -> None:
    for record in ('{"before":null,"after":{"data":"x"},"op":"c"}', '{"Data":"x"}'):
        assert refusal(record, name, **LENIENT) == f'no field of it is one of {name}'


@pytest.mark.parametrize('name', type_names())
def test_no_type_takes_an_object_of_other_fields(name: str) -> None:
    """Whatever its defaults are: also lists of bytes, texts of numbers."""
    layout = layout_of(name)
    odd = {'bytes': 'list', 'integers': 'string', 'non_finite': 'null'}
    decode = make_decode(layout, scope(LENIENT | odd))
    assert decode(b'{}')
    if layout.fields:
        with pytest.raises(DecodeError, match=r'^no field of it is one of [^:]*$'):
            decode(b'{"z z":1}')


def test_of_an_object_without_a_field_of_the_type_the_reason_is_short() -> None:
    for record in (
        json.dumps({f'SECRET{number}': 'SECRET' for number in range(100)}),
        json.dumps({f'field{number}': 'SECRET' * 3 for number in range(30_000)}),
        STRUCT.replace('hello', 'SECRET' * 170_000),
    ):
        said = refusal(record, STRING, **LENIENT)
        assert len(said) < 300
        assert 'SECRET' not in said


def test_an_object_with_one_field_of_the_type_is_a_message_and_so_is_an_empty_one() -> None:
    for record in ('{}', ' {\n} ', '{"data":""}', '{"more":{"data":1},"d\\u0061ta":""}'):
        assert from_json(record, STRING, **LENIENT) == cdr(STRING)
    assert from_json('{"more":1,"data":0}', 'std_msgs/msg/Int32', **LENIENT) == (
        cdr('std_msgs/msg/Int32')
    )
    odd = type_of(first=Primitive('float64'), last=Primitive('bool'))
    odd = Layout(odd.type_name, (odd.fields[0]._replace(default=math.nan), odd.fields[1]))
    decode = make_decode(odd, scope(LENIENT))
    assert decode(b'{"last":false,"x":1}') == decode(b'{}')
    assert decode(b'{"last":true}')[-1] == 1
    assert said_of('{"x":1}', odd, **LENIENT).endswith('one of odd_msgs/msg/Odd')


def test_the_name_of_a_field_that_is_passed_over_is_text() -> None:
    assert refusal(b'{"\xff":1}', STRING, **LENIENT) == 'not UTF-8 at byte 2: 0xff'


def test_what_a_field_holds_does_not_tell_whether_another_ones_name_has_to_be_text() -> None:
    for text in ('', 'x'):
        record = b'{"data":"%s","\xff":1}' % text.encode()
        assert from_json(record, STRING, **LENIENT) == cdr(STRING, data=text)


@pytest.mark.parametrize('begin', ['', '"data":"",', '"data":1,', '"schema":null,"payload":1,'])
@pytest.mark.parametrize('settings', SETTINGS)
def test_to_look_at_many_names_takes_no_memory(begin: str, settings: dict[str, Any]) -> None:
    decode = make_decode(layout_of(STRING), scope(settings))
    value = f'{{{begin}{json.dumps(dict.fromkeys(map(str, range(100_000))))[1:]}'.encode()
    tracemalloc.start()
    with contextlib.suppress(DecodeError):
        decode(value)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2 * len(value)


@pytest.mark.parametrize('settings', SETTINGS)
@pytest.mark.parametrize('place', ['schema', 'payload'])
def test_an_envelope_that_is_nested_too_deeply_is_refused_at_any_depth(
    place: str, settings: dict[str, Any]
) -> None:
    """Each look into it stands at another depth of the interpreter itself."""
    around = {'schema': {'type': 'string', 'optional': True}, 'payload': {}}
    for name in (STRING, 'std_msgs/msg/Empty'):
        decode = make_decode(layout_of(name), scope(settings))
        for depth in range(800, 1010):
            deep = '{"a":' * depth + '1' + '}' * depth
            within = json.dumps({**around, place: {**around[place], 'z': 0}})
            with pytest.raises(DecodeError):
                decode(within.replace('"z": 0', f'"z":{deep}').encode())


def test_a_type_without_fields_takes_any_object() -> None:
    empty = 'std_msgs/msg/Empty'
    for settings in SETTINGS[1:]:
        assert from_json('{"run":1}', empty, **settings) == cdr(empty)
    assert refusal('{"run":1}', empty) == '$.run: unknown field'


@pytest.mark.parametrize('settings', SETTINGS)
def test_a_deletion_in_the_envelope_is_no_trigger(settings: dict[str, Any]) -> None:
    said = refusal(TOMBSTONE, 'std_msgs/msg/Empty', **settings)
    assert 'envelope around null (a tombstone)' in said


INNER: Final = Layout(
    'odd_msgs/msg/Inner', (Field('x', Primitive('float64')), Field('y', Primitive('float64')))
)


@pytest.mark.parametrize('settings', SETTINGS)
def test_an_envelope_around_a_type_with_a_field_payload_is_no_message(
    settings: dict[str, Any],
) -> None:
    layout = type_of(payload=INNER)
    assert said_of(NESTED, layout, **settings) == IN_ENVELOPE
    text = '{"schema":{"type":"string","optional":false},"payload":"hello"}'
    assert 'StringConverter' in said_of(text, type_of(payload=String()), **settings)


def test_a_type_with_fields_of_these_names_is_read_and_never_misnamed() -> None:
    both = type_of(schema=String(), payload=INNER)
    one = type_of(payload=INNER)
    text = type_of(payload=String())
    for layout, record, settings in (
        (both, '{"schema":"S","payload":{"x":1.0,"y":2.0}}', {}),
        (both, '{"schema":"S","payload":{"x":1.0,"y":2.0}}', LENIENT),
        (one, '{"payload":{"x":1.0,"y":2.0}}', {}),
        (one, '{"schema":null,"payload":{"x":1.0,"y":2.0}}', LENIENT),
        (one, '{"schema":{"type":"mine"},"payload":{"x":1.0,"y":2.0}}', LENIENT),
        (text, '{"schema":null,"payload":"x"}', LENIENT),
        (text, '{"schema":7,"payload":"x"}', {'unknown': 'ignore'}),
    ):
        assert make_decode(layout, scope(settings))(record.encode())
    for layout, record, said in (
        (both, '{"schema":{"type":"a","optional":true},"payload":{}}', '$.schema: expected str'),
        (text, '{"schema":null,"payload":"x"}', '$.schema: unknown field'),
        (type_of(schema=INNER), '{"schema":null,"payload":{}}', '$.schema: expected object'),
        (text, '{"schema":null,"payload":1}', '$.schema: unknown field'),
    ):
        assert said_of(record, layout).startswith(said)


JSON: Final = b'{"data":"hello"}'
FRAMED_JSON: Final = b'\0\0\0\x01\x2c' + JSON
FRAMED_AVRO: Final = b'\0\0\0\x01\x2c' + b'\x0ahello'
FRAMED_PROTOBUF: Final = b'\0\0\0\x01\x2c' + b'\0\x0a\x05hello'
ASKS_JSON: Final = '; is it JSON? (format: json)'
ASKS_CDR: Final = '; is it a message as ROS sends it? (format: cdr)'
ASKS_FRAMED: Final = "; is it JSON behind a Schema Registry's frame (schema 300)?"
ASKS_REGISTRY: Final = '; was it written with a Schema Registry, by schema 300?'


@pytest.mark.parametrize(
    ('reads', 'value', 'said'),
    [
        ('json', FRAMED_AVRO, f'{ASKS_REGISTRY} (format: avro or protobuf)'),
        ('json', FRAMED_PROTOBUF, f'{ASKS_REGISTRY} (format: avro or protobuf)'),
        ('json', cdr(STRING, data='hello'), ASKS_CDR),
        ('text', FRAMED_JSON, ASKS_FRAMED),
        ('text', FRAMED_AVRO, f'{ASKS_REGISTRY} (format: avro or protobuf)'),
        ('text', cdr(STRING, data='hello'), ASKS_CDR),
        ('text', b'{"a":"\xff"}', ': 0xff'),
        ('cdr', JSON, ASKS_JSON),
        ('cdr', FRAMED_JSON, ASKS_FRAMED),
        ('cdr', FRAMED_AVRO, f'{ASKS_REGISTRY} (format: avro or protobuf)'),
        ('cdr', cdr(STRING, data='hello')[:-1], 'the value has 13'),
        ('avro', STRUCT.encode(), ASKS_JSON),
        ('avro', FRAMED_JSON, ASKS_FRAMED),
        ('avro', FRAMED_AVRO, f'{ASKS_REGISTRY} (schema: {{registry: true}})'),
        ('avro', cdr(STRING, data='hello'), ASKS_CDR),
        ('avro', b'\x0ahell', 'a length that it cannot have'),
        ('protobuf', b' {\n "data": 1}', ASKS_JSON),
        ('protobuf', FRAMED_JSON, ASKS_FRAMED),
        ('protobuf', FRAMED_PROTOBUF, f'{ASKS_REGISTRY} (schema: {{registry: true}})'),
        ('protobuf', cdr(STRING, data='hello'), ASKS_CDR),
    ],
)
def test_a_reason_asks_for_the_format_that_the_value_looks_like(
    reads: str, value: bytes, said: str
) -> None:
    plain = Scope('topic', schema=SchemaSettings(registry=False))
    with pytest.raises(DecodeError) as refused:
        FORMATS[reads].make_decode(layout_of(STRING), plain)(value)
    assert str(refused.value).endswith(said)


@pytest.mark.parametrize('settings', SETTINGS)
def test_json_behind_a_registrys_frame_is_named_with_its_cure(settings: dict[str, Any]) -> None:
    said = refusal(FRAMED_JSON, STRING, **settings)
    assert said.startswith("JSON behind a Schema Registry's frame (schema 300): let the producer")
    assert 'value.converter=org.apache.kafka.connect.json.JsonConverter' in said
    assert refusal(b'\0\0\0\x80\xff{ "data":1}', STRING).startswith('JSON behind')
    assert refusal(b'\0\0\0\0\0\0{', STRING) == 'JSON is malformed: invalid character (byte 0)'


@pytest.mark.parametrize('reads', ['avro', 'protobuf'])
def test_a_route_with_a_registry_says_what_it_is_given_without_one(
    reads: str, server: RegistryServer
) -> None:
    route = Scope('topic', registry={'url': server.url})
    decode = FORMATS[reads].make_decode(layout_of(STRING), route)
    schema_id = server.register('topic-value', '{"type":"object"}', 'JSON')
    for value, said in (
        (JSON, f'has a zero byte before it{ASKS_JSON}'),
        (b'{}', f'has at least 5{ASKS_JSON}'),
        (cdr(STRING, data='hello'), f'has no schema with the id 16777222{ASKS_CDR}'),
        (b'\0' + schema_id.to_bytes(4, 'big') + JSON, 'JSON'),
    ):
        with pytest.raises(DecodeError) as refused:
            decode(value)
        assert said in str(refused.value)


@pytest.mark.parametrize('schema_id', [1, 2, 300, 301, 302, 303, 70_000, 100_001])
def test_doubles_of_avro_behind_the_id_of_a_schema_are_no_big_endian_message(
    schema_id: int,
) -> None:
    """One byte more than the message: it would drive a robot by garbage."""
    twist = 'geometry_msgs/msg/Twist'
    plain = Scope('topic', schema=SchemaSettings(registry=False))
    avro = FORMATS['avro'].make_encode(layout_of(twist), plain)(cdr(twist)) or b''
    value = b'\0' + schema_id.to_bytes(4, 'big') + avro
    decode = FORMATS['cdr'].make_decode(layout_of(twist), plain)
    with pytest.raises(DecodeError):
        decode(value)
    big_endian = bytes(4) + bytes(48)
    assert decode(big_endian) is big_endian


@pytest.mark.parametrize('slack', [4, 8])
def test_slack_behind_a_big_endian_message_may_end_anywhere(slack: int) -> None:
    """As rclpy's `serialize_message` leaves it behind an empty sequence of doubles."""
    layout = type_of(numbers=Sequence(Primitive('float64')), last=Primitive('bool'))
    decode = FORMATS['cdr'].make_decode(layout, Scope('topic'))
    message = bytes(8) + b'\1'
    assert decode(message + bytes(slack)) == message
    with pytest.raises(DecodeError):
        decode(message + b'\0')


@pytest.mark.parametrize('name', ['std_msgs/msg/Bool', STRING, 'geometry_msgs/msg/Twist'])
def test_a_message_without_its_padding_is_a_message_in_either_order_of_bytes(name: str) -> None:
    formats = FORMATS['cdr']
    decode = formats.make_decode(layout_of(name), Scope('topic'))
    encode = formats.make_encode(layout_of(name), Scope('topic'))
    little = cdr(name)
    zeros = bytes(4) + bytes(len(little) - 4)
    big = zeros if name != STRING else bytes(7) + b'\1\0'
    for message in (little, big):
        for padding in range(8):
            for said in range(4):
                value = message[:3] + bytes([said]) + message[4:] + bytes(padding)
                with contextlib.suppress(DecodeError):
                    found = decode(value)
                    assert encode(found) == decode(found) == found
