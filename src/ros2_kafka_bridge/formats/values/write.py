"""Functions from structs to CDR bytes, made from the layout of a type.

The source is written without checks where the module struct checks for itself. Where anything
fails, the fault is looked for once more, slowly, to tell its path.
"""

import math
import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from ros2_kafka_bridge.errors import DecodeError, RecordTooLargeError
from ros2_kafka_bridge.formats.generated import Run, Source
from ros2_kafka_bridge.formats.values.faults import first_fault
from ros2_kafka_bridge.formats.values.structs import FLOATS, Style, is_byte, is_decimal, is_text
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


def make_write(
    layout: Layout, style: Style, max_message_bytes: int = sys.maxsize
) -> Callable[[Any], bytes]:
    """Make the function from the struct of a message to its CDR bytes.

    Args:
        layout: Of the message type.
        style: How values appear in the struct.
        max_message_bytes: The most that a message may have, of the route.

    Returns:
        The function. It writes little endian, without padding behind. It raises DecodeError,
        with the path of the field, for what the message type cannot hold, and
        RecordTooLargeError as soon as the message has become too large.

    Raises:
        ConfigError: The type is nested too deeply.
    """
    quickly = _Writer(style, max_message_bytes).function(layout)

    def write(message: Any) -> bytes:
        try:
            made: bytes = quickly(message)
        except (ArithmeticError, TypeError, ValueError, struct.error):
            fault = first_fault(layout, message, style)
            if fault is None:
                raise
            raise DecodeError(fault) from None
        return made

    return write


@dataclass(slots=True)
class _Writer:
    """Writes the source of one function: `out` grows run by run, in the order of the bytes."""

    style: Style
    max_message_bytes: int
    source: Source = field(default_factory=Source)
    run: Run = field(default_factory=Run)
    values: list[str] = field(default_factory=list)
    floats: bool = False

    def function(self, layout: Layout) -> Callable[[Any], Any]:
        self.source.type_name = layout.type_name
        self._message(layout, 'message')
        self._flush()
        self._check_size()
        self.source.line('return bytes(out)')
        head = 'def made(message):\n    out = bytearray(HEADER)'
        return self.source.function(head, _TOOLS)

    def _check_size(self) -> None:
        self.source.line(f'if len(out) > {self.max_message_bytes}:')
        self.source.line(f'    raise too_large(len(out), {self.max_message_bytes})')

    def _message(self, layout: Layout, value: str) -> None:
        if not layout.fields:
            self.run.add('x', 1, values=0)
        for number, member in enumerate(layout.fields):
            self._value(member.kind, f'{value}.f{number}')

    def _value(self, kind: Kind, value: str) -> None:
        match kind:
            case Primitive():
                self._align(width_of(kind))
                self._add(kind, self._number(kind, value))
            case String():
                self._string(kind, value)
            case Array():
                self._array(kind, self._named(value))
            case Sequence():
                self._sequence(kind, self._named(value))
            case Layout():
                self._message(kind, self._named(value))

    def _named(self, value: str) -> str:
        name = self.source.variable()
        self.source.line(f'{name} = {value}')
        return name

    def _number(self, kind: Primitive, value: str) -> str:
        return f'int({value})' if self._converted(kind) else value

    def _numbers(self, kind: Primitive, values: str) -> str:
        return f'*map(int, {values})' if self._converted(kind) else f'*{values}'

    def _converted(self, kind: Primitive) -> bool:
        return is_text(kind, self.style) or is_decimal(kind, self.style)

    def _add(self, kind: Primitive, value: str, count: int = 1) -> None:
        self.floats = self.floats or kind.name in FLOATS
        self.run.add(PRIMITIVES[kind.name], width_of(kind), count)
        self.values.append(value)

    def _string(self, kind: String, value: str) -> None:
        text = self._named(f'wide({value})' if kind.wide else f'{value}.encode()')
        if kind.bound is not None:
            limit = kind.bound * (4 if kind.wide else 1)
            self.source.line(f'if len({text}) > {limit}: raise ValueError')
        if kind.wide:
            self._length(f'len({text}) // 4')
            self.source.line(f'out += {text}')
            self.run.know(4)
            return
        self.source.line(f'if 0 in {text}: raise ValueError')
        self._length(f'len({text}) + 1')
        self.source.line(f'out += {text}')
        self.source.line('out.append(0)')
        self.run.know(1)

    def _array(self, kind: Array, value: str) -> None:
        if is_byte(kind.item):
            self.source.line(f'if len({value}) != {kind.length}: raise ValueError')
            self.run.add('s', 1, kind.length, values=1)
            self.values.append(f'bytes({value})')
        elif isinstance(kind.item, Primitive):
            # The number of values is checked by the module struct, for the whole run at once.
            self.source.line(f'if len({value}) != {kind.length}: raise ValueError')
            self._align(width_of(kind.item))
            self._add(kind.item, self._numbers(kind.item, value), kind.length)
        else:
            self.source.line(f'if len({value}) != {kind.length}: raise ValueError')
            self._loop(kind.item, value)

    def _sequence(self, kind: Sequence, value: str) -> None:
        if kind.bound is not None:
            self.source.line(f'if len({value}) > {kind.bound}: raise ValueError')
        self._length(f'len({value})')
        if not isinstance(kind.item, Primitive):
            self._loop(kind.item, value)
            return
        width = width_of(kind.item)
        if is_byte(kind.item):
            self.source.line(f'out += bytes({value})')
        else:
            if width == 8:
                # An empty sequence is not followed by the alignment of its items.
                self.source.line(f'if {value}: {_aligned(8)}')
            codes = f'f"<{{len({value})}}{PRIMITIVES[kind.item.name]}"'
            numbers = self._numbers(kind.item, value)
            # Texts are all that json has beside numbers here, and float() takes them at once.
            one = 'float' if self.style.non_finite == 'string' else 'number'
            self._pack(f'pack({codes}, ', numbers, floats=kind.item.name in FLOATS, one=one)
        self.run.know(min(width, 4))

    def _loop(self, item: Kind, values: str) -> None:
        self._flush()
        value = self.source.variable()
        self.source.line(f'for {value} in {values}:')
        self.source.depth += 1
        # Where an item begins depends on the items before it.
        self.run.know(1)
        self._value(item, value)
        self._flush()
        # An empty message of two bytes in a record may have kilobytes of arrays here.
        self._check_size()
        self.source.depth -= 1
        self.run.know(1)

    def _length(self, length: str) -> None:
        """Writes the length of a string or sequence, and all before it."""
        self._align(4)
        self.run.add('I', 4)
        self.values.append(length)
        self._flush()

    def _align(self, width: int) -> None:
        if not self.run.fits(width):
            self._flush()
            self.source.line(_aligned(width))
            self.run.know(width)

    def _flush(self) -> None:
        """Writes the run, and begins another one behind it."""
        if self.run.size:
            pack = self.source.constant(self.run.compiled().pack)
            self._pack(f'{pack}(', ', '.join(self.values), floats=self.floats)
        self.run.go_on()
        self.values.clear()
        self.floats = False

    def _pack(self, call: str, values: str, *, floats: bool, one: str = 'number') -> None:
        """Packs values; where floats may be texts or None, those are looked at on failure."""
        if not floats or self.style.non_finite not in {'string', 'null'}:
            self.source.line(f'out += {call}{values})')
            return
        self.source.line('try:')
        self.source.line(f'    out += {call}{values})')
        self.source.line('except Unpackable:')
        self.source.line(f'    out += {call}*map({one}, ({values},)))')


def _aligned(width: int) -> str:
    # The 4 bytes of the header do not count, and matter from a width of 8 on.
    return f'out += PAD{width}[len(out) & {width - 1}]'


def _wide(text: str) -> bytes:
    """The bytes of a wstring: UTF-16, each unit in 4 bytes."""
    units = memoryview(text.encode('utf-16-le')).cast('H')
    return struct.pack(f'<{len(units)}I', *units)


def _number(value: Any) -> Any:
    if value is None:
        return math.nan
    return float(value) if isinstance(value, str) else value


def _too_large(written: int, limit: int) -> RecordTooLargeError:
    return RecordTooLargeError(written, limit, 'as a message: max_message_bytes of the route')


_TOOLS: Final[dict[str, Any]] = {
    'HEADER': b'\x00\x01\x00\x00',
    'PAD2': [b'', b'\0'],
    'PAD4': [bytes(-size % 4) for size in range(4)],
    'PAD8': [bytes((4 - size) % 8) for size in range(8)],
    'Unpackable': struct.error,
    'number': _number,
    'pack': struct.pack,
    'too_large': _too_large,
    'wide': _wide,
}
