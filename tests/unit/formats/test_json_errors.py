"""json: what is refused, and with which words."""

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.formats.json import (
    FLOAT32,
    FLOAT64,
    ODOMETRY,
    STRING,
    from_json,
    refusal,
    scope,
    to_json,
)
from support.formats.messages import cdr

from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.formats.cdr import make_decode as make_cdr_decode
from ros2_kafka_bridge.formats.cdr import make_encode as make_cdr_encode
from ros2_kafka_bridge.formats.json import make_decode, make_encode
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive, Sequence, String


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
        ('{"data":"x"}', FLOAT64, '$.data: expected float, got str'),
        ('{"data":"1.5"}', FLOAT64, '$.data: expected float, got str'),
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
            '$.pose.pose.position.x: expected float, got str',
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
        with pytest.raises(ConfigError, match=r'^deep_msgs/msg/D50 is nested too deeply .* 18 '):
            make(nested(50), scope({}))


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


@pytest.mark.parametrize(
    'settings', [{}, {'non_finite': 'string'}, {'bytes': 'list'}, {'integers': 'string'}]
)
@pytest.mark.parametrize('value', ['"SECRET"', '["SECRET"]', '{"data":"SECRET"}', '"SECRET'])
@pytest.mark.parametrize(
    'kind', ['Bool', 'UInt8', 'UInt64', 'Float64', 'Float64MultiArray', 'UInt8MultiArray']
)
def test_an_error_says_nothing_of_what_a_text_holds(
    kind: str, value: str, settings: dict[str, Any]
) -> None:
    lenient = {'missing': 'default', 'unknown': 'ignore'}
    said = refusal(f'{{"data":{value}}}', f'std_msgs/msg/{kind}', **lenient, **settings)
    assert 'SECRET' not in said


def test_of_a_field_that_the_type_does_not_have_an_error_says_the_name_cut_short() -> None:
    said = refusal(f'{{"{"n" * 59}xyz":"SECRET"}}', FLOAT64, missing='default')
    assert said == f'$.{"n" * 59}x: unknown field'


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
