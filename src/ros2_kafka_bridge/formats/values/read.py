"""Functions from CDR bytes to structs, made from the layout of a type.

A message is validated as a whole before it is read (`walk`), so that the reading is without
checks. Neighbouring primitives are one call of the module struct, and so is a whole array.
"""

import math
import struct
from collections.abc import Callable, Iterable
from decimal import Decimal
from functools import cache
from itertools import compress, count
from operator import not_
from typing import Any, Final

from ros2_kafka_bridge.errors import DecodeError, EncodeError
from ros2_kafka_bridge.formats.cdr import make_exact
from ros2_kafka_bridge.formats.generated import LENGTH, Run, Source, visit
from ros2_kafka_bridge.formats.values.faults import first_fault
from ros2_kafka_bridge.formats.values.structs import (
    FLOATS,
    NON_FINITE,
    Structs,
    Style,
    converter_of,
    is_byte,
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
        The function. It takes either byte order, and raises EncodeError for what is not one
        message of this type, or has what the style refuses.
    """
    exact = make_exact(layout)
    by_order = [_Reader(order, structs, style, layout).function() for order in '><']

    def read(value: bytes) -> Any:
        try:
            exact(value)
        except DecodeError as error:
            raise EncodeError(str(error)) from None
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
            raise EncodeError(str(fault)) from None

    return read_finite


class _NonFiniteError(Exception):
    pass


class _Reader:
    """Writes the source of one function.

    Each field becomes an expression for the constructor of its struct; what it names is read by
    the lines before: `run_values` are those of the run, of which there are `count` so far, and
    the lines of `later` are written behind them.
    """

    def __init__(self, order: str, structs: Structs, style: Style, layout: Layout) -> None:
        self.order = order
        self.structs = structs
        self.style = style
        self.source = Source(layout.type_name)
        self.run = Run(self.source, self.unpack)
        self.run_values = self.source.variable()
        self.count = 0
        self.floats = False
        self.later: list[str] = []
        message = self.message(layout)
        self.run.flush()
        self.source.line(f'return {message}')

    def function(self) -> Callable[[bytes], Any]:
        return self.source.function('def made(value):\n    at = 4', _TOOLS | {'order': self.order})

    def message(self, layout: Layout, _: str = '') -> str:
        made = self.source.constant(self.structs[layout.type_name])
        if not layout.fields:
            self.run.add(1)
        return f'{made}({", ".join(visit(self, field.kind) for field in layout.fields)})'

    def number(self, kind: Primitive, _: str) -> str:
        values, place = self._add(kind)
        made = converter_of(kind, self.style)
        return f'{made}({values}[{place}])' if made else f'{values}[{place}]'

    def _numbers(self, kind: Primitive, many: str) -> str:
        made = converter_of(kind, self.style)
        return f'list(map({made}, {many}))' if made else many

    def _add(self, kind: Primitive, count: int = 1) -> tuple[str, int]:
        """Primitives that are read with the run: where they will be."""
        self.run.add(width_of(kind), count, PRIMITIVES[kind.name])
        self.floats = self.floats or kind.name in FLOATS
        self.count += count
        return self.run_values, self.count - count

    def text(self, kind: String, _: str) -> str:
        n, text = self._length(), self.source.variable()
        if kind.wide:
            self.source.line(f'{text} = wide(value, at, {n}, order)')
            self.source.line(f'at += 4 * {n}')
        else:
            self.source.line(f'{text} = value[at:at + {n} - 1].decode()')
            self.source.line(f'at += {n}')
        self.run.know(4 if kind.wide else 1)
        return text

    def array(self, kind: Array, _: str) -> str:
        if not isinstance(kind.item, Primitive):
            return self._loop(kind.item, str(kind.length))
        if is_byte(kind.item):
            begin, data = self.run.add(1, kind.length), self.source.variable()
            found = self._bytes(f'value[at + {begin}:at + {begin + kind.length}]')
            self.later.append(f'{data} = {found}')
            return data
        values, first = self._add(kind.item, kind.length)
        return self._numbers(kind.item, f'{values}[{first}:{first + kind.length}]')

    def _bytes(self, found: str) -> str:
        return found if self.style.bytes_as == 'bytes' else f'list({found})'

    def sequence(self, kind: Sequence, _: str) -> str:
        n = self._length()
        if not isinstance(kind.item, Primitive):
            return self._loop(kind.item, n)
        items, width = self.source.variable(), width_of(kind.item)
        self.run.begin_items(width, n)
        if is_byte(kind.item):
            self.source.line(f'{items} = {self._bytes(f"value[at:at + {n}]")}')
        else:
            codes = f'f"{self.order}{{{n}}}{PRIMITIVES[kind.item.name]}"'
            self.source.line(f'{items} = unpack_from({codes}, value, at)')
            if kind.item.name in FLOATS:
                self._check_finite(items)
        self.source.line(f'at += {width} * {n}' if width > 1 else f'at += {n}')
        return self._numbers(kind.item, items)

    def _loop(self, item: Kind, times: str) -> str:
        self.run.flush()
        items = self.source.variable()
        self.source.line(f'{items} = []')
        with self.run.loop(f'for _ in range({times}):'):
            value = visit(self, item)
            self.run.flush()
            self.source.line(f'{items}.append({value})')
        return items

    def _length(self) -> str:
        """Reads the length of a string or sequence, and leaves `at` behind it."""
        n, (values, place) = self.source.variable(), self._add(LENGTH)
        self.run.flush()
        self.source.line(f'{n} = {values}[{place}]')
        return n

    def unpack(self) -> None:
        """Reads the run."""
        if self.count:
            unpack = self.source.constant(struct.Struct(self.order + self.run.codes).unpack_from)
            self.source.line(f'{self.run_values} = {unpack}(value, at)')
        if self.floats:
            self._check_finite(self.run_values)
        for line in self.later:
            self.source.line(line)
        self.run_values = self.source.variable()
        self.count, self.floats = 0, False
        self.later.clear()

    def _check_finite(self, values: str) -> None:
        """One sum tells whether all are finite; a sum too large only costs a second look."""
        # None needs no look: msgspec itself writes NaN and infinity as null.
        if self.style.non_finite in {'string', 'error'}:
            self.source.line(f'if not isfinite(sum({values})):')
            self.source.line(f'    {values} = {self.style.non_finite}({values})')


def _wide(value: bytes, at: int, units: int, order: str) -> str:
    """The text of a wstring: UTF-16, each unit in 4 bytes."""
    found = value[at : at + 4 * units].decode(f'utf-32-{_ENDS[order]}', 'surrogatepass')
    return found.encode('utf-16-le', 'surrogatepass').decode('utf-16-le')


_ENDS: Final = {'<': 'le', '>': 'be'}


def _as_text(values: Iterable[Any]) -> list[Any]:
    shown = list(values)
    # Only what is found costs a step of Python.
    for place in compress(count(), list(map(not_, map(math.isfinite, shown)))):
        shown[place] = NON_FINITE[str(shown[place])]
    return shown


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
    'error': _refuse,
}
