"""Schemas that strangers have registered: what is read by them, and that none does any harm."""

import io
import json
import random
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, Final

import avro.io
import avro.schema
import pytest
from fastavro.utils import generate_one
from hypothesis import given, settings
from hypothesis import strategies as st
from support.formats.avro import STOP, avro_bytes, fields_of, framed, json_text
from support.formats.messages import extremes, layout_of

from benchmarks.fuzz_versions import (
    VERSIONS,
    make_check,
    read_changed_avro,
    read_changed_protobuf,
    registry_of,
)
from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.avro import make_to_cdr, read_by_id
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive, Sequence, String

TYPES: Final = ('nav_msgs/msg/Odometry', 'diagnostic_msgs/msg/DiagnosticArray')

# Every value of its Avro schema is one of its message.
MARK: Final = Layout(
    'demo_msgs/msg/Mark',
    (
        Field('label', String(), 'none'),
        Field('at', Primitive('float64'), 0.5),
        # Not 255: the library of Apache writes defaults beyond 127 as UTF-8.
        Field('raw', Sequence(Primitive('uint8')), (1, 127)),
        Field('stop', STOP),
    ),
)
ALL: Final = Layout(
    'demo_msgs/msg/All',
    (
        Field('flag', Primitive('bool'), default=True),
        Field('count', Primitive('int32'), 7),
        Field('total', Primitive('int64'), -7),
        Field('speed', Primitive('float32'), 0.25),
        Field('names', Sequence(String()), ('a', 'b')),
        Field('points', Sequence(Primitive('float64'))),
        Field('mark', MARK),
        Field('marks', Sequence(MARK)),
        Field('stops', Sequence(STOP)),
    ),
)
TO_CDR: Final = make_to_cdr(ALL, 1_000_000)
# Not long to double: the library of Apache gives the number as it was.
_NARROWER: Final = {'double': ('int', 'float'), 'long': ('int',)}
_OTHERS: Final[tuple[Any, ...]] = (
    'null', 'string', {'type': 'array', 'items': 'int'}, {'type': 'map', 'values': 'bytes'},
    ['null', 'double'], {'type': 'enum', 'name': 'other.Colour', 'symbols': ['RED', 'BLUE']},
)  # fmt: skip


def records_in(schema: Any) -> Iterator[dict[str, Any]]:
    """The records that are defined in a schema."""
    if isinstance(schema, dict):
        if 'fields' in schema:
            yield schema
        inner = [schema.get('items'), *(field['type'] for field in schema.get('fields', ()))]
        for one in inner:
            yield from records_in(one)


@st.composite
def older_versions(draw: Callable[[Any], Any]) -> dict[str, Any]:
    """Versions of ALL, each of whose values Avro's resolution reads as one of ALL."""
    schema: dict[str, Any] = json.loads(json.dumps(avro_schema(ALL)))
    for number, record in enumerate(list(records_in(schema))):
        for field in record['fields']:
            del field['default']
            kind = field['type']
            if isinstance(kind, str) and draw(st.booleans()):
                field['type'] = draw(st.sampled_from((kind, *_NARROWER.get(kind, ()))))
        # An array of items without bytes is refused.
        first, *rest = record['fields']
        kept = [first, *(one for one in rest if _defines(one) or draw(st.integers(0, 3)))]
        extra = draw(st.sampled_from((None, *_OTHERS)))
        if extra is not None and not (number and 'enum' in str(extra)):
            kept.append({'name': 'extra', 'type': extra})
        # A type is defined where it comes first.
        record['fields'] = sorted(draw(st.permutations(kept)), key=_defines, reverse=True)
    return schema


def _defines(field: dict[str, Any]) -> bool:
    return any(records_in(field['type']))


@given(older_versions(), st.integers(0, 2**32))
def test_another_version_is_read_as_the_library_of_apache_reads_it(
    schema: dict[str, Any], seed: int
) -> None:
    random.seed(seed)
    value = avro_bytes(schema, generate_one(schema))
    writer, reader = (avro.schema.parse(json.dumps(one)) for one in (schema, avro_schema(ALL)))
    decoder = avro.io.BinaryDecoder(io.BytesIO(value))
    expected = avro.io.DatumReader(writer, reader).read(decoder)
    read = read_by_id(ALL, registry_of('AVRO', {'changed': json_text(schema)}))
    assert fields_of(TO_CDR(read(framed(1, value))), ALL) == expected


@pytest.mark.parametrize('name', TYPES)
def test_what_is_not_changed_is_read(name: str) -> None:
    """Else the next test would see bad records alone."""
    layout, scope = layout_of(name), Scope('robots', schema=SchemaSettings(registry=False))
    for format_name, read_changed, behind_id in (
        ('avro', read_changed_avro, b''),
        ('protobuf', read_changed_protobuf, b'\0'),
    ):
        encode, read = FORMATS[format_name].make_encode(layout, scope), read_changed(layout)
        for message in extremes(name):
            assert read(b'', framed(1, behind_id + (encode(message) or b''))) == message


@cache
def check_of(format_name: str, name: str) -> tuple[Callable[[bytes], None], list[bytes]]:
    """What the fuzzer does with an input, and some records."""
    layout, scope = layout_of(name), Scope('robots', schema=SchemaSettings(registry=False))
    encode = FORMATS[VERSIONS[format_name]].make_encode(layout, scope)
    values = [encode(message) or b'' for message in extremes(name)]
    behind_id = b'\0' if format_name == 'protobuf_versions' else b''
    return make_check(format_name, layout), [behind_id + value for value in values]


@pytest.mark.parametrize('name', TYPES)
@pytest.mark.parametrize('format_name', VERSIONS)
@settings(max_examples=150)
@given(data=st.data())
def test_whatever_schema_a_stranger_registers_its_record_is_a_message_or_a_bad_record(
    format_name: str, name: str, data: st.DataObject
) -> None:
    """`make fuzz` looks for longer, led by what it reaches."""
    check, values = check_of(format_name, name)
    change = data.draw(st.binary(max_size=60))
    value = data.draw(st.sampled_from(values) | st.binary(max_size=100))
    check(bytes([len(change)]) + change + value)
