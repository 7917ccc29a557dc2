"""json: how each kind of value appears, what each setting changes, and what each error says."""

import json
import math
from typing import Any

import pytest
from support.formats.json import (
    FLOAT32,
    FLOAT64,
    ODD_NAMES,
    ODOMETRY,
    STRING,
    from_json,
    refusal,
    scope,
    to_json,
)
from support.formats.messages import big_endian, cdr, layout_of, new_message

from ros2_kafka_bridge.errors import EncodeError
from ros2_kafka_bridge.formats.json import make_decode, make_encode, schema
from ros2_kafka_bridge.message_types.layout import Array, Field, Layout, Primitive

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
