"""Functions from structs to CDR bytes, made from the layout of a type.

The source is written without checks where the module struct checks for itself. Where anything
fails, the fault is looked for once more, slowly, to tell its path.
"""

import math
import struct
import sys
from collections.abc import Callable
from typing import Any, Final

from ros2_kafka_bridge.errors import DecodeError, RecordTooLargeError
from ros2_kafka_bridge.formats.generated import LENGTH, Run, Source, visit
from ros2_kafka_bridge.formats.values.faults import first_fault
from ros2_kafka_bridge.formats.values.structs import FLOATS, Style, converter_of, is_byte
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
    quickly = _Writer(layout, style, max_message_bytes).function()

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


class _Writer:
    """Writes the source of one function: `out` grows run by run, in the order of the bytes."""

    def __init__(self, layout: Layout, style: Style, max_message_bytes: int) -> None:
        self.style = style
        self.max_message_bytes = max_message_bytes
        self.source = Source(layout.type_name)
        self.run = Run(self.source, self.pack, _aligned)
        self.values: list[str] = []
        self.floats = False
        self.message(layout, 'message')
        self.run.flush()
        self._check_size()
        self.source.line('return bytes(out)')

    def function(self) -> Callable[[Any], Any]:
        return self.source.function('def made(message):\n    out = bytearray(HEADER)', _TOOLS)

    def _check_size(self) -> None:
        self.source.line(f'if len(out) > {self.max_message_bytes}:')
        self.source.line(f'    raise too_large(len(out), {self.max_message_bytes})')

    def message(self, layout: Layout, value: str) -> None:
        if not layout.fields:
            self.run.add(1)
        name = self._named(value)
        for number, member in enumerate(layout.fields):
            visit(self, member.kind, f'{name}.f{number}')

    def _named(self, value: str) -> str:
        name = self.source.variable()
        self.source.line(f'{name} = {value}')
        return name

    def number(self, kind: Primitive, value: str) -> None:
        self._add(kind, f'int({value})' if converter_of(kind, self.style) else value)

    def _numbers(self, kind: Primitive, values: str) -> str:
        return f'*map(int, {values})' if converter_of(kind, self.style) else f'*{values}'

    def _add(self, kind: Primitive, value: str, count: int = 1) -> None:
        self.run.add(width_of(kind), count, PRIMITIVES[kind.name])
        self.floats = self.floats or kind.name in FLOATS
        self.values.append(value)

    def text(self, kind: String, value: str) -> None:
        text = self._named(f'wide({value})' if kind.wide else f'{value}.encode()')
        if kind.bound is not None:
            limit = kind.bound * (4 if kind.wide else 1)
            self.source.line(f'if len({text}) > {limit}: raise ValueError')
        if not kind.wide:
            self.source.line(f'if 0 in {text}: raise ValueError')
        self._length(f'len({text}) // 4' if kind.wide else f'len({text}) + 1')
        self.source.line(f'out += {text}')
        if not kind.wide:
            self.source.line('out.append(0)')
        self.run.know(4 if kind.wide else 1)

    def array(self, kind: Array, value: str) -> None:
        name = self._named(value)
        # The module struct checks the number of values for the whole run alone.
        self.source.line(f'if len({name}) != {kind.length}: raise ValueError')
        if not isinstance(kind.item, Primitive):
            self._loop(kind.item, name)
        elif is_byte(kind.item):
            self.run.add(1, kind.length, 's')
            self.values.append(f'bytes({name})')
        else:
            self._add(kind.item, self._numbers(kind.item, name), kind.length)

    def sequence(self, kind: Sequence, value: str) -> None:
        name = self._named(value)
        if kind.bound is not None:
            self.source.line(f'if len({name}) > {kind.bound}: raise ValueError')
        self._length(f'len({name})')
        if not isinstance(kind.item, Primitive):
            self._loop(kind.item, name)
            return
        self.run.begin_items(width_of(kind.item), name)
        if is_byte(kind.item):
            self.source.line(f'out += bytes({name})')
        else:
            codes = f'f"<{{len({name})}}{PRIMITIVES[kind.item.name]}"'
            # Texts are all that json has beside numbers here, and float() takes them at once.
            one = 'float' if self.style.non_finite == 'string' else 'number'
            numbers = self._numbers(kind.item, name)
            self._pack(f'pack({codes}, ', numbers, floats=kind.item.name in FLOATS, one=one)

    def _loop(self, item: Kind, values: str) -> None:
        value = self.source.variable()
        with self.run.loop(f'for {value} in {values}:'):
            visit(self, item, value)
            self.run.flush()
            # An empty message of two bytes in a record may have kilobytes of arrays here.
            self._check_size()

    def _length(self, length: str) -> None:
        """Writes the length of a string or sequence, and all before it."""
        self._add(LENGTH, length)
        self.run.flush()

    def pack(self) -> None:
        """Writes the run."""
        if self.run.size:
            pack = self.source.constant(struct.Struct(f'<{self.run.codes}').pack)
            self._pack(f'{pack}(', ', '.join(self.values), floats=self.floats)
        self.run.begin()
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


def _aligned(_: int, width: int) -> str:
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
