"""Functions from CDR bytes to structs, made from the layout of a type.

A message is validated as a whole before it is read (`walk`), so that the reading is without
checks. Neighbouring primitives are one call of the module struct, and so is a whole array.
"""

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cache
from itertools import compress, count
from operator import not_
from typing import Any, Final

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.cdr import make_exact
from ros2_kafka_bridge.formats.generated import Run, Source
from ros2_kafka_bridge.formats.values.faults import first_fault
from ros2_kafka_bridge.formats.values.structs import (
    FLOATS,
    NON_FINITE,
    Structs,
    Style,
    is_byte,
    is_decimal,
    is_text,
    make_structs,
)
from ros2_kafka_bridge.message_types.layout import (
    PRIMITIVES,
    Array,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
    width_of,
)


def make_read(layout: Layout, structs: Structs, style: Style) -> Callable[[bytes], Any]:
    """Make the function from the CDR bytes of a message to its struct.

    Args:
        layout: Of the message type.
        structs: Made for the same layout and style.
        style: How values appear.

    Returns:
        The function. It takes either byte order, and raises DecodeError for what is not one
        message of this type, or has what the style refuses.
    """
    exact = make_exact(layout)
    by_order = [_Reader(order, structs, style).function(layout) for order in '><']

    def read(value: bytes) -> Any:
        exact(value)
        return by_order[value[1]](value)

    if style.non_finite != 'error':
        return read

    @cache
    def as_floats() -> Callable[[bytes], Any]:
        """Most routes never need it."""
        floats = style._replace(non_finite='float')
        return make_read(layout, make_structs(layout, floats), floats)

    def read_finite(value: bytes) -> Any:
        try:
            return read(value)
        except _NonFiniteError:
            fault = first_fault(layout, as_floats()(value), style)
            raise DecodeError(str(fault)) from None

    return read_finite


class _NonFiniteError(Exception):
    pass


@dataclass(slots=True)
class _Reader:
    """Writes the source of one function.

    Each field becomes an expression for the constructor of its struct; what it names is read by
    the lines before. In that source, `at` is where the run begins.
    """

    order: str
    structs: Structs
    style: Style
    source: Source = field(default_factory=Source)
    run: Run = field(default_factory=Run)
    tuple_name: str = ''
    later: list[str] = field(default_factory=list)
    floats: bool = False

    def function(self, layout: Layout) -> Callable[[bytes], Any]:
        self.run.order = self.order
        self.source.type_name = layout.type_name
        self._begin()
        message = self._message(layout)
        self._flush()
        self.source.line(f'return {message}')
        tools = _TOOLS | {'order': self.order}
        return self.source.function('def made(value):\n    at = 4', tools)

    def _message(self, layout: Layout) -> str:
        made = self.source.constant(self.structs[layout.type_name])
        if not layout.fields:
            self._align(1)
            self.run.add('x', 1, values=0)
        values = [self._value(kind) for kind in (field.kind for field in layout.fields)]
        return f'{made}({", ".join(values)})'

    def _value(self, kind: Kind) -> str:
        match kind:
            case Primitive():
                return self._shown(kind, self._primitive(kind))
            case String():
                return self._string(kind)
            case Array():
                return self._array(kind)
            case Sequence():
                return self._sequence(kind)
            case Layout():
                return self._message(kind)

    def _primitive(self, kind: Primitive) -> str:
        self._align(width_of(kind))
        name = self.tuple_name
        return f'{name}[{self._add(kind)}]'

    def _add(self, kind: Primitive, count: int = 1) -> int:
        self.floats = self.floats or kind.name in FLOATS
        return self.run.add(PRIMITIVES[kind.name], width_of(kind), count)

    def _shown(self, kind: Primitive, one: str) -> str:
        if is_text(kind, self.style):
            return f'str({one})'
        return f'Decimal({one})' if is_decimal(kind, self.style) else one

    def _many_shown(self, kind: Primitive, many: str) -> str:
        if is_text(kind, self.style):
            return f'list(map(str, {many}))'
        return f'list(map(Decimal, {many}))' if is_decimal(kind, self.style) else many

    def _string(self, kind: String) -> str:
        n, text = self._length(), self.source.variable()
        if kind.wide:
            self.source.line(f'{text} = wide(value, at, {n}, order)')
            self.source.line(f'at += 4 * {n}')
        else:
            self.source.line(f'{text} = value[at:at + {n} - 1].decode()')
            self.source.line(f'at += {n}')
        self.run.know(4 if kind.wide else 1)
        return text

    def _array(self, kind: Array) -> str:
        if not isinstance(kind.item, Primitive):
            return self._loop(kind.item, str(kind.length))
        if is_byte(kind.item):
            return self._bytes_array(kind.length)
        self._align(width_of(kind.item))
        name = self.tuple_name
        first = self._add(kind.item, kind.length)
        return self._many_shown(kind.item, f'{name}[{first}:{first + kind.length}]')

    def _bytes_array(self, length: int) -> str:
        self._align(1)
        begin, data = self.run.size, self.source.variable()
        self.run.add('x', 1, length, values=0)
        found = f'value[at + {begin}:at + {begin + length}]'
        self.later.append(f'{data} = {self._bytes(found)}')
        return data

    def _bytes(self, found: str) -> str:
        return found if self.style.bytes_as == 'bytes' else f'list({found})'

    def _sequence(self, kind: Sequence) -> str:
        n = self._length()
        if not isinstance(kind.item, Primitive):
            return self._loop(kind.item, n)
        items, width = self.source.variable(), width_of(kind.item)
        if is_byte(kind.item):
            self.source.line(f'{items} = {self._bytes(f"value[at:at + {n}]")}')
        else:
            if width == 8:
                # An empty sequence is not followed by the alignment of its items.
                self.source.line(f'if {n}: at = {_aligned(8)}')
            codes = f'f"{self.order}{{{n}}}{PRIMITIVES[kind.item.name]}"'
            self.source.line(f'{items} = unpack_from({codes}, value, at)')
            if kind.item.name in FLOATS:
                self._check_finite(items)
        self.source.line(f'at += {width} * {n}' if width > 1 else f'at += {n}')
        self.run.know(min(width, 4))
        return self._many_shown(kind.item, items)

    def _loop(self, item: Kind, times: str) -> str:
        self._flush()
        items = self.source.variable()
        self.source.line(f'{items} = []')
        self.source.line(f'for _ in range({times}):')
        self.source.depth += 1
        # Where an item begins depends on the items before it.
        self.run.know(1)
        value = self._value(item)
        self._flush()
        self.source.line(f'{items}.append({value})')
        self.source.depth -= 1
        self.run.know(1)
        return items

    def _length(self) -> str:
        """Reads the length of a string or sequence, and leaves `at` behind it."""
        self._align(4)
        n, name, first = self.source.variable(), self.tuple_name, self.run.add('I', 4)
        self._flush()
        self.source.line(f'{n} = {name}[{first}]')
        return n

    def _align(self, width: int) -> None:
        if not self.run.fits(width):
            self._flush()
            self.source.line(f'at = {_aligned(width)}')
            self.run.know(width)

    def _begin(self) -> None:
        self.tuple_name = self.source.variable()
        self.floats = False
        self.later.clear()

    def _flush(self) -> None:
        """Reads the run, and begins another one behind it."""
        if self.run.values:
            unpack = self.source.constant(self.run.compiled().unpack_from)
            self.source.line(f'{self.tuple_name} = {unpack}(value, at)')
        if self.floats:
            self._check_finite(self.tuple_name)
        for line in self.later:
            self.source.line(line)
        if self.run.size:
            self.source.line(f'at += {self.run.size}')
        self.run.go_on()
        self._begin()

    def _check_finite(self, values: str) -> None:
        """One sum tells whether all are finite; a sum too large only costs a second look."""
        if self.style.non_finite != 'float':
            self.source.line(f'if not isfinite(sum({values})):')
            self.source.line(f'    {values} = {self.style.non_finite}({values})')


def _aligned(width: int) -> str:
    # The 4 bytes of the header do not count, and matter from a width of 8 on.
    return '((at + 3) & -8) + 4' if width == 8 else f'(at + {width - 1}) & -{width}'


def _wide(value: bytes, at: int, units: int, order: str) -> str:
    """The text of a wstring: UTF-16, each unit in 4 bytes."""
    found = value[at : at + 4 * units].decode(f'utf-32-{_ENDS[order]}', 'surrogatepass')
    return found.encode('utf-16-le', 'surrogatepass').decode('utf-16-le')


_ENDS: Final = {'<': 'le', '>': 'be'}


def _as_text(values: Iterable[Any]) -> list[Any]:
    shown = list(values)
    for place in _not_finite(shown):
        shown[place] = NON_FINITE[str(shown[place])]
    return shown


def _as_none(values: Iterable[Any]) -> list[Any]:
    shown = list(values)
    for place in _not_finite(shown):
        shown[place] = None
    return shown


def _not_finite(values: list[Any]) -> Iterator[int]:
    """Their places; only what is found costs a step of Python."""
    return compress(count(), list(map(not_, map(math.isfinite, values))))


def _refuse(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if all(map(math.isfinite, values)):
        return values
    raise _NonFiniteError


_TOOLS: Final[dict[str, Any]] = {
    'Decimal': Decimal,
    'isfinite': math.isfinite,
    'unpack_from': struct.unpack_from,
    'wide': _wide,
    'string': _as_text,
    'null': _as_none,
    'error': _refuse,
}
