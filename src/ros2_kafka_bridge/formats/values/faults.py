"""Where a struct has what its message type cannot hold: looked for only once it has failed."""

import math
import struct
from collections.abc import Iterator
from typing import Any, Final

from ros2_kafka_bridge.formats.values.structs import FLOATS, Style
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
    limits_of,
)

_SHOWN: Final = 60


def first_fault(layout: Layout, message: Any, style: Style) -> str | None:
    """Tell the first fault, as `$.pose.x: expected ..., got ...`; None where there is none."""
    return next(_faults(layout, message, '$', style), None)


def _faults(kind: Kind, value: Any, path: str, style: Style) -> Iterator[str]:
    match kind:
        case Layout():
            for number, field in enumerate(kind.fields):
                inner = getattr(value, f'f{number}')
                yield from _faults(field.kind, inner, f'{path}.{field.name}', style)
        case Array() | Sequence():
            yield from _length_faults(kind, len(value), path)
            if not isinstance(value, bytes):
                for number, item in enumerate(value):
                    yield from _faults(kind.item, item, f'{path}[{number}]', style)
        case String():
            yield from _text_faults(kind, value, path)
        case Primitive() if kind.name in FLOATS:
            yield from _float_faults(kind, value, path, style)
        case Primitive() if kind.name != 'bool':
            least, most = limits_of(kind)
            if not least <= int(value) <= most:
                yield f'{path}: expected {kind.name} ({least} to {most}), got {value!s:.{_SHOWN}}'


def _length_faults(kind: Array | Sequence, found: int, path: str) -> Iterator[str]:
    if isinstance(kind, Array) and found != kind.length:
        yield f'{path}: expected {kind.length} items, got {found}'
    elif isinstance(kind, Sequence) and kind.bound is not None and found > kind.bound:
        yield f'{path}: expected at most {kind.bound} items, got {found}'


def _text_faults(kind: String, value: str, path: str) -> Iterator[str]:
    try:
        units = len(value.encode('utf-16-le')) // 2 if kind.wide else len(value.encode())
    except UnicodeEncodeError as error:
        yield f'{path}: expected text, got half a surrogate pair at character {error.start}'
        return
    if kind.bound is not None and units > kind.bound:
        unit = 'units of UTF-16' if kind.wide else 'bytes of UTF-8'
        yield f'{path}: expected at most {kind.bound} {unit}, got {units}'
    if not kind.wide and '\0' in value:
        yield f'{path}: expected text, got a NUL at character {value.index(chr(0))}'


def _float_faults(kind: Primitive, value: Any, path: str, style: Style) -> Iterator[str]:
    if isinstance(value, float) and not math.isfinite(value):
        if style.non_finite == 'error':
            yield f'{path}: expected a finite number, got {value}'
    elif isinstance(value, float | int) and kind.name == 'float32':
        try:
            struct.pack('<f', value)
        except OverflowError:
            yield f'{path}: expected float32, got {value!r:.{_SHOWN}}'
