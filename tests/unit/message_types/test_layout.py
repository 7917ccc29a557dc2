"""The layout of every installed message type, held against rclpy's own serialization."""

import contextlib
import random
from collections.abc import Callable
from functools import lru_cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from support.formats.messages import Writer, layout_of, new_message, random_message

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.walk import make_end, make_reader
from ros2_kafka_bridge.message_types import type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
    has_slack,
)

SCOPE = Scope('topic')
EVERY_TYPE = pytest.mark.parametrize('name', type_names())
SAMPLE = [
    'diagnostic_msgs/msg/DiagnosticArray',
    'nav_msgs/msg/Odometry',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/PointCloud2',
    'test_msgs/msg/Arrays',
    'test_msgs/msg/BoundedSequences',
    'test_msgs/msg/MultiNested',
    'test_msgs/msg/UnboundedSequences',
    'test_msgs/msg/WStrings',
    'visualization_msgs/msg/MarkerArray',
]


@lru_cache
def end_of(name: str) -> Callable[[bytes], int]:
    return make_end(layout_of(name))


def mutations(value: bytes, source: random.Random, times: int) -> list[bytes]:
    found = []
    for _ in range(times):
        changed = bytearray(value)
        for _ in range(source.randint(1, 3)):
            changed[source.randrange(len(changed))] = source.choice([0, 1, 2, 127, 128, 255])
        found.append(bytes(changed))
    return found


def cuts(value: bytes) -> list[int]:
    step = max(1, len(value) // 200)
    return sorted({*range(0, len(value), step), *range(max(0, len(value) - 20), len(value))})


@EVERY_TYPE
def test_a_message_of_any_type_ends_where_rclpy_ends_it(name: str) -> None:
    for seed in range(4):
        message = random_message(name, seed)
        value = serialize_message(message)
        end = len(Writer('<').value_of(message, layout_of(name)))
        assert end_of(name)(value) == end
        behind = len(value) - end
        assert behind <= 3 or (has_slack(layout_of(name)) and behind <= end)


@EVERY_TYPE
@pytest.mark.parametrize('order', ['<', '>'])
def test_a_message_of_any_type_is_read_in_both_byte_orders(name: str, order: str) -> None:
    for seed in range(2):
        message = random_message(name, seed)
        value = Writer(order).value_of(message, layout_of(name))
        assert end_of(name)(value) == len(value)
        assert deserialize_message(value, type(message)) == message


@EVERY_TYPE
def test_a_message_of_any_type_cut_short_anywhere_is_refused(name: str) -> None:
    value = Writer('<').value_of(random_message(name, 5), layout_of(name))
    for size in cuts(value):
        with pytest.raises(DecodeError):
            end_of(name)(value[:size])


@EVERY_TYPE
def test_bytes_of_any_kind_are_refused_with_a_decode_error_or_accepted(name: str) -> None:
    source = random.Random(name)  # noqa: S311 -- repeatable
    value = serialize_message(random_message(name, 7))
    noise = [b'\0\1\0\0' + source.randbytes(size) for size in range(0, 200, 9)]
    refused = 0
    for changed in mutations(value, source, 60) + noise:
        try:
            assert end_of(name)(changed) <= len(changed)
        except DecodeError:
            refused += 1
    assert refused


@pytest.mark.parametrize('name', SAMPLE)
def test_what_is_accepted_is_accepted_by_rclpy_too(name: str) -> None:
    decode = FORMATS['cdr'].make_decode(layout_of(name), SCOPE)
    source = random.Random(name)  # noqa: S311 -- repeatable
    accepted = 0
    for seed in range(20):
        message = random_message(name, seed)
        for changed in mutations(serialize_message(message), source, 20):
            try:
                value = decode(changed)
            except DecodeError:
                continue
            deserialize_message(value, type(message))
            accepted += 1
    assert accepted


@pytest.mark.parametrize('name', SAMPLE)
@settings(max_examples=60)
@given(body=st.binary(max_size=200), head=st.sampled_from([b'\0\1\0\0', b'\0\0\0\0', b'']))
def test_no_bytes_break_a_validator(name: str, head: bytes, body: bytes) -> None:
    with contextlib.suppress(DecodeError):
        assert end_of(name)(head + body) <= len(head + body)


@pytest.mark.parametrize('name', SAMPLE)
def test_a_huge_declared_length_is_refused_at_once(name: str) -> None:
    value, end = serialize_message(random_message(name, 3)), end_of(name)
    # Walking two thousand million items would take minutes, more than a test may.
    for at in range(4, len(value) - 4, 4):
        for length in (0x7FFFFFFF, 0xFFFFFFFF):
            changed = value[:at] + length.to_bytes(4, 'little') + value[at + 4 :]
            with contextlib.suppress(DecodeError):
                assert end(changed) <= len(changed)


def test_many_items_without_bytes_are_refused_before_they_are_walked() -> None:
    layout = Layout('t/msg/T', (Field('items', Sequence(Layout('t/msg/Empty', ()))),))
    value = b'\0\1\0\0' + (2**32 - 1).to_bytes(4, 'little') + bytes(10)
    with pytest.raises(DecodeError, match='items: needs 4294967295 items at 8, the value has 10'):
        make_end(layout)(value)


ODOMETRY = serialize_message(random_message('nav_msgs/msg/Odometry', 1))


@pytest.mark.parametrize(
    ('header', 'accepted'),
    [
        ('00 01 00 00', True),
        ('00 01 00 03', True),
        ('00 03 00 00', False),
        ('00 07 00 00', False),
        ('01 01 00 00', False),
        ('7b 22 61 22', False),
    ],
)
def test_only_the_headers_of_plain_cdr_are_accepted(header: str, accepted: bool) -> None:  # noqa: FBT001
    value = bytes.fromhex(header) + ODOMETRY[4:]
    if accepted:
        assert end_of('nav_msgs/msg/Odometry')(value) == len(value)
    else:
        with pytest.raises(DecodeError, match=rf'encapsulation header: .* found {header}'):
            end_of('nav_msgs/msg/Odometry')(value)


def test_an_empty_value_is_refused() -> None:
    with pytest.raises(DecodeError, match=r'encapsulation header: .* found nothing'):
        end_of('std_msgs/msg/String')(b'')


STRING = (Field('data', String()),)


def refusal(fields: tuple[Field, ...], body: bytes) -> str:
    with pytest.raises(DecodeError) as caught:
        make_end(Layout('t/msg/T', fields))(b'\0\1\0\0' + body)
    return str(caught.value)


@pytest.mark.parametrize(
    ('fields', 'body', 'words'),
    [
        (STRING, b'', 'data: needs 4 bytes at 4, the value has 4'),
        (STRING, b'\5\0\0\0ab\0', 'data: needs 5 bytes at 8, the value has 11'),
        (STRING, b'\0\0\0\0', 'data: needs a length of at least 1 at 4, found 0'),
        (STRING, b'\2\0\0\0ab', 'data: needs a NUL at 9, found 0x62'),
        (STRING, b'\4\0\0\0a\0b\0', 'data: has a NUL inside, at 9'),
        (STRING, b'\3\0\0\0a\xff\0', 'data: is not UTF-8 at 9: 0xff'),
        (
            (Field('short', String(2)),),
            b'\4\0\0\0abc\0',
            'short: at most 2 bytes, found 3 at 4',
        ),
        (
            (Field('wide', String(1, wide=True)),),
            b'\2\0\0\0a\0\0\0b\0\0\0',
            'wide: at most 1 units, found 2 at 4',
        ),
        (
            (Field('wide', String(wide=True)),),
            b'\1\0\0\0\0\xd8\0\0',
            'wide: is not UTF-16 in units of 4 bytes at 8',
        ),
        (
            (Field('wide', String(wide=True)),),
            b'\1\0\0\0\0\0\1\0',
            'wide: has a unit of more than 16 bits behind 8',
        ),
        (
            (Field('wide', String(wide=True)),),
            b'\2\0\0\0a\0\0\0',
            'wide: needs 8 bytes at 8, the value has 12',
        ),
        (
            (Field('on', Primitive('bool')),),
            b'\2',
            'on: needs a bool (0 or 1) at 4, found 2',
        ),
        (
            (Field('on', Sequence(Primitive('bool'))),),
            b'\3\0\0\0\0\1\7',
            'on: needs a bool (0 or 1) at 10, found 7',
        ),
        (
            (Field('on', Array(Primitive('bool'), 2)),),
            b'\0\xff',
            'on: needs a bool (0 or 1) at 5, found 255',
        ),
        (
            (Field('few', Sequence(Primitive('int8'), 1)),),
            b'\2\0\0\0ab',
            'few: at most 1 items, found 2 at 4',
        ),
        (
            (Field('a', Array(Primitive('float64'), 36)),),
            bytes(30),
            'a[3]: needs 8 bytes at 28, the value has 34',
        ),
        (
            (Field('a', Sequence(Primitive('float64'))),),
            b'\2\0\0\0' + bytes(4) + bytes(8),
            'a[1]: needs 8 bytes at 20, the value has 20',
        ),
        (
            (Field('t', Sequence(Layout('t/msg/U', STRING))),),
            b'\2\0\0\0' + b'\1\0\0\0\0' + bytes(3) + b'\2\0\0\0x\1',
            't[1].data: needs a NUL at 21, found 0x01',
        ),
    ],
)
def test_a_refusal_says_where_and_what(fields: tuple[Field, ...], body: bytes, words: str) -> None:
    assert refusal(fields, body) == words


def test_a_refusal_names_the_field_inside_nested_messages() -> None:
    cloud = random_message('geometry_msgs/msg/PolygonStamped', 1)
    cloud.header.frame_id = 'map'
    cloud.polygon.points = [new_message('geometry_msgs/msg/Point32') for _ in range(3)]
    value = serialize_message(cloud)
    with pytest.raises(DecodeError, match=r'^polygon.points\[2\].y: needs 4 bytes at 52'):
        end_of('geometry_msgs/msg/PolygonStamped')(value[:-8])


def test_a_large_array_in_a_sequence_is_walked() -> None:
    tile = Layout('t/msg/Tile', (Field('pixels', Array(Primitive('uint16'), 500_000)),))
    layout = Layout('t/msg/T', (Field('tiles', Sequence(tile)),))
    value = b'\0\1\0\0\2\0\0\0' + bytes(2_000_000)
    assert make_end(layout)(value) == len(value)
    with pytest.raises(DecodeError, match='tiles: needs 2 items at 8, the value has 1999999'):
        make_end(layout)(value[:-1])


def test_names_of_fields_never_become_source() -> None:
    evil = 'x"); raise SystemExit  # \n'
    layout = Layout('t/msg/T', (Field(evil, String()), Field('y', Primitive('int8'))))
    assert make_end(layout)(b'\0\1\0\0\1\0\0\0\0\5') == 10
    assert make_reader(layout, 'y')(b'\0\1\0\0\1\0\0\0\0\5') == 5
