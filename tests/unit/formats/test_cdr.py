"""cdr: the value of a record is the message's own bytes, looked at and passed on."""

from typing import Any

import pytest
from rclpy.serialization import serialize_message
from support.formats.messages import new_message

from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats import FORMATS, Decode, Encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout

SCOPE = Scope('topic')
ODOMETRY = 'nav_msgs/msg/Odometry'


def message_of(name: str, /, **fields: Any) -> bytes:
    return bytes(serialize_message(new_message(name, **fields)))


def decode_of(name: str) -> Decode:
    return FORMATS['cdr'].make_decode(load_layout(name), SCOPE)


def encode_of(name: str) -> Encode:
    return FORMATS['cdr'].make_encode(load_layout(name), SCOPE)


def test_a_whole_message_passes_as_the_same_object() -> None:
    value = message_of(ODOMETRY, child_frame_id='base')
    assert decode_of(ODOMETRY)(value) is value
    assert encode_of(ODOMETRY)(value) is value


@pytest.mark.parametrize('padding', [b'\0', b'xy', b'\0\0\0'])
def test_padding_of_a_raw_take_is_cut_off(padding: bytes) -> None:
    value = message_of('std_msgs/msg/String', data='abc')
    assert encode_of('std_msgs/msg/String')(value + padding) == value
    assert decode_of('std_msgs/msg/String')(value + padding) == value


def test_padding_that_the_header_announces_belongs_to_the_message() -> None:
    body = message_of('std_msgs/msg/String', data='a')[4:]
    value = b'\0\1\0\2' + body + bytes(2)
    assert encode_of('std_msgs/msg/String')(value) is value
    assert encode_of('std_msgs/msg/String')(value + bytes(3)) == value
    with pytest.raises(EncodeError, match=r'padding: needs 2 bytes at 10, .* the value has 11'):
        encode_of('std_msgs/msg/String')(value[:-1])


@pytest.mark.parametrize('name', [ODOMETRY, 'std_msgs/msg/String', 'std_msgs/msg/UInt32'])
def test_more_than_padding_behind_a_message_is_refused(name: str) -> None:
    value = message_of(name) + bytes(4)
    with pytest.raises(DecodeError, match='4 bytes behind the last field, at'):
        decode_of(name)(value)
    with pytest.raises(EncodeError, match='4 bytes behind the last field, at'):
        encode_of(name)(value)


@pytest.mark.parametrize(
    ('name', 'fields'),
    [
        ('test_msgs/msg/WStrings', {'wstring_value': 'ж'}),
        ('sensor_msgs/msg/JointState', {'name': ['shoulder', 'elbow']}),
    ],
)
def test_what_rclpy_leaves_behind_a_message_is_cut_off(name: str, fields: Any) -> None:
    value = message_of(name, **fields)
    exact = decode_of(name)(value)
    assert value.startswith(exact)
    assert len(value) - len(exact) > 3
    with pytest.raises(DecodeError, match='bytes behind the last field'):
        decode_of(name)(exact + bytes(len(exact) + 1))


def test_a_tombstone_is_refused() -> None:
    with pytest.raises(DecodeError, match='the value is null'):
        decode_of(ODOMETRY)(None)


def test_garbage_is_refused() -> None:
    for garbage in (b'', b'garbage', b'{"data": "abc"}'):
        with pytest.raises(DecodeError, match='encapsulation header'):
            decode_of('std_msgs/msg/String')(garbage)
        with pytest.raises(EncodeError, match='encapsulation header'):
            encode_of('std_msgs/msg/String')(garbage)


@pytest.mark.parametrize(
    ('sent', 'expected'),
    [
        ('geometry_msgs/msg/Vector3', 'geometry_msgs/msg/Twist'),
        ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/Vector3'),
        ('geometry_msgs/msg/Twist', ODOMETRY),
        (ODOMETRY, 'geometry_msgs/msg/Twist'),
        ('std_msgs/msg/Float64', 'std_msgs/msg/Float32'),
        ('std_msgs/msg/Int32', 'std_msgs/msg/Int64'),
        ('sensor_msgs/msg/Image', 'sensor_msgs/msg/PointCloud2'),
        ('sensor_msgs/msg/JointState', 'std_msgs/msg/String'),
        ('std_msgs/msg/Empty', 'std_msgs/msg/String'),
    ],
)
def test_the_bytes_of_another_type_are_refused(sent: str, expected: str) -> None:
    with pytest.raises(DecodeError):
        decode_of(expected)(message_of(sent))


def test_an_error_of_encode_says_what_the_error_of_decode_says() -> None:
    value = message_of(ODOMETRY)[:100]
    with pytest.raises(DecodeError) as decoding:
        decode_of(ODOMETRY)(value)
    with pytest.raises(EncodeError) as encoding:
        encode_of(ODOMETRY)(value)
    assert str(encoding.value) == str(decoding.value)
    assert 'pose.covariance[2]: needs 8 bytes at 100, the value has 100' in str(decoding.value)
