"""The structs that a message is between its CDR bytes and a format, made from its layout.

Their attributes are `f0`, `f1`, ... so that no name of a message ever becomes source; msgspec
shows and takes them by their names in ROS.
"""

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeAlias

import msgspec

from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
    limits_of,
)

Structs: TypeAlias = Mapping[str, type[msgspec.Struct]]
"""The struct of each message type, by the name of the type."""

_BYTES: Final = (Primitive('byte'), Primitive('uint8'))
FLOATS: Final = frozenset({'float32', 'float64'})
_UINT64: Final = Primitive('uint64')
_WIDE_INTEGERS: Final = (Primitive('int64'), _UINT64)


class Style(NamedTuple):
    """How values appear in the structs of a format.

    Args:
        bytes_as: An array or sequence of bytes: as bytes, or as a list of numbers.
        non_finite: NaN and infinity: as a float, as the texts of JSON, as None, or refused.
        integers: 64-bit integers: as an int; as text; or as an int where they fit into
            int64 and, for uint64, a Decimal.
        missing: Whether a field that is not there is an error.
        unknown: Whether a field that the type does not have is an error.
    """

    bytes_as: Literal['bytes', 'list'] = 'bytes'
    non_finite: Literal['float', 'string', 'null', 'error'] = 'float'
    integers: Literal['number', 'string', 'decimal'] = 'number'
    missing: Literal['error', 'default'] = 'error'
    unknown: Literal['error', 'ignore'] = 'error'


def make_structs(layout: Layout, style: Style) -> Structs:
    """Make the structs of a message type and of all types in it."""
    made: dict[str, type[msgspec.Struct]] = {}
    _make(layout, style, made)
    return made


def _make(
    layout: Layout, style: Style, made: dict[str, type[msgspec.Struct]]
) -> type[msgspec.Struct]:
    if layout.type_name not in made:
        made[layout.type_name] = msgspec.defstruct(
            layout.type_name,
            [_member(number, field, style, made) for number, field in enumerate(layout.fields)],
            rename={f'f{number}': field.name for number, field in enumerate(layout.fields)},
            forbid_unknown_fields=style.unknown == 'error',
            # Messages hold no cycles: without its bookkeeping they are made a third faster.
            gc=False,
            namespace={'__doc__': layout.doc or layout.type_name},
        )
    return made[layout.type_name]


def _member(
    number: int, field: Field, style: Style, made: dict[str, type[msgspec.Struct]]
) -> tuple[str, Any] | tuple[str, Any, Any]:
    annotation = _annotation(field.kind, style, made)
    if field.doc:
        annotation = Annotated[annotation, msgspec.Meta(description=field.doc)]
    if style.missing == 'error':
        return f'f{number}', annotation
    return f'f{number}', annotation, _default(field, style, made)


def _annotation(kind: Kind, style: Style, made: dict[str, type[msgspec.Struct]]) -> Any:
    match kind:
        case Primitive():
            return _number(kind, style)
        case String():
            return Annotated[str, msgspec.Meta(max_length=kind.bound)]
        case Array():
            length = msgspec.Meta(min_length=kind.length, max_length=kind.length)
            return Annotated[_many(kind.item, style, made), length]
        case Sequence():
            length = msgspec.Meta(max_length=kind.bound)
            return Annotated[_many(kind.item, style, made), length]
        case Layout():
            return _make(kind, style, made)


def _many(item: Kind, style: Style, made: dict[str, type[msgspec.Struct]]) -> Any:
    if is_byte(item) and style.bytes_as == 'bytes':
        return bytes
    return list[_annotation(item, style, made)]  # type: ignore[misc]


def is_byte(kind: Kind) -> bool:
    """Whether many of this kind are bytes."""
    return kind in _BYTES


def _number(kind: Primitive, style: Style) -> Any:
    if kind.name == 'bool':
        return bool
    if kind.name in FLOATS:
        return _float(kind, style)
    least, most = limits_of(kind)
    limits = _LIMITS_UINT64 if kind == _UINT64 else msgspec.Meta(ge=least, le=most)
    match converter_of(kind, style):
        case 'str':
            return Annotated[int, limits] | Annotated[str, msgspec.Meta(pattern=_WHOLE)]
        case 'Decimal':
            return Decimal
        case _:
            return Annotated[int, limits]


# msgspec compares with int64 at most: what is more is told in the schema, and found by `write`.
_LIMITS_UINT64: Final = msgspec.Meta(ge=0, extra_json_schema={'maximum': 2**64 - 1})
# The limits of a float32 are told in the schema alone, too: `write` rounds, and knows better.
_FLOAT32_MAX: Final = (2 - 2**-23) * 2.0**127
_LIMITS_FLOAT32: Final = msgspec.Meta(
    extra_json_schema={'minimum': -_FLOAT32_MAX, 'maximum': _FLOAT32_MAX}
)
# A `$` alone would let a line break pass behind the digits in Python, though not in JavaScript.
_WHOLE: Final = '^-?[0-9]{1,20}$(?![^0-9])'

NON_FINITE: Final = {'nan': 'NaN', 'inf': 'Infinity', '-inf': '-Infinity'}
"""What JSON has no number for, spelled as JavaScript and protobuf's JSON spell it."""


def _float(kind: Primitive, style: Style) -> Any:
    number: Any = Annotated[float, _LIMITS_FLOAT32] if kind.name == 'float32' else float
    match style.non_finite:
        case 'string':
            return number | Literal['NaN', 'Infinity', '-Infinity']
        case 'null':
            return number | None
        case _:
            return number


def converter_of(kind: Kind, style: Style) -> Literal['str', 'Decimal'] | None:
    """The name of what makes of an integer what appears for it; None where that is itself."""
    if kind in _WIDE_INTEGERS and style.integers == 'string':
        return 'str'
    return 'Decimal' if kind == _UINT64 and style.integers == 'decimal' else None


def _default(field: Field, style: Style, made: dict[str, type[msgspec.Struct]]) -> Any:
    if isinstance(field.kind, Layout):
        return _shared(made[field.kind.type_name]())
    value = field.default
    if value is None:
        return _zero(field.kind, style, made)
    if isinstance(value, tuple):
        assert isinstance(field.kind, Array | Sequence)
        if is_byte(field.kind.item) and style.bytes_as == 'bytes':
            return bytes(map(int, value))
        return tuple(_shown(one, field.kind.item, style) for one in value)
    return _shown(value, field.kind, style)


def _zero(kind: Kind, style: Style, made: dict[str, type[msgspec.Struct]]) -> Any:
    match kind:
        case Primitive():
            zero = False if kind.name == 'bool' else 0.0 if kind.name in FLOATS else 0
            return _shown(zero, kind, style)
        case String():
            return ''
        case Layout():
            return made[kind.type_name]()
        case Array() | Sequence():
            length = kind.length if isinstance(kind, Array) else 0
            if is_byte(kind.item) and style.bytes_as == 'bytes':
                return bytes(length)
            return (_zero(kind.item, style, made),) * length


def _shown(value: object, kind: Kind, style: Style) -> Any:
    if isinstance(value, float) and style.non_finite == 'string':
        return NON_FINITE.get(str(value), value)
    shown = {'str': str, 'Decimal': Decimal}.get(converter_of(kind, style) or '')
    return shown(value) if shown else value


def _shared(message: msgspec.Struct) -> Any:
    """As a default: an object of its own in every message would fill memory."""
    return msgspec.field(default_factory=lambda: message)


_SHOWN: Final = 60
_SHOWN_IN_ALL: Final = 400
# The last place is msgspec's own: a name in a record may look like one.
_PLACE: Final = re.compile(r' - at `(\$[\w.\[\]]*)`\Z')
_MISSING: Final = re.compile(r'^Object missing required field `(.*)`$')
_UNKNOWN: Final = re.compile(r'^Object contains unknown field `(.*)`$', re.DOTALL)
_CHOICE: Final = 'Invalid enum value '  # with the value, which nobody but its readers may see


def explain(error: msgspec.MsgspecError) -> str:
    """Tell what msgspec found: the path of the field first, then what was expected."""
    return _explained(str(error), error)[:_SHOWN_IN_ALL]


def _explained(said: str, error: msgspec.MsgspecError) -> str:
    if not isinstance(error, msgspec.ValidationError):
        return said
    place = _PLACE.search(said)
    text, path = (said[: place.start()], place[1]) if place else (said, '$')
    if missing := _MISSING.match(text):
        return f'{path}.{missing[1]}: is missing'
    if unknown := _UNKNOWN.match(text):
        return f'{path}.{unknown[1]:.{_SHOWN}}: unknown field'
    if text.startswith(_CHOICE):
        return f'{path}: expected float, got str'
    # The texts for NaN and infinity are no other type to anybody.
    text = text.replace('`', '').replace('float | str', 'float')
    text = text.replace(f'str matching regex {_WHOLE!r}', 'int or its digits as str')
    return f'{path}: {text[:1].lower()}{text[1:]}'
