"""json: messages of every installed type, there and back, and bytes that are no message."""

import json
import random
from contextlib import suppress
from functools import lru_cache
from typing import Any, NoReturn

import pytest
from hypothesis import given
from support.formats.messages import FEW, big_endian, cuts, extremes, layout_of, message_values
from support.install.schemas import schema_problems

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats import Decode, Encode
from ros2_kafka_bridge.formats.json import make_decode, make_encode, schema
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import type_names

EVERY_TYPE = pytest.mark.parametrize('name', type_names())
DEFAULT = JsonSettings()
NULLS = JsonSettings(non_finite='null')
FOR_OTHERS = JsonSettings(bytes='list', integers='string', missing='default', unknown='ignore')


@lru_cache
def both(name: str, settings: JsonSettings) -> tuple[Decode, Encode]:
    scope = Scope('topic', settings)
    return make_decode(layout_of(name), scope), make_encode(layout_of(name), scope)


def parsed(record: bytes | None) -> Any:
    """By the standard library, without its licence to read NaN."""
    assert record is not None
    return json.loads(record, parse_constant=no_constant)


def no_constant(word: str) -> NoReturn:
    raise AssertionError(f'{word} is no JSON')


@EVERY_TYPE
def test_a_message_of_any_type_comes_back_as_rclpy_serialized_it(name: str) -> None:
    decode, encode = both(name, DEFAULT)
    decode_others, encode_others = both(name, FOR_OTHERS)
    decode_null, encode_null = both(name, NULLS)
    for value in extremes(name):
        record = encode(value)
        assert decode(record) == value
        assert decode_others(encode_others(value)) == value
        assert encode(big_endian(value, name)) == record
        shown = encode_null(value)
        assert encode_null(decode_null(shown)) == shown
        assert decode_null(shown) == value or b'Infinity"' in (record or b'')

    @FEW
    @given(message_values(name))
    def comes_back(value: bytes) -> None:
        assert decode(encode(value)) == value

    comes_back()


@EVERY_TYPE
def test_a_record_of_any_type_is_what_the_schema_says(name: str) -> None:
    for settings in (DEFAULT, FOR_OTHERS):
        said = json.loads(schema(layout_of(name), settings))
        for value in extremes(name)[:3]:
            record = parsed(both(name, settings)[1](value))
            assert schema_problems(said, record) == []
            assert list(record) == [field.name for field in layout_of(name).fields]


@EVERY_TYPE
def test_an_empty_object_of_any_type_is_missing_its_fields_or_is_the_default(name: str) -> None:
    decode, encode = both(name, FOR_OTHERS)
    value = decode(b'{}')
    assert decode(encode(value)) == value
    if layout_of(name).fields:
        with pytest.raises(DecodeError, match=r'^\$\.\w+: is missing$'):
            both(name, DEFAULT)[0](b'{}')


@EVERY_TYPE
def test_what_is_cut_short_anywhere_or_changed_is_refused_or_is_a_message(name: str) -> None:
    decode, encode = both(name, DEFAULT)
    value = extremes(name)[0]
    record = encode(value)
    assert record is not None
    for part in cuts(value, 1000):
        with pytest.raises(EncodeError):
            encode(part)
    for part in cuts(record, 100):
        with pytest.raises(DecodeError):
            decode(part)
    source = random.Random(name)  # noqa: S311 -- repeatable
    for _ in range(20):
        with suppress(EncodeError):
            other = encode(changed(value, source))
            assert encode(decode(other)) == other
        with suppress(DecodeError):
            message = decode(changed(record, source))
            assert decode(encode(message)) == message


def changed(value: bytes, source: random.Random) -> bytes:
    made = bytearray(value)
    for _ in range(source.randint(1, 3)):
        made[source.randrange(len(made))] = source.choice(b'\x00\x01\x7f\xff0-.,:e"[{}]n')
    return bytes(made)
