"""Functions that walk over the CDR bytes of a message, made from the layout of its type.

They validate it without making an object of any field. Neighbouring fields of fixed size share
one comparison.
"""

import difflib
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.generated import Run, Source, visit
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
    walk = _Walk(layout)
    walk.compare()
    walk.source.line(f'return {_after(walk.run.size)}')
    return walk.function()


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
    return _Walk(layout, path).function()


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


def _even_item(kind: Kind) -> _Even | None:
    """Of a list: bools are looked at behind it, all at once."""
    return _Even(1, ('',)) if kind == _BOOL else _even(kind)


class _Walk:
    """Writes the source of one function, field by field in the order of the bytes.

    `pieces` are the primitives of the run that are not yet compared with the size of the value.
    """

    def __init__(self, layout: Layout, target: str | None = None) -> None:
        self.source = Source(layout.type_name)
        self.run = Run(self.source, self.compare)
        self.target = target
        self.done = False
        self.pieces: list[Piece] = []
        self.message(layout, '')

    def function(self) -> Callable[[bytes], Any]:
        return self.source.function(_HEAD, TOOLS)

    def message(self, layout: Layout, path: str) -> None:
        for name, kind, *_ in layout.fields:
            if not self.done:
                visit(self, kind, f'{path}.{name}' if path else name)
        if not layout.fields:
            self._fixed(path or layout.type_name, 1)

    def number(self, kind: Primitive, path: str) -> None:
        offset = self._fixed(path, width_of(kind))
        if kind == _BOOL:
            self._bools(path, offset, 1)
        if path == self.target:
            self.compare()
            read = self.source.constant(by_order(PRIMITIVES[kind.name]))
            self.source.line(f'return {read}[value[1]](value, {_after(offset)})[0]')
            self.done = True

    def text(self, kind: String, path: str) -> None:
        self._length(kind, path, 'units' if kind.wide else 'bytes')
        text = f'{"wide" if kind.wide else "narrow"}(value, at, stop, {self._place(path)})'
        if kind.wide:
            self.source.line('stop = at + 4 * n')
            self.source.line(text)
        else:
            line = 'if value.find(0, at, stop) != stop - 1 or not value[at:stop].isascii():'
            self.source.line('stop = at + n')
            self.source.line(line)
            self.source.line(f'    {text}')
        if path == self.target:
            self.source.line(f'return {text if kind.wide else "value[at:stop - 1].decode()"}')
            self.done = True
            return
        self.source.line('at = stop')
        self.run.know(4 if kind.wide else 1)

    def array(self, kind: Array, path: str) -> None:
        even = _even_item(kind.item)
        if even is None:
            self._loop(str(kind.length), kind.item, path)
            return
        offset = self._fixed(path, even.width, even.leaves, kind.length * len(even.leaves))
        if kind.item == _BOOL:
            self._bools(path, offset, kind.length)

    def sequence(self, kind: Sequence, path: str) -> None:
        self._length(kind, path, 'items')
        even = _even_item(kind.item)
        if even is None:
            self.source.line(f'if n * {_least(kind.item)} > size - at:')
            self.source.line(f'    raise too_many(n, size - at, at, {self._place(path)})')
            self._loop('n', kind.item, path)
            return
        bytes_each = even.width * len(even.leaves)
        self.run.begin_items(even.width, 'n')
        self.source.line(f'at += n * {bytes_each}')
        piece = self.source.constant(Piece(path, 0, even.width, even.leaves, 0))
        start = f'at - n * {bytes_each}'
        self.source.line('if at > size:')
        self.source.line(f'    raise short(size, {start}, [{piece}], {self._indices()}, n)')
        if kind.item == _BOOL:
            self.source.line('if value[at - n:at].translate(None, BOOLS):')
            self.source.line(f'    raise not_bool(value, at - n, n, {self._place(path)})')

    def _loop(self, times: str, item: Kind, path: str) -> None:
        loops = self.source.depth - 1
        with self.run.loop(f'for i{loops} in range({times}):'):
            visit(self, item, f'{path}[{{{loops}}}]')

    def _length(self, kind: String | Sequence, path: str, unit: str) -> None:
        """Leaves the length of a string or sequence in `n`, and `at` behind it."""
        offset = self._fixed(path, 4)
        self.compare()
        self.source.line(f'n = u32(value, {_after(offset)})[0]')
        self.run.flush()
        if kind.bound is not None:
            # The length of a string counts its NUL.
            extra = int(unit == 'bytes')
            found = f'n - {extra}, {kind.bound}, "{unit}"'
            self.source.line(f'if n > {kind.bound + extra}:')
            self.source.line(f'    raise over_bound({found}, at - 4, {self._place(path)})')

    def _fixed(
        self, path: str, width: int, leaves: tuple[str, ...] | None = None, count: int = 1
    ) -> int:
        offset = self.run.add(width, count)
        self.pieces.append(Piece(path, offset, width, leaves, count))
        return offset

    def _bools(self, path: str, offset: int, count: int) -> None:
        self.compare()
        start = _after(offset)
        bad = f'value[{start}:{start} + {count}].translate(None, BOOLS)'
        self.source.line(f'if {bad if count > 1 else f"value[{start}] > 1"}:')
        self.source.line(f'    raise not_bool(value, {start}, {count}, {self._place(path)})')

    def compare(self) -> None:
        """Holds all pieces against the size of the value, at once."""
        if self.pieces:
            pieces = self.source.constant(tuple(self.pieces))
            self.source.line(f'if {_after(self.run.size)} > size:')
            self.source.line(f'    raise short(size, at, {pieces}, {self._indices()})')
            self.pieces.clear()

    def _indices(self) -> str:
        return '(' + ''.join(f'i{loop}, ' for loop in range(self.source.depth - 1)) + ')'

    def _place(self, path: str) -> str:
        return f'{self.source.constant(path)}, {self._indices()}'


def _after(offset: int) -> str:
    return f'at + {offset}' if offset else 'at'


_HEAD: Final = """
def made(value):
    size = len(value)
    if size < 4 or value[0] or value[1] > 1:
        raise bad_header(value)
    u32 = u32_by_order[value[1]]
    at = 4
"""
