"""text: std_msgs/msg/String <-> the bytes of its text."""

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.walk import make_end
from ros2_kafka_bridge.message_types import load_layout

SCOPE = Scope('topic')
LAYOUT = load_layout('std_msgs/msg/String')
DECODE = FORMATS['text'].make_decode(LAYOUT, SCOPE)
ENCODE = FORMATS['text'].make_encode(LAYOUT, SCOPE)
TEXTS = ['', 'a', 'ab', 'abc', 'abcd', 'héllo', '日本語', '😀' * 50, 'x' * 100_000]


def string(text: str) -> Any:
    return String(data=text)


@pytest.mark.parametrize('text', TEXTS)
def test_a_value_becomes_the_bytes_that_rclpy_writes(text: str) -> None:
    assert DECODE(text.encode()) == serialize_message(string(text))


@pytest.mark.parametrize('text', TEXTS)
@pytest.mark.parametrize('padding', [0, 1, 2, 3])
def test_a_message_becomes_its_text_without_padding(text: str, padding: int) -> None:
    assert ENCODE(serialize_message(string(text)) + bytes(padding)) == text.encode()
    assert ENCODE(serialize_message(string(text)) + b'x' * padding) == text.encode()


@pytest.mark.parametrize('text', TEXTS)
def test_a_message_of_the_other_byte_order_becomes_its_text(text: str) -> None:
    content = text.encode()
    message = b'\0\0\0\0' + struct.pack('>I', len(content) + 1) + content + b'\0'
    assert ENCODE(message) == content


@settings(max_examples=200)
@given(st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs'])))
def test_every_text_comes_back_as_it_was(text: str) -> None:
    message = DECODE(text.encode())
    assert deserialize_message(message, String).data == text
    assert ENCODE(message) == text.encode()


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_a_value_is_carried_unchanged_or_refused(value: bytes) -> None:
    try:
        message = DECODE(value)
    except DecodeError:
        assert 0 in value or value.decode(errors='replace').encode() != value
    else:
        assert ENCODE(message) == value


@settings(max_examples=500)
@given(
    st.sampled_from([b'\0\1\0\0', b'\0\0\0\0', b'']),
    st.integers(0, 20) | st.integers(0, 2**32 - 1),
    st.binary(max_size=20) | st.text('ab\0', max_size=12).map(str.encode),
)
def test_bytes_are_a_string_exactly_where_their_layout_says_so(
    head: bytes, length: int, body: bytes
) -> None:
    message = head + struct.pack('<I', length) + body
    try:
        end = make_end(LAYOUT)(message)
        valid = len(message) - end < 4
    except DecodeError:
        valid = False
    if valid:
        assert ENCODE(message) == message[8 : end - 1]
    else:
        with pytest.raises(EncodeError):
            ENCODE(message)


@pytest.mark.parametrize(
    ('value', 'words'),
    [
        (None, 'the value is null'),
        (b'ab\0cd', 'a NUL at byte 2'),
        (b'\0', 'a NUL at byte 0'),
        ('日本\0'.encode(), 'a NUL at byte 6'),
        (b'ab\xff', 'not UTF-8 at byte 2: 0xff'),
        ('é'.encode('latin-1'), 'not UTF-8 at byte 0: 0xe9'),
        ('日'.encode()[:2], 'not UTF-8 at byte 0'),
        (b'\xed\xa0\x80', 'not UTF-8 at byte 0: 0xed'),
    ],
)
def test_a_value_that_no_ros_string_can_hold_is_refused(value: bytes | None, words: str) -> None:
    with pytest.raises(DecodeError, match=words):
        DECODE(value)


@pytest.mark.parametrize(
    ('message', 'words'),
    [
        (b'', 'not the bytes of a String'),
        (b'\0\1\0\0\1\0\0\0', 'not the bytes of a String'),
        (b'\0\3\0\0\1\0\0\0\0', 'not the bytes of a String'),
        (b'\0\1\0\0\0\0\0\0\0', 'a length of 0 at 4'),
        (b'\0\1\0\0\3\0\0\0ab', 'a length of 3 at 4 and no NUL at 10, in 10 bytes'),
        (b'\0\1\0\0\2\0\0\0abc', 'a length of 2 at 4 and no NUL at 9, in 11 bytes'),
        (b'\0\1\0\0\xff\xff\xff\xffab\0', 'a length of 4294967295 at 4'),
        (b'\0\1\0\0\4\0\0\0a\0b\0', 'data: a NUL at byte 1'),
        (b'\0\1\0\0\3\0\0\0a\xff\0', 'data: not UTF-8 at byte 1: 0xff'),
        (b'\0\1\0\0\2\0\0\0a\0\0\0\0\0', '4 bytes behind the String, at 10'),
    ],
)
def test_a_message_that_is_no_string_is_refused(message: bytes, words: str) -> None:
    with pytest.raises(EncodeError, match=words):
        ENCODE(message)


def test_text_carries_strings_alone() -> None:
    assert FORMATS['text'].message_types == frozenset({'std_msgs/msg/String'})
    layout = load_layout('std_msgs/msg/Bool')
    for make in (FORMATS['text'].make_decode, FORMATS['text'].make_encode):
        with pytest.raises(ConfigError, match='text carries std_msgs/msg/String, not std_msgs'):
            make(layout, SCOPE)
