"""Functions that walk over the CDR bytes of a message, made from the layout of its type.

The bytes are what ROS 2 sends: a 4-byte encapsulation header (00 00 big endian, 00 01 little
endian, 2 bytes of options), then plain XCDR1. There, a primitive is aligned to its own size,
counted from behind the header.

A layout becomes Python source once, when a route starts: it runs in the loop of the route, and
no library reads XCDR1 without making an object of every field. Neighbouring fields of fixed
size share one comparison. Names of fields never become source, only constants beside it.
"""

import difflib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.generated import compiled
from ros2_kafka_bridge.formats.walk_tools import TOOLS, Piece, by_order
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

_BOOL: Final = Primitive('bool')
_EVEN_BYTES: Final = 8192
_MOST_NAMED: Final = 10


def make_end(layout: Layout) -> Callable[[bytes], int]:
    """Make the function that validates a message and finds its end.

    Returns:
        A function from CDR bytes to the index just behind the last field; it looks at nothing
        behind that. It raises DecodeError with the field, the offset and what was expected.

    Raises:
        ConfigError: The type is nested too deeply.
    """
    code = _Code()
    code.message(layout)
    code.close()
    return code.compile(layout.type_name)


def make_reader(layout: Layout, path: str) -> Callable[[bytes], object]:
    """Make the function that reads one field, as `header.frame_id`.

    Returns:
        A function from CDR bytes to a bool, int, float or str. It validates what lies before
        the field, and raises DecodeError.

    Raises:
        ConfigError: There is no such field, it is not one number or text, or the type is
            nested too deeply.
    """
    if problem := scalar_problem(layout, path):
        raise ConfigError([problem])
    code = _Code(target=path)
    code.message(layout)
    return code.compile(layout.type_name)


def scalar_problem(layout: Layout, path: str) -> str | None:
    """Say why a path leads to no number or text, and what is near it; None where it does."""
    scalars = list(_scalars(layout, ''))
    if path in scalars:
        return None
    inner = [known for known in scalars if f'.{path}.' in f'.{known}.'][:3]
    near = inner or difflib.get_close_matches(path, scalars, n=1)
    hint = f' (did you mean {" or ".join(near)}?)' if near else ''
    reason = '' if inner else _why_none(layout, path, hint)
    return f'{layout.type_name} has no number or text at {path}{reason or hint}'


def _why_none(layout: Layout, path: str, hint: str) -> str:
    """What is at the last step of a path that there is; of a name that there is not, the hint."""
    kind: Kind = layout
    at = ''
    for step in path.split('.'):
        if not isinstance(kind, Layout):
            break
        found = next((field.kind for field in kind.fields if field.name == step), None)
        if found is None:
            names = [field.name for field in kind.fields[:_MOST_NAMED]]
            names += ['...'] * (len(kind.fields) > _MOST_NAMED)
            return hint or f': {at or "it"} has {", ".join(names) or "no fields"}'
        kind, at = found, f'{at}.{step}' if at else step
    is_list = isinstance(kind, Array | Sequence)
    return f': {at} is a list' if is_list else f': {at} has no fields'


def _scalars(layout: Layout, prefix: str) -> Iterator[str]:
    for name, kind, *_ in layout.fields:
        if isinstance(kind, Layout):
            yield from _scalars(kind, f'{prefix}{name}.')
        elif isinstance(kind, Primitive | String):
            yield prefix + name


def _least(kind: Kind) -> int:
    """The fewest bytes of a value, without alignment."""
    match kind:
        case Primitive():
            return width_of(kind)
        case String():
            return 4 if kind.wide else 5
        case Sequence():
            return 4
        case Array():
            return kind.length * _least(kind.item)
        case Layout():
            return sum(_least(inner) for _, inner, *_ in kind.fields) or 1


class _Even(NamedTuple):
    """A kind that is nothing but primitives of one width, so that it has no gaps."""

    width: int
    leaves: tuple[str, ...]


def _even(kind: Kind) -> _Even | None:
    """None also where a bool asks for a look at its value, and where names would fill memory."""
    if _least(kind) > _EVEN_BYTES:
        return None
    match kind:
        case Primitive():
            return None if kind == _BOOL else _Even(width_of(kind), ('',))
        case Array():
            named = [(f'[{i}]', kind.item) for i in range(kind.length)]
        case Layout():
            named = [(f'.{name}', inner) for name, inner, *_ in kind.fields]
        case _:
            return None
    parts = [(name, _even(inner)) for name, inner in named]
    leaves = [name + leaf for name, part in parts if part for leaf in part.leaves]
    widths = {part.width if part else None for _, part in parts}
    width = widths.pop() if len(widths) == 1 else None
    return _Even(width, tuple(leaves)) if width else None


@dataclass(slots=True)
class _Code:
    """The source of one function, written field by field in the order of the bytes.

    In that source, `at` is an index into the value. The next field begins at `at + ahead`,
    which is known to be `rest` modulo `modulus`, counted from behind the header.
    `pieces` lie before it and are not yet compared with the size of the value.
    """

    target: str | None = None
    done: bool = False
    lines: list[str] = field(default_factory=list)
    names: dict[str, Any] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    loops: int = 0
    ahead: int = 0
    modulus: int = 8
    rest: int = 0

    def compile(self, type_name: str) -> Callable[[bytes], Any]:
        scope = {**TOOLS, **self.names}
        code = compiled('\n'.join([_HEAD, *self.lines]), type_name)
        exec(code, scope)  # noqa: S102 -- our own text, see above
        function: Callable[[bytes], Any] = scope['walk']
        return function

    def close(self) -> None:
        self._compare()
        self._line(f'return {_after(self.ahead)}')

    def message(self, layout: Layout, path: str = '') -> None:
        for name, kind, *_ in layout.fields:
            if not self.done:
                self._field(kind, f'{path}.{name}' if path else name)
        if not layout.fields:
            self._fixed(path or layout.type_name, 1)

    def _field(self, kind: Kind, path: str) -> None:
        match kind:
            case Primitive():
                self._primitive(kind, path)
            case String():
                self._string(kind, path)
            case Array():
                self._array(kind, path)
            case Sequence():
                self._sequence(kind, path)
            case Layout():
                self.message(kind, path)

    def _primitive(self, kind: Primitive, path: str) -> None:
        self._fixed(path, width_of(kind))
        if kind == _BOOL:
            self._bools(path, self.ahead - 1, 1)
        if path == self.target:
            self._compare()
            read = self._name(by_order(PRIMITIVES[kind.name]))
            self._line(f'return {read}[value[1]](value, {_after(self.ahead - width_of(kind))})[0]')
            self.done = True

    def _string(self, kind: String, path: str) -> None:
        self._length(path)
        self._bound(path, kind, 'units' if kind.wide else 'bytes')
        text = f'{"wide" if kind.wide else "narrow"}(value, at, stop, {self._place(path)})'
        if kind.wide:
            self._line('stop = at + 4 * n')
            self._line(text)
        else:
            self._line('stop = at + n')
            self._line('if value.find(0, at, stop) != stop - 1 or not value[at:stop].isascii():')
            self._line(f'    {text}')
        if path == self.target:
            self._line(f'return {text if kind.wide else "value[at:stop - 1].decode()"}')
            self.done = True
            return
        self._line('at = stop')
        self._know(4 if kind.wide else 1)

    def _array(self, kind: Array, path: str) -> None:
        even = _even(kind.item)
        if even:
            self._fixed(path, even.width, even.leaves, kind.length * len(even.leaves))
        elif kind.item == _BOOL:
            self._fixed(path, 1, ('',), kind.length)
            self._bools(path, self.ahead - kind.length, kind.length)
        else:
            self._loop(str(kind.length), kind.item, path)

    def _sequence(self, kind: Sequence, path: str) -> None:
        self._length(path)
        self._bound(path, kind, 'items')
        even = _even(kind.item)
        if even or kind.item == _BOOL:
            self._items(even or _Even(1, ('',)), path)
        else:
            self._line(f'if n * {_least(kind.item)} > size - at:')
            self._line(f'    raise too_many(n, size - at, at, {self._place(path)})')
            self._loop('n', kind.item, path)
        if kind.item == _BOOL:
            self._line('if value[at - n:at].translate(None, BOOLS):')
            self._line(f'    raise not_bool(value, at - n, n, {self._place(path)})')

    def _items(self, even: _Even, path: str) -> None:
        """The `n` items of a sequence, as one step."""
        bytes_each = even.width * len(even.leaves)
        if even.width == 8:
            # An empty sequence is not followed by the alignment of its items.
            self._line('if n:')
            self._line(f'    at = {_aligned(0, 8)}')
        self._line(f'at += n * {bytes_each}')
        piece = self._name(Piece(path, 0, even.width, even.leaves, 0))
        self._line('if at > size:')
        start = f'at - n * {bytes_each}'
        self._line(f'    raise short(size, {start}, [{piece}], {self._indices()}, n)')
        self._know(min(even.width, 4))

    def _loop(self, times: str, item: Kind, path: str) -> None:
        self._move()
        # Where an item begins depends on the items before it.
        self._know(1)
        self._line(f'for i{self.loops} in range({times}):')
        self.loops += 1
        self._field(item, f'{path}[{{{self.loops - 1}}}]')
        self._move()
        self.loops -= 1
        self._know(1)

    def _length(self, path: str) -> None:
        """Leaves the length of a string or sequence in `n`, and `at` behind it."""
        self._fixed(path, 4)
        self._compare()
        self._line(f'n = u32(value, {_after(self.ahead - 4)})[0]')
        self._move()

    def _bound(self, path: str, kind: String | Sequence, unit: str) -> None:
        if kind.bound is None:
            return
        # The length of a string counts its NUL.
        extra = int(unit == 'bytes')
        self._line(f'if n > {kind.bound + extra}:')
        found = f'n - {extra}, {kind.bound}, "{unit}"'
        self._line(f'    raise over_bound({found}, at - 4, {self._place(path)})')

    def _fixed(
        self, path: str, width: int, leaves: tuple[str, ...] | None = None, count: int = 1
    ) -> None:
        self._align(width)
        self.pieces.append(Piece(path, self.ahead, width, leaves, count))
        self.ahead += width * count
        self.rest = (self.rest + width * count) % self.modulus

    def _align(self, width: int) -> None:
        if width <= self.modulus:
            gap = -self.rest % width
            self.ahead += gap
            self.rest = (self.rest + gap) % self.modulus
            return
        self._compare()
        self._line(f'at = {_aligned(self.ahead, width)}')
        self._know(width)

    def _bools(self, path: str, offset: int, count: int) -> None:
        self._compare()
        start = _after(offset)
        bad = f'value[{start}:{start} + {count}].translate(None, BOOLS)'
        self._line(f'if {bad if count > 1 else f"value[{start}] > 1"}:')
        self._line(f'    raise not_bool(value, {start}, {count}, {self._place(path)})')

    def _compare(self) -> None:
        """Holds all pieces against the size of the value, at once."""
        if self.pieces:
            self._line(f'if {_after(self.ahead)} > size:')
            pieces = self._name(tuple(self.pieces))
            self._line(f'    raise short(size, at, {pieces}, {self._indices()})')
            self.pieces.clear()

    def _move(self) -> None:
        self._compare()
        if self.ahead:
            self._line(f'at += {self.ahead}')
            self.ahead = 0

    def _know(self, modulus: int) -> None:
        """From here on, only this is known of `at`: it is aligned to `modulus`."""
        self.ahead, self.modulus, self.rest = 0, modulus, 0

    def _line(self, text: str) -> None:
        self.lines.append('    ' * (self.loops + 1) + text)

    def _name(self, constant: object) -> str:
        name = f'c{len(self.names)}'
        self.names[name] = constant
        return name

    def _indices(self) -> str:
        return '(' + ''.join(f'i{loop}, ' for loop in range(self.loops)) + ')'

    def _place(self, path: str) -> str:
        return f'{self._name(path)}, {self._indices()}'


def _after(offset: int) -> str:
    return f'at + {offset}' if offset else 'at'


def _aligned(offset: int, width: int) -> str:
    # The 4 bytes of the header do not count, and matter from a width of 8 on.
    if width == 8:
        return f'({_after(offset + 3)} & -8) + 4'
    return f'{_after(offset + width - 1)} & -{width}'


_HEAD: Final = """
def walk(value):
    size = len(value)
    if size < 4 or value[0] or value[1] > 1:
        raise bad_header(value)
    u32 = u32_by_order[value[1]]
    at = 4
"""
