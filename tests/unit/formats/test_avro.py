"""Messages as Avro without a registry, and what stands in their way."""

import io
import math
import random
from decimal import Decimal
from typing import Any

import avro.io
import avro.schema
import fastavro
import pytest
from hypothesis import given
from support.formats.avro import LOCAL, ROBOT, WIDE, avro_bytes, cdr_from, fields_of, json_text
from support.formats.messages import (
    FEW,
    big_endian,
    cdr,
    cuts,
    extremes,
    layout_of,
    message_values,
)

from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.message_types import load_layout, type_names

STRING = load_layout('std_msgs/msg/String')
encode_robot = make_encode(ROBOT, LOCAL)
decode_robot = make_decode(ROBOT, LOCAL)


@pytest.mark.parametrize('name', type_names())
def test_every_type_comes_back_from_avro_as_the_same_bytes(name: str) -> None:
    encode, decode = make_encode(layout_of(name), LOCAL), make_decode(layout_of(name), LOCAL)
    for value in extremes(name):
        assert decode(encode(value)) == value

    @FEW
    @given(message_values(name))
    def same(value: bytes) -> None:
        assert decode(encode(value)) == value

    same()


def test_a_value_without_registry_is_plain_avro() -> None:
    assert make_encode(STRING, LOCAL)(cdr('std_msgs/msg/String', data='hi')) == b'\x04hi'
    assert make_decode(STRING, LOCAL)(b'\x04hi') == cdr('std_msgs/msg/String', data='hi')


def test_a_message_in_either_byte_order_is_the_same_value() -> None:
    name = 'nav_msgs/msg/Odometry'
    encode = make_encode(layout_of(name), LOCAL)
    for value in extremes(name):
        assert encode(big_endian(value, name)) == encode(value)


@pytest.mark.parametrize(
    'name', ['nav_msgs/msg/Odometry', 'sensor_msgs/msg/PointCloud2', 'test_msgs/msg/BasicTypes']
)
def test_the_library_of_apache_reads_what_is_written_here(name: str) -> None:
    schema = avro.schema.parse(json_text(avro_schema(load_layout(name))))
    ours = fastavro.parse_schema(avro_schema(load_layout(name)))
    encode = make_encode(layout_of(name), LOCAL)
    for value in extremes(name):
        written = encode(value)
        found = avro.io.DatumReader(schema).read(avro.io.BinaryDecoder(io.BytesIO(written)))
        expected = fastavro.schemaless_reader(io.BytesIO(written), ours, None)
        # NaN is not equal to itself, its text is.
        assert repr(found) == repr(expected)


@pytest.mark.parametrize('number', [0, 1, 2**63 - 1, 2**63, 2**64 - 1])
def test_a_uint64_is_exact(number: int) -> None:
    value = cdr_from(WIDE, {'a': Decimal(number), 'many': [Decimal(number)]})
    written = make_encode(WIDE, LOCAL)(value)
    assert make_decode(WIDE, LOCAL)(written) == value
    schema = avro.schema.parse(json_text(avro_schema(WIDE)))
    found: Any = avro.io.DatumReader(schema).read(avro.io.BinaryDecoder(io.BytesIO(written)))
    assert found == {'a': number, 'many': [number]}


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf])
def test_what_is_no_number_comes_back(number: float) -> None:
    value = cdr('std_msgs/msg/Float32', data=number)
    layout = layout_of('std_msgs/msg/Float32')
    assert make_decode(layout, LOCAL)(make_encode(layout, LOCAL)(value)) == value


def test_a_null_value_is_no_message() -> None:
    with pytest.raises(DecodeError, match=r'^the value is null \(a tombstone\), and avro has'):
        decode_robot(None)


def test_bytes_that_are_no_message_are_not_encoded() -> None:
    with pytest.raises(EncodeError, match='encapsulation header'):
        encode_robot(b'what')


@pytest.mark.parametrize('name', ['nav_msgs/msg/Odometry', 'test_msgs/msg/Nested'])
def test_a_value_that_is_cut_short_is_no_message(name: str) -> None:
    layout = layout_of(name)
    value = make_encode(layout, LOCAL)(extremes(name)[0])
    decode = make_decode(layout, LOCAL)
    for cut in cuts(value):
        with pytest.raises(DecodeError):
            decode(cut)


def test_bytes_behind_a_value_are_an_error() -> None:
    decode = make_decode(STRING, LOCAL)
    with pytest.raises(
        DecodeError, match=r'^1 byte behind the value of std_msgs.msg.String, at 3'
    ):
        decode(b'\x04hi!')


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        (b'', 'not a value of std_msgs.msg.String: it ends in the middle of a field'),
        (b'\x04h', 'it ends in the middle of a field, or has a length that it cannot have'),
        (b'\x03hi', 'or has a length that it cannot have'),
        (b'\x80\x80\x80\x80\x80\x80\x01hi', 'or has a length that it cannot have'),
        (b'\xff' * 40, 'or has a length that it cannot have'),
        (b'\x04\xff\xff', 'a text is not UTF-8'),
        (b'\x04a\x00', r'^\$\.data: expected text, got a NUL at character 1'),
    ],
)
def test_a_value_that_is_no_text_says_so(value: bytes, said: str) -> None:
    with pytest.raises(DecodeError, match=said):
        make_decode(STRING, LOCAL)(value)


@pytest.mark.parametrize(
    ('fields', 'said'),
    [
        ({'level': 300}, r'^\$\.level: expected `?int`? <= 255'),
        ({'level': -1}, r'^\$\.level: expected `?int`? >= 0'),
        ({'name': 'a long name'}, r'^\$\.name: expected .*8'),
        ({'name': 'äöüßé'}, r'^\$\.name: expected at most 8 bytes of UTF-8, got 10'),
        ({'corners': [1.0]}, r'^\$\.corners: expected .*2'),
        ({'photo': b'12345'}, r'^\$\.photo: expected .*4'),
        ({'tags': ['a', 'b', 'c', 'd']}, r'^\$\.tags: expected .*3'),
        (
            {'stops': [{'x': 0.0, 'mark': 'ok'}, {'x': 0.0, 'mark': 'a\0'}]},
            r'^\$\.stops\[1\]\.mark: ',
        ),
    ],
)
def test_what_a_message_cannot_hold_is_told_with_its_path(
    fields: dict[str, Any], said: str
) -> None:
    found = fields_of(cdr_from(ROBOT, {}), ROBOT) | fields
    with pytest.raises(DecodeError, match=said):
        decode_robot(avro_bytes(avro_schema(ROBOT), found))


@pytest.mark.parametrize(
    'name', ['std_msgs/msg/String', 'nav_msgs/msg/Odometry', 'test_msgs/msg/UnboundedSequences']
)
def test_random_bytes_are_a_message_or_a_decode_error(name: str) -> None:
    decode = make_decode(layout_of(name), LOCAL)
    chance = random.Random(4)  # noqa: S311 -- repeatable
    good = make_encode(layout_of(name), LOCAL)(extremes(name)[0])
    for _ in range(300):
        damaged = bytearray(good)
        damaged[chance.randrange(len(good))] = chance.randrange(256)
        for value in (bytes(damaged), chance.randbytes(chance.randrange(200))):
            try:
                assert decode(value)[:4] == b'\0\1\0\0'
            except DecodeError as error:
                assert str(error)  # noqa: PT017 -- both are right


def test_a_message_without_fields_comes_back() -> None:
    layout = layout_of('std_msgs/msg/Empty')
    value = cdr('std_msgs/msg/Empty')
    assert make_encode(layout, LOCAL)(value) == b'\0'
    assert make_decode(layout, LOCAL)(b'\0') == value
