"""What a message type looks like: its fields, and how they lie in the CDR bytes."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias


@dataclass(frozen=True, slots=True)
class Primitive:
    """A number, a bool or a byte.

    Args:
        name: A key of `PRIMITIVES`: bool, byte, float32, float64, int8 ... uint64.
    """

    name: str


@dataclass(frozen=True, slots=True)
class String:
    """Text: UTF-8 behind its length and before a NUL, or UTF-16 in units of 4 bytes.

    Args:
        bound: The most bytes (wide: units) it may have, None without a bound.
        wide: True for a wstring.
    """

    bound: int | None = None
    wide: bool = False


@dataclass(frozen=True, slots=True)
class Array:
    """Always `length` items (at least 1), without a length in the bytes."""

    item: 'Kind'
    length: int


@dataclass(frozen=True, slots=True)
class Sequence:
    """Any number of items up to `bound`, behind their number."""

    item: 'Kind'
    bound: int | None = None


_BULK_BYTES: Final = 65_536

Scalar: TypeAlias = bool | int | float | str


class Field(NamedTuple):
    """One field of a message.

    Args:
        default: What the definition says where nobody sets the field; a tuple for an array or
            sequence, None where the definition says nothing (then it is zero or empty).
        doc: What the comments of the definition say about it, without a trailing newline.
    """

    name: str
    kind: 'Kind'
    default: Scalar | tuple[Scalar, ...] | None = None
    doc: str = ''


class Constant(NamedTuple):
    """A named value of a message type; it is no part of the bytes."""

    name: str
    kind: Primitive | String
    value: Scalar
    doc: str = ''


@dataclass(frozen=True, slots=True)
class Layout:
    """One message type.

    Args:
        type_name: As `std_msgs/msg/String`.
        fields: In the order of the bytes. A message without fields is one byte of any value.
        constants: In the order of the definition.
        doc: What the comments of the definition say about the type.
        type_hash: `RIHS01_` and 64 hex digits (REP 2011), None where it is not known.
    """

    type_name: str
    fields: tuple[Field, ...]
    constants: tuple[Constant, ...] = ()
    doc: str = ''
    type_hash: str | None = None


Kind: TypeAlias = Primitive | String | Array | Sequence | Layout

PRIMITIVES: Final = {
    'bool': '?',
    'byte': 'B',
    'float32': 'f',
    'float64': 'd',
    'int8': 'b',
    'int16': 'h',
    'int32': 'i',
    'int64': 'q',
    'uint8': 'B',
    'uint16': 'H',
    'uint32': 'I',
    'uint64': 'Q',
}
"""The primitives of ROS 2 by name, each with its code in the module struct."""


def ros_type(kind: Kind) -> str:
    """A type as a .msg file spells it: `float64[36]`, `string<=10`, `std_msgs/msg/Header[]`."""
    match kind:
        case Primitive():
            return kind.name
        case String():
            bound = '' if kind.bound is None else f'<={kind.bound}'
            return f'{"w" * kind.wide}string{bound}'
        case Array():
            return f'{ros_type(kind.item)}[{kind.length}]'
        case Sequence():
            bound = '' if kind.bound is None else f'<={kind.bound}'
            return f'{ros_type(kind.item)}[{bound}]'
        case Layout():
            return kind.type_name


def dotted_name(layout: Layout) -> str:
    """The name of a type outside ROS: `std_msgs.msg.String`."""
    return layout.type_name.replace('/', '.')


def width_of(primitive: Primitive) -> int:
    """How many bytes a primitive has; it is aligned to as many."""
    return struct.calcsize('<' + PRIMITIVES[primitive.name])


def limits_of(integer: Primitive) -> tuple[int, int]:
    """The smallest and the largest value of an integer."""
    bits = 8 * width_of(integer)
    if PRIMITIVES[integer.name].isupper():
        return 0, 2**bits - 1
    return -(2 ** (bits - 1)), 2 ** (bits - 1) - 1


def layouts_in(kind: Kind, found: dict[str, Layout] | None = None) -> dict[str, Layout]:
    """The layouts of all message types in a kind, by name, in the order in which they come.

    Args:
        kind: The kind; that of a message type is the first itself.
        found: Those that are known, which are added to.
    """
    found = {} if found is None else found
    match kind:
        case Array() | Sequence():
            layouts_in(kind.item, found)
        case Layout() if kind.type_name not in found:
            found[kind.type_name] = kind
            for field in kind.fields:
                layouts_in(field.kind, found)
    return found


def with_layout(kind: Kind, change: Callable[[Layout], Layout]) -> Kind:
    """A kind whose message type, where it has one, is changed."""
    match kind:
        case Layout():
            return change(kind)
        case Array() | Sequence():
            return replace(kind, item=with_layout(kind.item, change))
        case _:
            return kind


def is_bulk(kind: Kind) -> bool:
    """Whether such a message carries raw data of any length, or nearly so, as an image does."""
    match kind:
        case Sequence(item=Primitive() as item, bound=bound):
            return width_of(item) == 1 and (bound is None or bound > _BULK_BYTES)
        case Layout():
            return any(is_bulk(field.kind) for field in kind.fields)
        case Sequence() | Array():
            return is_bulk(kind.item)
        case _:
            return False


def has_slack(kind: Kind) -> bool:
    """Whether rclpy's `serialize_message` may leave more than 3 bytes behind such a message.

    It hands out the size that it estimated: 4 bytes too many for each wstring, and for each
    empty sequence of primitives of 8 bytes.
    """
    match kind:
        case String():
            return kind.wide
        case Sequence(item=Primitive() as item):
            return width_of(item) == 8
        case Array() | Sequence():
            return has_slack(kind.item)
        case Layout():
            return any(has_slack(inner) for _, inner, *_ in kind.fields)
        case _:
            return False
