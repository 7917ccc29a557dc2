"""Messages of any installed type, filled with what is hard to carry, as rclpy serializes them.

`message_values` is a Hypothesis strategy; `extremes` are a few messages that hold every extreme
value of every kind of field in them. Both give CDR bytes without rclpy's padding behind.
"""

import importlib
import itertools
import math
import random
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Protocol

from hypothesis import settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from ros2_kafka_bridge.formats.cdr import make_exact
from ros2_kafka_bridge.message_types.layout import (
    PRIMITIVES,
    Array,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)
from ros2_kafka_bridge.ros.types import load_type

FEW: Final = settings(max_examples=8)
"""For a test of every type: few examples."""

_FLOATS: Final = (math.nan, math.inf, -math.inf, -0.0, 0.0, 0.1, 5e-324, -sys.float_info.min)
_FLOAT32_MAX: Final = (2 - 2**-23) * 2.0**127
_TEXTS: Final = (
    '',
    'x',
    'äßж日',
    '𝄞😀\U0010ffff',
    '"\\/\b\f\n\r\t\x01\x1f\x7f\x80',
    # Not in front: there, rclpy drops it from a wstring that it reads.
    'x\ufeff\u2028\u2029\ud7ff\ue000\uffff',
    'null',
    'x' * 200,
)


def _bounds(name: str) -> tuple[int, int]:
    bits = 8 * struct.calcsize('<' + PRIMITIVES[name])
    return (
        (0, 2**bits - 1)
        if PRIMITIVES[name].isupper()
        else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )


def _extremes_of(name: str) -> tuple[Any, ...]:
    match name:
        case 'bool':
            return (True, False)
        case 'float64':
            return (*_FLOATS, sys.float_info.max, -sys.float_info.max, 2.0**53 + 2)
        case 'float32':
            tiny = (1.401298464324817e-45, -1.1754943508222875e-38)
            return (*_FLOATS[:5], *tiny, _FLOAT32_MAX, -_FLOAT32_MAX, 0.10000000149011612)
        case 'int64' | 'uint64':
            low, high = _bounds(name)
            return (low, high, 2**53 + 1, -1 if low else 2**63, 0, low + 1, high - 1)
        case _:
            return (*_bounds(name), 0, 1)


EXTREMES: Final[Mapping[str, tuple[Any, ...]]] = MappingProxyType(
    {'text': _TEXTS, **{name: _extremes_of(name) for name in PRIMITIVES}}
)
"""What is hard to carry, by the name of a primitive, and `text` for strings."""


@lru_cache
def layout_of(name: str) -> Layout:
    """The layout of an installed type."""
    return load_type(name).layout


def new_message(name: str, /, **fields: Any) -> Any:
    """A message of rclpy's own class."""
    package, _, short = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), short)(**fields)


def cdr_of(message: Any, name: str) -> bytes:
    """A message as rclpy serializes it, without the padding behind, and with zeros for gaps.

    rclpy leaves what memory held in the gaps of alignment between the fields.
    """
    value = bytearray(exact_of(name)(bytes(serialize_message(message))))
    writer = Writer('<')
    expected = writer.value_of(message, layout_of(name))
    for gap in writer.gaps:
        value[gap] = bytes(gap.stop - gap.start)
    assert value == expected, name
    return expected


def cdr(name: str, /, **fields: Any) -> bytes:
    """The CDR bytes of a message with these fields; the others are as rclpy makes them."""
    return cdr_of(new_message(name, **fields), name)


@lru_cache
def exact_of(name: str) -> Callable[[bytes], bytes]:
    """What cuts off padding."""
    return make_exact(layout_of(name))


class Source(Protocol):
    """Where the values of a message come from."""

    def number(self, name: str) -> Any:
        """A bool, int or float."""
        ...

    def text(self) -> str:
        """Without NUL and without unpaired surrogates."""
        ...

    def length(self, most: int | None) -> int:
        """Of a sequence or, with a bound, how much of it."""
        ...


def filled(name: str, source: Source) -> Any:
    """A message of rclpy's own class, filled."""
    return _message(layout_of(name), source)


def _message(layout: Layout, source: Source) -> Any:
    message = new_message(layout.type_name)
    for one in layout.fields:
        setattr(message, one.name, value_of(one.kind, source))
    return message


def value_of(kind: Kind, source: Source, make: Callable[[Layout, Source], Any] = _message) -> Any:
    """A value of any kind; `make` makes messages."""

    def inner(kind: Kind) -> Any:
        return value_of(kind, source, make)

    match kind:
        case Primitive('byte'):
            return bytes([source.number('byte')])
        case Primitive():
            return source.number(kind.name)
        case String():
            return _fitting(source.text(), kind)
        case Array():
            return [inner(kind.item) for _ in range(kind.length)]
        case Sequence():
            return [inner(kind.item) for _ in range(source.length(kind.bound))]
        case Layout():
            return make(kind, source)


def _fitting(text: str, kind: String) -> str:
    if kind.bound is None:
        return text
    if kind.wide:
        return text.encode('utf-16-le')[: 2 * kind.bound].decode('utf-16-le', 'ignore')
    return text.encode()[: kind.bound].decode(errors='ignore')


class _Extremes:
    """Deals all extremes of each kind in turn, on and on."""

    def __init__(self) -> None:
        self._turns: dict[object, tuple[itertools.cycle[Any], list[int]]] = {}

    def number(self, name: str) -> Any:
        return self._next(name, EXTREMES[name])

    def text(self) -> str:
        text: str = self._next('text', EXTREMES['text'])
        return text

    def length(self, most: int | None) -> int:
        # 3 and 1 in turn, so that what follows lies at different places.
        length: int = self._next(('length', most), (3 if most is None else most, 0, 1))
        return length

    def _next(self, key: object, values: tuple[Any, ...]) -> Any:
        turn, left = self._turns.setdefault(key, (itertools.cycle(values), [len(values)]))
        left[0] -= 1
        return next(turn)

    @property
    def done(self) -> bool:
        """Whether all of each kind that was asked for have been dealt."""
        return all(left[0] <= 0 for _, left in self._turns.values())


@lru_cache
def extremes(name: str) -> tuple[bytes, ...]:
    """Messages that together hold every extreme of every kind of field in the type.

    At most 12: a kind of field that stands in many places has all of its extremes sooner.
    """
    source = _Extremes()
    values: list[bytes] = []
    while not values or not source.done:
        values.append(cdr_of(filled(name, source), name))
        assert len(values) <= 30, name
    return tuple(values)


class _Dealt:
    """Deals a handful of values over all fields, at random."""

    def __init__(self, hand: Mapping[str, list[Any]], seed: int) -> None:
        self._hand = hand
        self._random = random.Random(seed)  # noqa: S311 -- repeatable

    def number(self, name: str) -> Any:
        return self._random.choice(self._hand[name])

    def text(self) -> str:
        text: str = self._random.choice(self._hand['text'])
        return text

    def length(self, most: int | None) -> int:
        return self._random.randint(0, 3 if most is None else min(most, 5))


def message_values(name: str) -> st.SearchStrategy[bytes]:
    """CDR bytes of messages of one type, as rclpy serializes them.

    Hypothesis draws a handful of values for each kind of field, and one seed deals them over the
    fields: a large message costs as few draws as a small one.
    """
    hands = {leaf: st.lists(_leaf(leaf), min_size=1, max_size=4) for leaf in _leaves(name)}
    dealt = st.builds(_Dealt, st.fixed_dictionaries(hands), st.integers(0, 2**16))
    return dealt.map(lambda source: cdr_of(filled(name, source), name))


def _leaf(name: str) -> st.SearchStrategy[Any]:
    match name:
        case 'bool':
            return st.booleans()
        case 'text':
            letters = st.characters(exclude_characters='\0', exclude_categories=['Cs'])
            return st.sampled_from(_TEXTS) | st.text(letters, max_size=20)
        case 'float32' | 'float64':
            # One NaN stands for all: its other bits are nobody's to carry.
            numbers = st.floats(width=32 if name == 'float32' else 64, allow_nan=False)
            return st.sampled_from(EXTREMES[name]) | numbers
        case _:
            return st.sampled_from(EXTREMES[name]) | st.integers(*_bounds(name))


def _leaves(name: str) -> list[str]:
    return sorted(set(_leaves_of(layout_of(name))))


def _leaves_of(kind: Kind) -> Iterator[str]:
    match kind:
        case Primitive():
            yield kind.name
        case String():
            yield 'text'
        case Array() | Sequence():
            yield from _leaves_of(kind.item)
        case Layout():
            for one in kind.fields:
                yield from _leaves_of(one.kind)


def cuts(value: bytes, most: int = 200) -> Iterator[bytes]:
    """The value cut short at every byte; at `most` places where it is longer."""
    step = max(1, len(value) // most)
    return (value[:size] for size in range(0, len(value), step))


class Writer:
    """Writes XCDR1 value by value, in either byte order: slow, and by no code of the bridge.

    Args:
        order: `<` or `>`, as in the module struct.
    """

    def __init__(self, order: str) -> None:
        self.gaps: list[slice] = []
        self._order = order
        self._body = bytearray()

    def value_of(self, message: Any, layout: Layout) -> bytes:
        """The whole value, header included; `gaps` are the places of alignment in it."""
        self._put(layout, message)
        return (b'\0\1\0\0' if self._order == '<' else b'\0\0\0\0') + self._body

    def _numbers(self, code: str, numbers: Any) -> None:
        gap = -len(self._body) % struct.calcsize('<' + code)
        if gap:
            self.gaps.append(slice(len(self._body) + 4, len(self._body) + 4 + gap))
        self._body += bytes(gap) + struct.pack(f'{self._order}{len(numbers)}{code}', *numbers)

    def _put(self, kind: Kind, value: Any) -> None:
        match kind:
            case Primitive():
                self._many(kind, [value])
            case String():
                self._text(kind, value)
            case Array():
                self._many(kind.item, value)
            case Sequence():
                self._numbers('I', [len(value)])
                self._many(kind.item, value)
            case Layout():
                for one in kind.fields:
                    self._put(one.kind, getattr(value, one.name))
                if not kind.fields:
                    self._numbers('B', [0])

    def _many(self, kind: Kind, values: Any) -> None:
        if not isinstance(kind, Primitive):
            for value in values:
                self._put(kind, value)
        elif len(values):
            numbers = [value[0] for value in values] if kind.name == 'byte' else values
            self._numbers(PRIMITIVES[kind.name], numbers)

    def _text(self, kind: String, value: str) -> None:
        if kind.wide:
            units = struct.iter_unpack('<H', value.encode('utf-16-le'))
            self._put(Sequence(Primitive('uint32')), [unit for (unit,) in units])
        else:
            content = value.encode() + b'\0'
            self._numbers('I', [len(content)])
            self._body += content


def big_endian(value: bytes, name: str) -> bytes:
    """The same message in the other byte order."""
    message = deserialize_message(value, type(new_message(name)))
    return Writer('>').value_of(message, layout_of(name))


ALPHABET = 'abc xyz_09/äßж日𝄞'


def random_message(type_name: str, seed: int) -> Any:
    return filled(type_name, RandomSource(seed))


class RandomSource:
    """Numbers that are equal to themselves, and short texts."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)  # noqa: S311 -- repeatable

    def number(self, name: str) -> Any:
        if name == 'bool':
            return self.random.random() < 0.5
        if name in {'float32', 'float64'}:
            return self.random.randint(-1000, 1000) / 4
        code = '<' + PRIMITIVES[name]
        return struct.unpack(code, self.random.randbytes(struct.calcsize(code)))[0]

    def text(self) -> str:
        return ''.join(self.random.choices(ALPHABET, k=self.random.randint(0, 6)))

    def length(self, most: int | None) -> int:
        return self.random.randint(0, 3 if most is None else min(3, most))
