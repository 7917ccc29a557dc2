"""Functions between Protobuf messages and structs, made from the layout of a type.

Each type has a function of its own, which calls those of the types in it. A name of a field
becomes source only where it is a plain identifier.
"""

import keyword
import re
from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

import msgspec

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.generated import Source
from ros2_kafka_bridge.formats.values.structs import Structs, Style, is_byte, make_structs
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String

STYLE: Final = Style()
"""How values appear in the structs: bytes as bytes, numbers as they are."""

Fill: TypeAlias = Callable[..., None]
"""(message, struct): puts the fields of the struct into the empty message."""

Read: TypeAlias = Callable[[Any], msgspec.Struct]
"""Makes the struct of a message, which is checked when it is written as CDR."""


def make_fill(layout: Layout) -> Fill:
    """Make the function that puts a struct into a message."""
    return _fill(layout, {})


def make_message_read(layout: Layout, *, strict: bool) -> Read:
    """Make the function from a message to a struct.

    Args:
        layout: Of the message type.
        strict: Whether a field that the type does not have is an error.

    Returns:
        The function. It raises DecodeError with the path of such a field.
    """
    structs = make_structs(layout, STYLE)
    read = _Reads(structs, strict=strict).read(layout)
    if not strict:
        return read

    def read_strictly(message: Any) -> msgspec.Struct:
        try:
            return read(message)
        except _UnknownFieldError:
            raise DecodeError(_unknown(message, '$')) from None

    return read_strictly


def _fill(layout: Layout, made: dict[str, Fill]) -> Fill:
    if layout.type_name not in made:
        source = Source(layout.type_name)
        for number, field in enumerate(layout.fields):
            _fill_field(source, field.name, field.kind, f'values.f{number}', made)
        source.line('return')
        made[layout.type_name] = source.function('def made(message, values):', {})
    return made[layout.type_name]


def _fill_field(source: Source, name: str, kind: Kind, value: str, made: dict[str, Fill]) -> None:
    match kind:
        case Layout():
            inner = source.constant(_fill(kind, made))
            source.line(f'inner = {_member(source, name)}')
            if not any(_is_scalar(field.kind) for field in kind.fields):
                # Else a reader could not tell it from a message that is not there.
                source.line('inner.SetInParent()')
            source.line(f'{inner}(inner, {value})')
        case Array(item=Layout() as item) | Sequence(item=Layout() as item):
            inner = source.constant(_fill(item, made))
            source.line(f'add = {_member(source, name)}.add')
            source.line(f'for item in {value}: {inner}(add(), item)')
        case Array() | Sequence() if not is_byte(kind.item):
            source.line(f'{_member(source, name)}.extend({value})')
        case _ if _is_plain(name):
            source.line(f'message.{name} = {value}')
        case _:
            source.line(f'setattr(message, {source.constant(name)}, {value})')


class _UnknownFieldError(Exception):
    pass


class _Reads:
    """The functions of one route, by the name of the type."""

    def __init__(self, structs: Structs, *, strict: bool) -> None:
        self._structs = structs
        self._strict = strict
        self._made: dict[str, Read] = {}

    def read(self, layout: Layout) -> Read:
        if layout.type_name not in self._made:
            source = Source(layout.type_name)
            if self._strict:
                source.line('if unknown(message): raise UnknownFieldError')
            values = [self._value(source, field.name, field.kind) for field in layout.fields]
            made = source.constant(self._structs[layout.type_name])
            source.line(f'return {made}({", ".join(values)})')
            tools = {'unknown': _unknown_fields(), 'UnknownFieldError': _UnknownFieldError}
            self._made[layout.type_name] = source.function('def made(message):', tools)
        return self._made[layout.type_name]

    def _value(self, source: Source, name: str, kind: Kind) -> str:
        value = _member(source, name)
        match kind:
            case Layout():
                inner = source.constant(self.read(kind))
                # What is not there takes no memory of its own: a list of a million empty
                # messages is two bytes each in a record.
                missing = source.constant(_zero(kind, self._structs))
                has = f'message.HasField({source.constant(name)})'
                return f'{inner}({value}) if {has} else {missing}'
            case Array(item=Layout() as item) | Sequence(item=Layout() as item):
                value = f'list(map({source.constant(self.read(item))}, {value}))'
            case Array() | Sequence() if not is_byte(kind.item):
                value = f'{value}[:]'
        if isinstance(kind, Array):
            # Nothing there, as in a record from before the field was added: all zero.
            return f'{value} or {source.constant(_zero(kind, self._structs))}'
        return value


def _zero(kind: Kind, structs: Structs) -> Any:
    """What a reader of Protobuf sees where nothing is; the defaults of ROS are not known to it."""
    match kind:
        case Layout():
            return structs[kind.type_name](*(_zero(field.kind, structs) for field in kind.fields))
        case Array():
            zero = _zero(kind.item, structs)
            return bytes(kind.length) if is_byte(kind.item) else [zero] * kind.length
        case Sequence():
            return b'' if is_byte(kind.item) else []
        case String():
            return ''
        case Primitive():
            return False if kind.name == 'bool' else 0


def _is_scalar(kind: Kind) -> bool:
    return not isinstance(kind, Layout | Array | Sequence)


def _member(source: Source, name: str) -> str:
    if _is_plain(name):
        return f'message.{name}'
    return f'getattr(message, {source.constant(name)})'


def _is_plain(name: str) -> bool:
    return bool(_PLAIN.fullmatch(name)) and not keyword.iskeyword(name)


_PLAIN: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


def _unknown_fields() -> Callable[[Any], Any]:
    from google.protobuf.unknown_fields import UnknownFieldSet  # noqa: PLC0415 -- heavy

    return UnknownFieldSet


def _unknown(message: Any, path: str) -> str:
    """Tell the first field of a message, or of those in it, that has no name."""
    for field in _unknown_fields()(message):
        return f'{path}: unknown field {field.field_number}'
    return next(filter(None, _unknown_within(message, path)), '')


def _unknown_within(message: Any, path: str) -> Iterator[str]:
    for descriptor, value in message.ListFields():
        if descriptor.message_type is not None:
            inner = f'{path}.{descriptor.name}'
            if descriptor.is_repeated:
                yield from (_unknown(item, f'{inner}[{at}]') for at, item in enumerate(value))
            else:
                yield _unknown(value, inner)
