"""What a value looks like that its route's format has refused: by its first bytes alone."""

import re
from typing import Final

FRAME: Final = 5
"""The bytes before a value: a zero byte, and the id of its schema."""
LARGEST_ID: Final = 2**31 - 1
"""An int of Java: no registry gives a larger one, or finds it."""

_LIKELY_ID: Final = 10_000_000  # a registry counts from 1
_JSON: Final = re.compile(rb'[ \t\r\n]{0,64}\{[ \t\r\n]{0,64}["}]')
# As ROS 2 sends it: little endian, up to 3 bytes of padding.
_CDR: Final = re.compile(rb'\x00\x01\x00[\x00-\x03].', re.DOTALL)
_WITHOUT_REGISTRY: Final = (
    '; was it written without a Schema Registry? (schema: {registry: false})'
)


def framed_json(value: bytes) -> str | None:
    """Say that a JSON object stands behind the frame of a Schema Registry, and what to do."""
    schema_id = _framed_as(value)
    if schema_id is None or not _JSON.match(value, FRAME):
        return None
    return (
        f"JSON behind a Schema Registry's frame (schema {schema_id}): let the producer write "
        'plain JSON, as Kafka Connect does with value.converter='
        'org.apache.kafka.connect.json.JsonConverter and value.converter.schemas.enable=false'
    )


def unframed(value: bytes) -> str:
    """The end of a reason: why a value may have no id of a schema before it."""
    return another_format(value, 'registry') or _WITHOUT_REGISTRY


def cdr_as_id(schema_id: int) -> str:
    """The end of a reason: whether an id that no schema has was the header of CDR."""
    return another_format(b'\0' + schema_id.to_bytes(FRAME - 1, 'big'), 'registry')


def another_format(value: bytes, reads: str) -> str:
    """Ask, at the end of a reason, whether a refused value is of another format.

    Args:
        value: What was refused.
        reads: The format of the route.

    Returns:
        Text that begins with a semicolon; nothing where the first bytes tell nothing.
    """
    if reads != 'json' and _JSON.match(value):
        return '; is it JSON? (format: json)'
    if reads != 'cdr' and _CDR.match(value):
        return '; is it a message as ROS sends it? (format: cdr)'
    schema_id = _framed_as(value)
    if schema_id is None or schema_id > _LIKELY_ID:
        return ''
    if _JSON.match(value, FRAME):
        return f"; is it JSON behind a Schema Registry's frame (schema {schema_id})?"
    is_reader = reads in {'avro', 'protobuf'}
    cure = 'schema: {registry: true}' if is_reader else 'format: avro or protobuf'
    return f'; was it written with a Schema Registry, by schema {schema_id}? ({cure})'


def _framed_as(value: bytes) -> int | None:
    """The id of a schema that seems to stand before a value; None where none does."""
    if value[:1] != b'\0' or len(value) <= FRAME or _CDR.match(value):
        return None
    schema_id = int.from_bytes(value[1:FRAME], 'big')
    return schema_id if 0 < schema_id <= LARGEST_ID else None
