"""The Avro schema of a message type: one record per type, with its full name in ROS.

What Avro cannot say stands in properties of its own, which every reader passes over: `ros.type`,
`ros.type_hash`, `ros.constants`, `ros.bound`, `ros.length`. Every field has a default that Avro
can say, and that is not too long, so that a field that is added later breaks no reader.
"""

import math
from typing import Any, Final

from ros2_kafka_bridge.formats.values.structs import FLOATS, is_byte
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Kind,
    Layout,
    Primitive,
    Scalar,
    Sequence,
    String,
    dotted_name,
    ros_type,
)

FILLER: Final = 'structure_needs_at_least_one_member'
"""The one field of a message without fields, as ROS 2 itself lays it down.

Without it, such a value has no bytes: confluent's own readers refuse that, and an array of any
length would have none either.
"""

_NUMBERS: Final = {
    'bool': 'boolean',
    'byte': 'int',
    'float32': 'float',
    'float64': 'double',
    'int8': 'int',
    'int16': 'int',
    'int32': 'int',
    'int64': 'long',
    'uint8': 'int',
    'uint16': 'int',
    'uint32': 'long',
}
_SAME: Final = frozenset({'bool', 'float32', 'float64', 'int32', 'int64'})
# Fixed, because a reader takes minutes for a decimal of a million bytes. The 9th byte is the sign.
_UINT64_BYTES: Final = 9
_UINT64: Final = 'ros2.uint64'
_LONGEST_DEFAULT: Final = 4096


def avro_schema(layout: Layout) -> dict[str, Any]:
    """The schema of a message type, as JSON has it.

    A type that appears twice, and uint64, are defined where they come first, and stand by their
    full name from then on.
    """
    return _record(layout, set())


def _record(layout: Layout, defined: set[str]) -> dict[str, Any]:
    defined.add(layout.type_name)
    namespace, _, name = dotted_name(layout).rpartition('.')
    schema: dict[str, Any] = {'type': 'record', 'name': name, 'namespace': namespace}
    schema |= {'doc': layout.doc} if layout.doc else {}
    schema['ros.type'] = layout.type_name
    schema |= {'ros.type_hash': layout.type_hash} if layout.type_hash else {}
    if layout.constants:
        schema['ros.constants'] = [_constant(constant) for constant in layout.constants]
    schema['fields'] = [_field(field, defined) for field in layout.fields] or [_filler()]
    return schema


def _constant(constant: Constant) -> dict[str, Any]:
    shown: dict[str, Any] = {'name': constant.name, 'type': ros_type(constant.kind)}
    # What no number of JSON says; libraries of Java lose integers beyond 64 bits with a sign.
    is_number = _is_finite(constant.value) and not _is_wide(constant.value)
    shown['value'] = constant.value if is_number else str(constant.value)
    return shown | ({'doc': constant.doc} if constant.doc else {})


def _filler() -> dict[str, Any]:
    doc = 'The message has no fields; ROS 2 itself lays down one byte for it.'
    return {'name': FILLER, 'type': {'type': 'int', 'ros.type': 'uint8'}, 'default': 0, 'doc': doc}


def _field(field: Field, defined: set[str]) -> dict[str, Any]:
    shown = {'name': field.name, 'type': _type(field.kind, defined)}
    default = _default(field)
    if default is not None:
        shown['default'] = default
    return shown | ({'doc': field.doc} if field.doc else {})


def _type(kind: Kind, defined: set[str]) -> Any:
    match kind:
        case Primitive('uint64'):
            return _uint64(defined)
        case Primitive():
            narrow = {} if kind.name in _SAME else {'ros.type': kind.name}
            return {'type': _NUMBERS[kind.name], **narrow} if narrow else _NUMBERS[kind.name]
        case String():
            more = _bound(kind) | ({'ros.type': 'wstring'} if kind.wide else {})
            return {'type': 'string', **more} if more else 'string'
        case Array() | Sequence() if is_byte(kind.item):
            return {'type': 'bytes', 'ros.type': ros_type(kind.item), **_bound(kind)}
        case Array() | Sequence():
            return {'type': 'array', 'items': _type(kind.item, defined), **_bound(kind)}
        case Layout():
            known = kind.type_name in defined
            return dotted_name(kind) if known else _record(kind, defined)


def _uint64(defined: set[str]) -> Any:
    if _UINT64 in defined:
        return _UINT64
    defined.add(_UINT64)
    namespace, _, name = _UINT64.rpartition('.')
    return {
        'type': 'fixed',
        'name': name,
        'namespace': namespace,
        'size': _UINT64_BYTES,
        'logicalType': 'decimal',
        'precision': 20,
        'scale': 0,
        'ros.type': 'uint64',
    }


def _bound(kind: String | Array | Sequence) -> dict[str, int]:
    if isinstance(kind, Array):
        return {'ros.length': kind.length}
    return {} if kind.bound is None else {'ros.bound': kind.bound}


def _default(field: Field) -> Any:
    """The default of a field in Avro's spelling; None where Avro can say none."""
    kind, value = field.kind, field.default
    if isinstance(kind, Array) and kind.length > _LONGEST_DEFAULT:
        return None
    if value is None:
        return _zero(kind)
    if not isinstance(value, tuple):
        return _shown(value, kind)
    assert isinstance(kind, Array | Sequence)
    if is_byte(kind.item):
        return bytes(map(int, value)).decode('latin-1')
    shown = [_shown(one, kind.item) for one in value]
    return None if None in shown else shown


def _shown(value: Scalar, kind: Kind) -> Any:
    if kind == Primitive('uint64'):
        return int(value).to_bytes(_UINT64_BYTES, 'big').decode('latin-1')
    if isinstance(kind, Primitive) and kind.name in FLOATS:
        return float(value) if _is_finite(value) else None
    return value


def _is_finite(value: Scalar) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _is_wide(value: Scalar) -> bool:
    return isinstance(value, int) and value >= 2**63


def _zero(kind: Kind) -> Any:
    match kind:
        case Primitive('bool'):
            return False
        case Primitive():
            return _shown(0, kind)
        case String():
            return ''
        case Layout():
            # The fields of the record have defaults themselves, or it has none.
            return None if any(_default(field) is None for field in kind.fields) else {}
        case Array() | Sequence():
            length = kind.length if isinstance(kind, Array) else 0
            if is_byte(kind.item):
                return '\0' * length
            zero = _zero(kind.item) if length else None
            return None if length and zero is None else [zero] * length
