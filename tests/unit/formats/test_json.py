"""json: how each kind of value appears, what each setting changes, and what each error says."""

import json
import math
from contextlib import suppress
from typing import Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import big_endian, cdr, layout_of, new_message

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.formats.cdr import make_decode as make_cdr_decode
from ros2_kafka_bridge.formats.cdr import make_encode as make_cdr_encode
from ros2_kafka_bridge.formats.json import make_decode, make_encode, schema
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import document
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)

STRING = 'std_msgs/msg/String'
FLOAT64 = 'std_msgs/msg/Float64'
FLOAT32 = 'std_msgs/msg/Float32'
ODOMETRY = 'nav_msgs/msg/Odometry'
ODD_NAMES = Layout(
    'odd_msgs/msg/Names',
    tuple(
        Field(name, Primitive('uint8'))
        for name in ('class', 'f1', 'f0', 'self', 'None', '__doc__', '__init__', 'value', 'at')
    ),
)


def to_json(value: bytes, name: str, **settings: Any) -> str:
    return make_encode(layout_of(name), scope(settings))(value).decode()


def from_json(record: str | bytes | None, name: str, **settings: Any) -> bytes:
    value = record.encode() if isinstance(record, str) else record
    return make_decode(layout_of(name), scope(settings))(value)


def scope(settings: dict[str, Any]) -> Scope:
    return Scope('topic', JsonSettings(**settings))


def refusal(record: str | bytes | None, name: str, **settings: Any) -> str:
    with pytest.raises(DecodeError) as refused:
        from_json(record, name, **settings)
    return str(refused.value)


# How values appear


@pytest.mark.parametrize(
    ('name', 'value', 'record'),
    [
        ('Bool', True, 'true'),
        ('Byte', b'\xff', '255'),
        ('Char', 255, '255'),
        ('Int8', -128, '-128'),
        ('UInt8', 255, '255'),
        ('Int16', -(2**15), '-32768'),
        ('UInt16', 2**16 - 1, '65535'),
        ('Int32', -(2**31), '-2147483648'),
        ('UInt32', 2**32 - 1, '4294967295'),
        ('Int64', -(2**63), '-9223372036854775808'),
        ('UInt64', 2**64 - 1, '18446744073709551615'),
        ('Float32', 0.1, '0.10000000149011612'),
        ('Float64', 0.1, '0.1'),
        ('Float64', -0.0, '-0.0'),
        ('Float64', 5e-324, '5e-324'),
        ('Float64', 2.0, '2.0'),
        ('Float64', math.nan, '"NaN"'),
        ('Float32', math.inf, '"Infinity"'),
        ('Float64', -math.inf, '"-Infinity"'),
        ('String', '', '""'),
        ('String', 'Grüße "日本" 🤖\n', '"Grüße \\"日本\\" 🤖\\n"'),
    ],
)
def test_every_primitive_appears_as_json_has_it(name: str, value: Any, record: str) -> None:
    name = f'std_msgs/msg/{name}'
    message = cdr(name, data=value)
    assert to_json(message, name) == f'{{"data":{record}}}'
    assert to_json(big_endian(message, name), name) == f'{{"data":{record}}}'
    assert from_json(f'{{"data":{record}}}', name) == message


def test_a_message_is_an_object_of_its_fields_in_their_order() -> None:
    name = 'geometry_msgs/msg/PointStamped'
    header = new_message('std_msgs/msg/Header', frame_id='map')
    header.stamp.sec, header.stamp.nanosec = -1, 999_999_999
    point = new_message('geometry_msgs/msg/Point', x=1.5, y=-2.0)
    record = (
        '{"header":{"stamp":{"sec":-1,"nanosec":999999999},"frame_id":"map"},'
        '"point":{"x":1.5,"y":-2.0,"z":0.0}}'
    )
    message = cdr(name, header=header, point=point)
    assert to_json(message, name) == record
    assert from_json(record, name) == message


def test_the_order_of_fields_in_a_record_does_not_matter() -> None:
    name = 'builtin_interfaces/msg/Duration'
    message = cdr(name, sec=-(2**31), nanosec=5)
    assert from_json(' {"nanosec": 5,\n "sec": -2147483648}\n', name) == message


def test_a_message_without_fields_is_an_empty_object() -> None:
    assert to_json(cdr('std_msgs/msg/Empty'), 'std_msgs/msg/Empty') == '{}'
    assert from_json('{}', 'std_msgs/msg/Empty') == cdr('std_msgs/msg/Empty')


def test_bytes_are_base64() -> None:
    name = 'sensor_msgs/msg/CompressedImage'
    message = cdr(name, format='png', data=b'\x89PNG\xff')
    assert json.loads(to_json(message, name))['data'] == 'iVBOR/8='
    assert from_json(to_json(message, name), name) == message


def test_bytes_of_a_fixed_array_are_base64_too() -> None:
    name = 'unique_identifier_msgs/msg/UUID'
    message = cdr(name, uuid=range(16))
    assert to_json(message, name) == '{"uuid":"AAECAwQFBgcICQoLDA0ODw=="}'
    assert from_json(to_json(message, name), name) == message


def test_wide_text_is_text() -> None:
    name = 'test_msgs/msg/WStrings'
    message = cdr(name, wstring_value='日本🤖')
    assert json.loads(to_json(message, name))['wstring_value'] == '日本🤖'
    assert from_json(to_json(message, name), name) == message
    ascii_only = json.dumps(json.loads(to_json(message, name)))
    assert from_json(ascii_only, name) == message


def test_numbers_of_an_array_may_be_nan() -> None:
    name = 'sensor_msgs/msg/LaserScan'
    message = cdr(name, ranges=[1.0, math.inf, math.nan, 2.0], intensities=[-math.inf])
    record = to_json(message, name)
    assert '"ranges":[1.0,"Infinity","NaN",2.0],"intensities":["-Infinity"]' in record
    assert from_json(record, name) == message


def test_a_whole_number_may_stand_for_a_float() -> None:
    assert from_json('{"data":3}', FLOAT64) == cdr(FLOAT64, data=3.0)
    assert from_json('{"data":1E+2}', FLOAT64) == cdr(FLOAT64, data=100.0)


def test_names_of_fields_may_be_words_of_python() -> None:
    record = (
        b'{"class":1,"f1":2,"f0":3,"self":4,"None":5,"__doc__":6,"__init__":7,"value":8,"at":9}'
    )
    message = b'\0\1\0\0' + bytes(range(1, 10))
    assert make_decode(ODD_NAMES, scope({}))(record) == message
    assert make_encode(ODD_NAMES, scope({}))(message) == record


# Settings


def test_missing_fields_get_the_defaults_of_the_definition() -> None:
    name = 'test_msgs/msg/Defaults'
    assert from_json('{}', name, missing='default') == cdr(name)
    changed = from_json('{"int8_value":7}', name, missing='default')
    assert changed == cdr(name, int8_value=7)


def test_missing_fields_without_a_default_are_zero_or_empty() -> None:
    record = '{"pose":{"pose":{"position":{"x":1.5}}}}'
    message = new_message(ODOMETRY)
    message.pose.pose.position.x = 1.5
    # rclpy gives the quaternion the default of its definition: w is 1.
    expected = cdr(ODOMETRY, pose=message.pose)
    assert from_json(record, ODOMETRY, missing='default') == expected


def test_a_missing_field_is_an_error_by_default() -> None:
    record = '{"pose":{"pose":{"position":{"x":1.5}}}}'
    assert refusal(record, ODOMETRY) == '$.pose.pose.position.y: is missing'
    assert refusal('{}', STRING) == '$.data: is missing'


def test_unknown_fields_can_be_ignored() -> None:
    record = '{"data":"a","more":{"deep":[1,{"x":null}]},"data2":1e999}'
    assert from_json(record, STRING, unknown='ignore') == cdr(STRING, data='a')
    assert refusal(record, STRING) == '$.more: unknown field'
    inner = '{"header":{"stamps":1}}'
    settings = {'missing': 'default'}
    assert refusal(inner, ODOMETRY, **settings) == '$.header.stamps: unknown field'
    assert from_json(inner, ODOMETRY, **settings, unknown='ignore') == cdr(ODOMETRY)


def test_bytes_can_be_a_list() -> None:
    name = 'sensor_msgs/msg/CompressedImage'
    message = cdr(name, data=b'\x00\xff\x7f')
    record = to_json(message, name, bytes='list')
    assert json.loads(record)['data'] == [0, 255, 127]
    assert from_json(record, name, bytes='list') == message
    assert refusal(record, name) == '$.data: expected bytes, got array'
    wrong = refusal(record.replace('255', '256'), name, bytes='list')
    assert wrong == '$.data[1]: expected int <= 255'


def test_nan_and_infinity_can_be_null() -> None:
    for number in (math.nan, math.inf, -math.inf):
        message = cdr(FLOAT32, data=number)
        assert to_json(message, FLOAT32, non_finite='null') == '{"data":null}'
    assert from_json('{"data":null}', FLOAT32, non_finite='null') == cdr(FLOAT32, data=math.nan)
    name = 'std_msgs/msg/Float64MultiArray'
    message = cdr(name, data=[1.0, math.nan])
    assert from_json(to_json(message, name, non_finite='null'), name, non_finite='null') == message


def test_nan_and_infinity_can_be_refused() -> None:
    name = 'sensor_msgs/msg/LaserScan'
    message = cdr(name, ranges=[1.0, math.inf])
    with pytest.raises(EncodeError) as refused:
        to_json(message, name, non_finite='error')
    assert str(refused.value) == '$.ranges[1]: expected a finite number, got inf'
    large = cdr(FLOAT64, data=1.7e308)
    assert from_json(to_json(large, FLOAT64, non_finite='error'), FLOAT64) == large
    many = cdr(name, ranges=[3e38] * 9)
    assert from_json(to_json(many, name, non_finite='error'), name) == many


def test_only_the_first_refusal_of_nan_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    encode = make_encode(layout_of(FLOAT64), scope({'non_finite': 'error'}))
    for number in (math.nan, math.inf, -math.inf):
        with pytest.raises(EncodeError, match=r'^\$\.data: expected a finite number, got'):
            encode(cdr(FLOAT64, data=number))
        # What compiles needs it.
        monkeypatch.delattr('ros2_kafka_bridge.formats.values.read._Reader', raising=False)


def test_a_default_that_is_not_finite_appears_like_any_other() -> None:
    layout = Layout(
        'odd_msgs/msg/Range',
        (
            Field('most', Primitive('float32'), default=math.inf),
            Field('both', Array(Primitive('float64'), 2), default=(math.nan, 1.5)),
        ),
    )
    loose = scope({'missing': 'default'})
    record = b'{"most":"Infinity","both":["NaN",1.5]}'
    message = make_decode(layout, loose)(b'{}')
    assert message == make_decode(layout, loose)(record)
    assert make_encode(layout, loose)(message) == record
    shown = json.loads(schema(layout, loose.json))['$defs']['odd_msgs_msg_Range']['properties']
    assert (shown['most']['default'], shown['both']['default']) == ('Infinity', ['NaN', 1.5])


def test_64_bit_integers_can_be_text() -> None:
    name = 'test_msgs/msg/BasicTypes'
    message = cdr(name, uint64_value=2**64 - 1, int64_value=-(2**63), uint32_value=7)
    record = to_json(message, name, integers='string')
    shown = json.loads(record)
    assert shown['uint64_value'] == '18446744073709551615'
    assert shown['int64_value'] == '-9223372036854775808'
    assert shown['uint32_value'] == 7
    assert from_json(record, name, integers='string') == message
    assert from_json(to_json(message, name), name, integers='string') == message


# Errors


@pytest.mark.parametrize(
    ('record', 'name', 'said'),
    [
        (None, STRING, 'the value is null (a tombstone), and json has no message for it'),
        (b'', STRING, 'the value is empty, and json needs an object'),
        (b' \n', STRING, 'the value is empty, and json needs an object'),
        (b'\xef\xbb\xbf{}', STRING, 'a byte order mark (EF BB BF) at byte 0: JSON has none'),
        (b'{"data":"\xff"}', STRING, 'not UTF-8 at byte 9: 0xff'),
        (b'{"\xff":""}', STRING, 'not UTF-8 at byte 2: 0xff'),
        ('{"data":"x"}'.encode('utf-16'), STRING, 'not UTF-8 at byte 0: 0xff'),
        ('{"data":"a"', STRING, 'JSON is malformed: it ends too soon (byte 11)'),
        ('{"data":"a"} x', STRING, 'JSON is malformed: trailing characters (byte 14)'),
        ('{"data":"a",}', STRING, 'JSON is malformed: trailing comma in object (byte 12)'),
        ("{'data':1}", STRING, 'JSON is malformed: object keys must be strings (byte 1)'),
        ('{"data":"\\ud800"}', STRING, 'JSON is malformed: half a surrogate pair (byte 9)'),
        (
            '{"data":"\\udc00"}',
            STRING,
            'JSON is malformed: invalid utf-16 surrogate pair (byte 15)',
        ),
        ('[]', STRING, '$: expected object, got array'),
        ('null', STRING, '$: expected object, got null'),
        ('{"data":1}', STRING, '$.data: expected str, got int'),
        ('{"data":null}', STRING, '$.data: expected str, got null'),
        ('{"data":"a\\u0000b"}', STRING, '$.data: expected text, got a NUL at character 1'),
        (
            '{"data":NaN}',
            FLOAT64,
            'JSON is malformed: invalid character (byte 8): JSON has no NaN, see non_finite',
        ),
        (
            '{"data":-Infinity}',
            FLOAT64,
            'JSON is malformed: invalid character (byte 9): JSON has no Infinity, see non_finite',
        ),
        ('{"data":"x"}', FLOAT64, "$.data: expected float, got str 'x'"),
        ('{"data":"1.5"}', FLOAT64, "$.data: expected float, got str '1.5'"),
        ('{"data":null}', FLOAT64, '$.data: expected float, got null'),
        ('{"data":true}', FLOAT64, '$.data: expected float, got bool'),
        ('{"data":1e999}', FLOAT64, '$.data: number out of range'),
        ('{"data":1e39}', FLOAT32, '$.data: expected float32, got 1e+39'),
        ('{"data":1}', 'std_msgs/msg/Bool', '$.data: expected bool, got int'),
        ('{"data":1.0}', 'std_msgs/msg/Int32', '$.data: expected int, got float'),
        ('{"data":true}', 'std_msgs/msg/Int32', '$.data: expected int, got bool'),
        ('{"data":256}', 'std_msgs/msg/UInt8', '$.data: expected int <= 255'),
        ('{"data":-1}', 'std_msgs/msg/UInt64', '$.data: expected int >= 0'),
        (
            '{"data":18446744073709551616}',
            'std_msgs/msg/UInt64',
            '$.data: expected uint64 (0 to 18446744073709551615), got 18446744073709551616',
        ),
        (
            '{"data":9223372036854775808}',
            'std_msgs/msg/Int64',
            '$.data: expected int <= 9223372036854775807',
        ),
        ('{"data":"AAAA"}', 'std_msgs/msg/UInt8MultiArray', '$.layout: is missing'),
        (
            '{"uuid":"A"}',
            'unique_identifier_msgs/msg/UUID',
            '$.uuid: invalid base64 encoded string',
        ),
        (
            '{"uuid":"AAA="}',
            'unique_identifier_msgs/msg/UUID',
            '$.uuid: expected bytes of length >= 16',
        ),
    ],
)
def test_a_record_that_is_no_message_is_refused_with_the_reason(
    record: str | bytes | None, name: str, said: str
) -> None:
    assert refusal(record, name) == said


@pytest.mark.parametrize(
    ('record', 'name', 'said'),
    [
        (
            '{"pose":{"pose":{"position":{"x":"far"}}}}',
            ODOMETRY,
            "$.pose.pose.position.x: expected float, got str 'far'",
        ),
        (
            '{"pose":{"pose":{"position":{"x":{}}}}}',
            ODOMETRY,
            '$.pose.pose.position.x: expected float, got object',
        ),
        (
            '{"poses":[{},{"pose":{"position":{"y":[]}}}]}',
            'nav_msgs/msg/Path',
            '$.poses[1].pose.position.y: expected float, got array',
        ),
        (
            '{"pose":{"covariance":[1,2]}}',
            ODOMETRY,
            '$.pose.covariance: expected array of length >= 36',
        ),
        (
            '{"bool_values":[true,true,true,true]}',
            'test_msgs/msg/BoundedSequences',
            '$.bool_values: expected array of length <= 3',
        ),
        (
            f'{{"bounded_string_value":"{"ä" * 12}"}}',
            'test_msgs/msg/Strings',
            '$.bounded_string_value: expected at most 22 bytes of UTF-8, got 24',
        ),
        (
            f'{{"bounded_string_value":"{"x" * 23}"}}',
            'test_msgs/msg/Strings',
            '$.bounded_string_value: expected str of length <= 22',
        ),
        (
            '{"name":["a","b\\u0000"]}',
            'sensor_msgs/msg/JointState',
            '$.name[1]: expected text, got a NUL at character 1',
        ),
    ],
)
def test_an_error_has_the_path_of_the_field(record: str, name: str, said: str) -> None:
    assert refusal(record, name, missing='default') == said


def test_text_that_is_no_integer_is_refused() -> None:
    name = 'std_msgs/msg/UInt64'
    for text in ('', '1.0', 'x', '0x1', '9' * 400, '5\\n', '5\\n5', '-'):
        said = refusal(f'{{"data":"{text}"}}', name, integers='string')
        assert said == '$.data: expected int or its digits as str'
    said = refusal('{"data":"-1"}', name, integers='string')
    assert said == '$.data: expected uint64 (0 to 18446744073709551615), got -1'


def test_a_type_nested_too_deeply_is_told_at_the_start() -> None:
    deepest = nested(18)
    for more in ({}, {'non_finite': 'null'}, {'non_finite': 'error'}):
        decode, encode = make_decode(deepest, scope(more)), make_encode(deepest, scope(more))
        record = b'{"inner":[' * 18 + b'{"x":1.5}' + b']}' * 18
        assert encode(decode(record)) == record
    for make in (make_decode, make_encode, make_cdr_decode, make_cdr_encode):
        with pytest.raises(ConfigError, match=r'^deep_msgs/msg/D22 is nested too deeply .* 18 '):
            make(nested(22), scope({}))


def nested(depth: int) -> Layout:
    """A type with so many lists of messages within one another."""
    inner = Layout('deep_msgs/msg/D0', (Field('x', Primitive('float64')),))
    for level in range(1, depth + 1):
        inner = Layout(f'deep_msgs/msg/D{level}', (Field('inner', Sequence(inner)),))
    return inner


@pytest.mark.parametrize('opening', ['[', '{"x":', '{"x":['])
def test_a_record_nested_without_end_is_refused(opening: str) -> None:
    refusal(opening * 100_000, STRING)
    said = refusal('{"x":' + opening * 100_000, STRING, unknown='ignore')
    assert said == 'nested too deeply'


def test_an_error_does_not_repeat_a_large_record() -> None:
    for record in (f'{{"data":"{"x" * 10_000}"}}', f'{{"{"x" * 10_000}":1}}'):
        assert len(refusal(record, FLOAT64)) < 200
    assert len(refusal(f'{{"data":{"9" * 4000}}}', 'std_msgs/msg/UInt64')) < 200


def test_a_name_that_looks_like_a_path_is_no_path() -> None:
    faked = 'z` - at `$.' + 'x ' * 10_000
    for opening, closing in (('{', '}'), ('{"header":{"stamp":{', '}}}')):
        said = refusal(f'{opening}"{faked}":1{closing}', ODOMETRY, missing='default')
        assert len(said) < 200
    assert said.startswith('$.header.stamp.z` - at `$.x x ')
    assert said.endswith(': unknown field')


@settings(max_examples=200)
@given(st.binary(max_size=100), st.sampled_from([STRING, ODOMETRY, 'test_msgs/msg/WStrings']))
def test_bytes_of_any_kind_are_refused_with_an_error_of_their_own(noise: bytes, name: str) -> None:
    with suppress(EncodeError):
        to_json(b'\0\1\0\0' + noise, name)
    for record in (noise, b'{' + noise, b'{"data":' + noise + b'}'):
        with suppress(DecodeError):
            from_json(record, name, missing='default', unknown='ignore')


def test_bytes_that_are_no_message_are_an_encode_error_with_the_field() -> None:
    with pytest.raises(EncodeError) as refused:
        to_json(cdr(ODOMETRY)[:100], ODOMETRY)
    assert str(refused.value) == ('pose.covariance[2]: needs 8 bytes at 100, the value has 100')
    with pytest.raises(EncodeError, match='encapsulation header'):
        to_json(b'', ODOMETRY)


def test_bounds_of_a_wide_text_count_units_of_utf_16() -> None:
    layout = Layout('odd_msgs/msg/Wide', (Field('text', String(bound=3, wide=True)),))
    decode, encode = make_decode(layout, scope({})), make_encode(layout, scope({}))
    assert encode(decode('{"text":"a🤖"}'.encode())) == '{"text":"a🤖"}'.encode()
    with pytest.raises(DecodeError) as refused:
        decode('{"text":"🤖🤖"}'.encode())
    assert str(refused.value) == '$.text: expected at most 3 units of UTF-16, got 4'


# The schema


def test_the_schema_is_json_schema_with_what_the_definition_says() -> None:
    layout = Layout(
        'odd_msgs/msg/Cell',
        (
            Field('level', Primitive('uint8'), default=7, doc='From 0 to 100.'),
            Field('ids', Sequence(Primitive('uint64'), bound=4)),
            Field('matrix', Array(Primitive('float32'), 2)),
            Field('at', Layout('odd_msgs/msg/Point', (Field('x', Primitive('float64')),))),
        ),
        doc='One cell.',
        type_hash='RIHS01_' + 64 * 'a',
    )
    said = json.loads(schema(layout, JsonSettings(missing='default')))
    cell = said['$defs']['odd_msgs_msg_Cell']
    assert said['$schema'] == 'https://json-schema.org/draft/2020-12/schema'
    assert said['$ref'] == '#/$defs/odd_msgs_msg_Cell'
    assert (cell['title'], cell['description']) == ('odd_msgs/msg/Cell', 'One cell.')
    assert cell['ros.type_hash'] == layout.type_hash
    assert cell['properties'] == {
        'level': {
            'type': 'integer',
            'minimum': 0,
            'maximum': 255,
            'description': 'From 0 to 100.',
            'default': 7,
        },
        'ids': {
            'type': 'array',
            'items': {'type': 'integer', 'minimum': 0, 'maximum': 2**64 - 1},
            'maxItems': 4,
            'default': [],
        },
        'matrix': {
            'type': 'array',
            'items': {
                'anyOf': [
                    {
                        'type': 'number',
                        'minimum': -3.4028234663852886e38,
                        'maximum': 3.4028234663852886e38,
                    },
                    {'enum': ['-Infinity', 'Infinity', 'NaN']},
                ]
            },
            'minItems': 2,
            'maxItems': 2,
            'default': [0.0, 0.0],
        },
        'at': {'$ref': '#/$defs/odd_msgs_msg_Point'},
    }


def test_the_schema_follows_the_settings() -> None:
    layout = layout_of('sensor_msgs/msg/CompressedImage')
    name = 'sensor_msgs_msg_CompressedImage'
    strict = json.loads(schema(layout, JsonSettings()))['$defs'][name]
    loose = JsonSettings(missing='default', unknown='ignore', bytes='list')
    lenient = json.loads(schema(layout, loose))['$defs'][name]
    assert strict['required'] == ['header', 'format', 'data']
    assert strict['additionalProperties'] is False
    assert strict['properties']['data'].items() >= {'contentEncoding': 'base64'}.items()
    assert lenient['required'] == []
    assert 'additionalProperties' not in lenient
    assert lenient['properties']['data']['items']['maximum'] == 255


@pytest.mark.parametrize('non_finite', ['string', 'null', 'error'])
def test_the_schema_is_json_where_constants_and_defaults_are_not_finite(
    non_finite: Literal['string', 'null', 'error'],
) -> None:
    kind = Primitive('float64')
    constants = (
        Constant('NONE', kind, math.nan),
        Constant('MOST', kind, math.inf),
        Constant('NAME', String(), 'nan'),
    )
    layout = Layout('demo_msgs/msg/One', (Field('v', kind, math.nan),), constants)
    text = schema(layout, JsonSettings(missing='default', non_finite=non_finite))
    assert 'NaN,' not in text.replace('"NaN",', '')
    found = json.loads(text)['$defs']['demo_msgs_msg_One']
    assert found['ros.constants'] == {'NONE': 'NaN', 'MOST': 'Infinity', 'NAME': 'nan'}
    default = {'string': 'NaN', 'null': None, 'error': 'no default'}
    assert found['properties']['v'].get('default', 'no default') == default[non_finite]


def test_the_schema_has_the_comments_and_constants_of_the_definition() -> None:
    layout = document(layout_of('sensor_msgs/msg/NavSatFix'))
    said = json.loads(schema(layout, JsonSettings()))['$defs']
    fix = said['sensor_msgs_msg_NavSatFix']
    status = said['sensor_msgs_msg_NavSatStatus']
    assert 'Latitude [degrees]' in fix['properties']['latitude']['description']
    assert fix['description'].startswith('Navigation Satellite fix')
    assert fix['ros.constants']['COVARIANCE_TYPE_KNOWN'] == 3
    assert status['ros.constants']['STATUS_NO_FIX'] == -1
    assert fix['ros.type_hash'] == layout.type_hash
    assert status['ros.type_hash'].startswith('RIHS01_')
