"""Type descriptions (REP 2011, 2016): what ROS 2 writes down of a message type, and its hash."""

import ast
import hashlib
import json
import re
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

import msgspec

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types.layout import (
    PRIMITIVES,
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Scalar,
    Sequence,
    String,
    limits_of,
)


class FieldType(msgspec.Struct, frozen=True):
    """What a field holds.

    Args:
        type_id: A number of type_description_interfaces/msg/FieldType.
        capacity: The length of an array or the bound of a sequence; 0 without one.
        string_capacity: The bound of a string; 0 without one.
        nested_type_name: As `std_msgs/msg/Header`; empty where it is no message.
    """

    type_id: int
    capacity: int
    string_capacity: int
    nested_type_name: str


class FieldDescription(msgspec.Struct, frozen=True):
    """One field of a type; `default_value` is the text of a Python literal, or empty."""

    name: str
    type: FieldType
    default_value: str = ''


class TypeDescription(msgspec.Struct, frozen=True):
    """One type, without the types that it holds. The order of the fields is in its hash."""

    type_name: str
    fields: tuple[FieldDescription, ...]


class DescribedTypes(msgspec.Struct, frozen=True):
    """A type with all that it holds, by name.

    Args:
        types: By name.
        hashes: Of each where that is known.
        origin: Where that is from, as `is installed here`.
    """

    types: dict[str, TypeDescription]
    hashes: dict[str, str]
    origin: str = ''


class Ids(IntEnum):
    """Of type_description_interfaces/msg/FieldType, what ROS 2 makes of a .msg file."""

    NESTED = 1
    INT8 = 2
    UINT8 = 3
    INT16 = 4
    UINT16 = 5
    INT32 = 6
    UINT32 = 7
    INT64 = 8
    UINT64 = 9
    FLOAT32 = 10
    FLOAT64 = 11
    BOOL = 15
    BYTE = 16
    STRING = 17
    WSTRING = 18
    BOUNDED_STRING = 21
    BOUNDED_WSTRING = 22


class Lists(IntEnum):
    """What is added to an id for a list of it."""

    NONE = 0
    ARRAY = 48
    BOUNDED_SEQUENCE = 96
    SEQUENCE = 144


EMPTY_MEMBER: Final = 'structure_needs_at_least_one_member'
"""The uint8 that ROS 2 puts into a type without fields, and shows nobody."""

_LISTS: Final = 48
_NAME: Final = re.compile(r'[A-Za-z]\w*', re.ASCII)
_NESTED_NAME: Final = re.compile(r'\w+/msg/\w+', re.ASCII)
_LONGEST: Final = 2**32 - 1  # a length is a uint32 in the bytes
_DEEPEST: Final = 100
_MOST_FIELDS: Final = 10_000
_PRIMITIVES: Final = {one.value: one.name.lower() for one in Ids if one.name.lower() in PRIMITIVES}


def type_hash(name: str, types: Mapping[str, TypeDescription]) -> str:
    """The hash of a type, from its own description and from those of all that it holds.

    Args:
        name: As `std_msgs/msg/String`.
        types: At least that type and all that it holds.

    Returns:
        `RIHS01_` and 64 hex digits (REP 2011).
    """
    inner = [_without_defaults(types[one]) for one in held_names(name, types)]
    description = {
        'type_description': _without_defaults(types[name]),
        'referenced_type_descriptions': inner,
    }
    text = json.dumps(description, ensure_ascii=True, separators=(', ', ': '))
    return f'RIHS01_{hashlib.sha256(text.encode()).hexdigest()}'


def nested_names(description: TypeDescription) -> list[str]:
    """The types that a type holds itself."""
    names = (field.type.nested_type_name for field in description.fields)
    return [name for name in dict.fromkeys(names) if name]


def held_names(name: str, types: Mapping[str, TypeDescription]) -> list[str]:
    """All types that a type holds, those of its parts too, sorted."""
    held: set[str] = set()
    open_names = nested_names(types[name])
    while open_names:
        inner = open_names.pop()
        if inner not in held:
            held.add(inner)
            open_names += nested_names(types[inner])
    return sorted(held)


def make_layout(name: str, described: DescribedTypes) -> Layout:
    """The layout of a type.

    Raises:
        ConfigError: The bridge cannot carry such a type, or it holds itself.
    """
    if not _NESTED_NAME.fullmatch(name):  # it may be a stranger's, and becomes the name of a file
        raise ConfigError([f'{name!r:.60} is no name of a message type'])
    layout = _layout((name,), described, {}).layout
    if _all_fields(layout, {}) > _MOST_FIELDS:
        raise ConfigError(
            [f'{name} has more than {_MOST_FIELDS:,} fields, those of its parts too']
        )
    return layout


def _all_fields(kind: Kind, counted: dict[str, int]) -> int:
    """How many fields a type has with those of its parts, each as often as it is there."""
    if isinstance(kind, Array | Sequence):
        return _all_fields(kind.item, counted)
    if not isinstance(kind, Layout):
        return 0
    if kind.type_name not in counted:
        parts = sum(_all_fields(field.kind, counted) for field in kind.fields)
        counted[kind.type_name] = len(kind.fields) + parts
    return counted[kind.type_name]


def _without_defaults(description: TypeDescription) -> dict[str, object]:
    fields = [
        {'name': field.name, 'type': msgspec.to_builtins(field.type)}
        for field in description.fields
    ]
    return {'type_name': description.type_name, 'fields': fields}


class _Made(NamedTuple):
    """A layout that is made, and how many types deep it is."""

    layout: Layout
    depth: int


def _layout(path: tuple[str, ...], described: DescribedTypes, made: dict[str, _Made]) -> _Made:
    """The layout of the last type of a path, which leads to it from the outermost type."""
    *outer, name = path
    if name in outer:
        raise ConfigError([f'{name} holds itself: {" > ".join(path[outer.index(name) :])}'])
    if len(path) > _DEEPEST:
        raise _too_deep(path)
    if name not in made:
        description = described.types[name]

        def held(inner: str) -> Layout:
            return _layout((*path, inner), described, made).layout

        fields = tuple(_field(field, name, held) for field in description.fields)
        names = [field.name for field in fields]
        if len({*names}) < len(names):
            raise ConfigError([f'{name} has two fields of one name'])
        if names == [EMPTY_MEMBER]:
            fields = ()
        layout = Layout(name, fields, type_hash=described.hashes.get(name))
        depths = [made[inner].depth for inner in nested_names(description)]
        made[name] = _Made(layout, 1 + max(depths, default=0))
    if len(outer) + made[name].depth > _DEEPEST:  # it was reached by a shorter path before
        raise _too_deep(path)
    return made[name]


def _too_deep(path: tuple[str, ...]) -> ConfigError:
    return ConfigError([f'{path[0]} is nested too deeply: more than {_DEEPEST} types'])


def _field(field: FieldDescription, holder: str, held: Callable[[str], Layout]) -> Field:
    if not _NAME.fullmatch(field.name):
        raise ConfigError([f'{holder}: {field.name!r:.60} is no name of a field'])
    try:
        kind = _kind(field.type, held)
        return Field(field.name, kind, _default(field.default_value, kind))
    except ValueError as error:
        raise ConfigError([f'{holder}, field {field.name}: {error}']) from error


def _kind(field_type: FieldType, held: Callable[[str], Layout]) -> Kind:
    repeated, base = divmod(field_type.type_id, _LISTS)
    for length in (field_type.capacity, field_type.string_capacity):
        if not 0 <= length <= _LONGEST:
            raise ValueError(f'the length {length} is below 0 or above {_LONGEST}')
    item = _item(base, field_type, held)
    match repeated * _LISTS:
        case Lists.NONE:
            return item
        case Lists.ARRAY if not field_type.capacity:
            raise ValueError('an array has one element at least')
        case Lists.ARRAY:
            return Array(item, field_type.capacity)
        case Lists.BOUNDED_SEQUENCE:
            return Sequence(item, field_type.capacity)
        case Lists.SEQUENCE:
            return Sequence(item)
        case _:
            raise ValueError(f'there is no type_id {field_type.type_id}')


def _item(base: int, field_type: FieldType, held: Callable[[str], Layout]) -> Kind:
    if base in _PRIMITIVES:
        return Primitive(_PRIMITIVES[base])
    match base:
        case Ids.NESTED if not _NESTED_NAME.fullmatch(field_type.nested_type_name):
            raise ValueError(f'{field_type.nested_type_name!r:.60} is no name of a type')
        case Ids.NESTED:
            return held(field_type.nested_type_name)
        case Ids.STRING | Ids.BOUNDED_STRING:
            return String(field_type.string_capacity or None)
        case Ids.WSTRING | Ids.BOUNDED_WSTRING:
            return String(field_type.string_capacity or None, wide=True)
        case _:
            raise ValueError(f'type_id {field_type.type_id} of a .idl file cannot be carried')


def _default(text: str, kind: Kind) -> Scalar | tuple[Scalar, ...] | None:
    if not text:
        return None
    match kind:
        case String():
            return text
        case Primitive('float32' | 'float64'):
            return _float(text)
        case Array(Primitive('float32' | 'float64')) | Sequence(Primitive('float32' | 'float64')):
            # No literal of Python is NaN or infinite.
            return tuple(_float(one) for one in text.strip('()[] ,').split(',') if one.strip())
        case Primitive() | Array() | Sequence():
            return _fitting(_literal(text), kind)
        case Layout():
            raise ValueError(f'a message has no default, as {text!r}')


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f'the default {text!r:.60} is no number') from None


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise ValueError(f'the default {text!r:.60} is no literal of Python') from None


def _fitting(value: Any, kind: Kind) -> Scalar | tuple[Scalar, ...]:
    """A default as its kind has it."""
    match kind, value:
        case Array(item, length), tuple() | list() if len(value) == length:
            return tuple(_fitting_scalar(one, item) for one in value)
        case Sequence(item, bound), tuple() | list() if bound is None or len(value) <= bound:
            return tuple(_fitting_scalar(one, item) for one in value)
    return _fitting_scalar(value, kind)


def _fitting_scalar(value: Any, kind: Kind) -> Scalar:
    match kind, value:
        case String(), str(text):
            return text
        case Primitive('bool'), bool() | 0 | 1:
            return bool(value)
        case Primitive(name), int(number) if name != 'bool' and _is_within(number, name):
            return number
    raise ValueError(f'the default {value!r:.60} does not fit')


def _is_within(value: int, name: str) -> bool:
    least, most = limits_of(Primitive(name))
    return least <= value <= most
