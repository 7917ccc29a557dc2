"""protobuf: messages of every installed type, there and back, and bytes that are no message."""

import random
import struct
import subprocess
import sys
import tracemalloc
from functools import lru_cache
from typing import Any

import pytest
from hypothesis import given
from support.formats.messages import (
    FEW,
    big_endian,
    cdr,
    cuts,
    extremes,
    layout_of,
    message_values,
)

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.formats import Decode, Encode
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.protobuf.schema import make_class
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)

EVERY_TYPE = pytest.mark.parametrize('name', type_names())
PLAIN = Scope('robots', schema=SchemaSettings(registry=False))


@lru_cache
def both(name: str) -> tuple[Decode, Encode]:
    return make_decode(layout_of(name), PLAIN), make_encode(layout_of(name), PLAIN)


def layout(*fields: tuple[str, Kind], name: str = 'robot/msg/Mine') -> Layout:
    return Layout(name, tuple(Field(*field) for field in fields))


def decoded(of: Layout, value: bytes) -> bytes:
    return make_decode(of, PLAIN)(value)


def refused(of: Layout, value: bytes) -> str:
    with pytest.raises(DecodeError) as caught:
        decoded(of, value)
    return str(caught.value)


def message(of: Layout, **fields: Any) -> bytes:
    """A record as a reader of the schema writes it."""
    written: bytes = make_class(of)(**fields).SerializeToString()
    return written


@EVERY_TYPE
def test_a_message_of_any_type_comes_back_as_rclpy_serialized_it(name: str) -> None:
    decode, encode = both(name)
    for value in extremes(name):
        assert decode(encode(value)) == value

    @FEW
    @given(message_values(name))
    def comes_back(value: bytes) -> None:
        assert decode(encode(value)) == value

    comes_back()


@EVERY_TYPE
def test_a_big_endian_message_of_any_type_makes_the_same_record(name: str) -> None:
    encode = both(name)[1]
    for value in extremes(name)[:1]:
        assert encode(big_endian(value, name)) == encode(value)


@EVERY_TYPE
def test_a_message_that_is_cut_short_is_refused(name: str) -> None:
    encode = both(name)[1]
    for cut in cuts(extremes(name)[0], 8):
        with pytest.raises(EncodeError):
            encode(cut)


@EVERY_TYPE
def test_bytes_that_are_no_record_never_do_more_than_to_be_refused(name: str) -> None:
    decode, encode = both(name)
    chance = random.Random(name)  # noqa: S311 -- repeatable
    record = encode(extremes(name)[0])
    assert record is not None
    values = [chance.randbytes(chance.randrange(60)) for _ in range(12)]
    values += list(cuts(record, 8))
    for _ in range(12):
        changed = bytearray(record or b'\x0a')
        changed[chance.randrange(len(changed))] = chance.randrange(256)
        values.append(bytes(changed))
    for value in values:
        try:
            message_bytes = decode(value)
        except DecodeError:
            continue
        assert encode(message_bytes) is not None


def test_a_null_value_is_refused() -> None:
    with pytest.raises(DecodeError, match='null'):
        make_decode(layout(), PLAIN)(None)


def test_what_a_record_does_not_have_is_zero() -> None:
    pose = layout_of('geometry_msgs/msg/PoseWithCovarianceStamped')
    # No default of ROS either: the other readers of the record do not know that w is 1.
    frame_id = b'\1\0\0\0' + bytes(4)
    assert decoded(pose, b'')[4:] == bytes(8) + frame_id + bytes(7 * 8 + 36 * 8)


def test_a_message_of_zeros_says_which_messages_are_in_it() -> None:
    twist = both('geometry_msgs/msg/Twist')[1](cdr('geometry_msgs/msg/Twist'))
    read = make_class(layout_of('geometry_msgs/msg/Twist')).FromString(twist or b'')
    assert read.HasField('linear')
    assert read.HasField('angular')


def test_a_message_without_scalars_is_there_too() -> None:
    empty = layout(name='robot/msg/Empty')
    of = layout(('empty', empty), ('lists', layout(('items', Sequence(empty)), name='a/msg/L')))
    cdr_bytes = b'\0\1\0\0' + bytes(4) + struct.pack('<I', 2) + bytes(2)
    record = make_encode(of, PLAIN)(cdr_bytes)
    read: Any = make_class(of).FromString(record)
    assert read.HasField('empty')
    assert read.HasField('lists')
    assert len(read.lists.items) == 2
    assert decoded(of, record) == cdr_bytes


@pytest.mark.parametrize(
    ('kind', 'value', 'said'),
    [
        (Primitive('int8'), 128, '$.it: expected int8 (-128 to 127), got 128'),
        (Primitive('int16'), -32769, '$.it: expected int16 (-32768 to 32767), got -32769'),
        (Primitive('uint8'), 256, '$.it: expected uint8 (0 to 255), got 256'),
        (Primitive('byte'), 256, '$.it: expected byte (0 to 255), got 256'),
        (Primitive('uint16'), 65536, '$.it: expected uint16 (0 to 65535), got 65536'),
        (Sequence(Primitive('int8')), [0, -129], '$.it[1]: expected int8 (-128 to 127), got -129'),
        (Sequence(Primitive('bool'), 2), [True] * 3, '$.it: expected at most 2 items, got 3'),
        (Sequence(Primitive('uint8'), 2), b'abc', '$.it: expected at most 2 items, got 3'),
        (Array(Primitive('float64'), 2), [0.5], '$.it: expected 2 items, got 1'),
        (Array(Primitive('uint8'), 2), b'abc', '$.it: expected 2 items, got 3'),
        (Array(String(), 2), ['a', 'b', 'c'], '$.it: expected 2 items, got 3'),
        (String(), 'a\0b', '$.it: expected text, got a NUL at character 1'),
        (String(2), 'aä', '$.it: expected at most 2 bytes of UTF-8, got 3'),
        (String(2, wide=True), 'abc', '$.it: expected at most 2 units of UTF-16, got 3'),
    ],
)
def test_what_the_message_type_cannot_hold_is_refused_with_its_path(
    kind: Kind, value: object, said: str
) -> None:
    of = layout(('it', kind))
    assert refused(of, message(of, it=value)) == said


def test_a_fault_in_a_list_of_messages_has_its_path() -> None:
    inner = layout(('level', Primitive('int8')), name='robot/msg/Inner')
    of = layout(('many', Sequence(layout(('one', inner), name='robot/msg/Middle'))))
    record = message(of, many=[{}, {'one': {'level': 300}}])
    assert refused(of, record) == '$.many[1].one.level: expected int8 (-128 to 127), got 300'


def test_a_field_that_the_type_does_not_have_is_refused_with_its_path() -> None:
    inner = layout(('level', Primitive('int8')), name='robot/msg/Inner')
    newer = layout(('level', Primitive('int8')), ('by', String()), name='robot/msg/Inner')
    record = message(layout(('many', Sequence(newer))), many=[{'level': 1}, {'by': 'me'}])
    said = refused(layout(('many', Sequence(inner))), record)
    assert said == '$.many[1]: unknown field 2'


def test_a_record_of_another_type_is_refused() -> None:
    text = layout_of('std_msgs/msg/String')
    assert refused(text, b'hello').startswith('not a message in Protobuf: ')
    assert refused(text, message(layout_of('builtin_interfaces/msg/Time'), sec=1)) == (
        '$: unknown field 1'
    )


def test_a_list_may_be_written_number_by_number() -> None:
    of = layout(('numbers', Sequence(Primitive('int32'))))
    assert decoded(of, b'\x08\x01\x08\x02') == decoded(of, message(of, numbers=[1, 2]))


def test_the_last_of_a_field_that_is_written_twice_counts_and_messages_are_merged() -> None:
    inner = layout(('a', Primitive('int32')), ('b', Primitive('int32')), name='robot/msg/Inner')
    of = layout(('it', inner))
    twice = message(of, it={'a': 1, 'b': 2}) + message(of, it={'b': 3})
    assert decoded(of, twice) == decoded(of, message(of, it={'a': 1, 'b': 3}))


def test_a_text_that_is_not_utf_8_is_refused() -> None:
    assert 'UTF-8' in refused(layout_of('std_msgs/msg/String'), b'\x0a\x01\xff')
    assert refused(layout_of('test_msgs/msg/WStrings'), b'\x0a\x03\xed\xa0\x80')


@pytest.mark.parametrize('value', [b'\x0b' * 100_000, b'\x0b' * 90 + b'\x0c' * 90, b'\x0c'])
def test_groups_are_refused_however_deep(value: bytes) -> None:
    assert refused(layout_of('nav_msgs/msg/Odometry'), value)


def test_empty_messages_take_little_memory() -> None:
    record = b'\x12\x00' * 20_000
    decode = both('nav_msgs/msg/Path')[0]
    tracemalloc.start()
    path = decode(record)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(path) > 20_000 * 70
    assert peak < 30 * len(path)


def test_what_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'google.protobuf', None)
    for make in (make_decode, make_encode):
        with pytest.raises(ConfigError, match=r' -m pip install .*\[protobuf\]'):
            make(layout(), PLAIN)


def test_a_route_of_another_format_does_not_load_the_library() -> None:
    command = (
        'import sys; import ros2_kafka_bridge.formats; print("google.protobuf" in sys.modules)'
    )
    said = subprocess.run([sys.executable, '-c', command], capture_output=True, check=True)
    assert said.stdout == b'False\n'
