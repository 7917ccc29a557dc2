"""Writing the source of a function that follows the CDR bytes of a message.

The bytes are what ROS 2 sends: a 4-byte encapsulation header (00 00 big endian, 00 01 little
endian, 2 bytes of options), then plain XCDR1. There, a primitive is aligned to its own size,
counted from behind the header.

A layout becomes Python source once, when a route starts: it runs in the loop of the route. rosbags
generates such functions, too, but they make an object of every message and validate less (0.11.9:
a NUL within a text and a bool of 7 pass). Names of fields never become source here, only constants
beside it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeVar

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)

LENGTH: Final = Primitive('uint32')
"""What stands before a string or a sequence."""


@dataclass(slots=True)
class Source:
    """Lines of a function, and the constants that they name.

    Args:
        type_name: Of the message that it follows.
        depth: Of the blocks that the next line stands in.
    """

    type_name: str
    lines: list[str] = field(default_factory=list)
    names: dict[str, Any] = field(default_factory=dict)
    depth: int = 1
    made: int = 0

    def line(self, text: str) -> None:
        """Add a line at the present depth."""
        self.lines.append('    ' * self.depth + text)

    def constant(self, value: object) -> str:
        """Give a constant a name."""
        name = f'c{len(self.names)}'
        self.names[name] = value
        return name

    def variable(self) -> str:
        """A name that no other line has used."""
        self.made += 1
        return f'v{self.made}'

    def function(self, head: str, tools: dict[str, Any]) -> Callable[[Any], Any]:
        """Compile `def made(...)`, which begins with `head`.

        Raises:
            ConfigError: The message type is nested deeper than Python nests its blocks.
        """
        scope = {**tools, **self.names}
        try:
            code = compile('\n'.join([head, *self.lines]), '<format>', 'exec')
        except SyntaxError:
            # A loop for each list, and at most a `try` in it; parentheses for each message.
            problem = f'{self.type_name} is nested too deeply for the bridge'
            limits = 'at most 18 lists of messages within one another, and 100 messages'
            raise ConfigError([f'{problem}: {limits}']) from None
        exec(code, scope)  # noqa: S102 -- our own text, see above
        made: Callable[[Any], Any] = scope['made']
        return made


def _at_aligned(offset: int, width: int) -> str:
    # The 4 bytes of the header do not count, and matter from a width of 8 on.
    if width == 8:
        return f'at = (at + {offset + 3} & -8) + 4'
    return f'at = at + {offset + width - 1} & -{width}'


@dataclass(slots=True)
class Run:
    """Primitives that lie side by side, and are dealt with at once.

    In the source, `at` is where the run begins. The next field begins `size` bytes behind that,
    which is known to be `rest` modulo `modulus`, counted from behind the header.

    Args:
        source: Where its lines go.
        settle: Writes the lines that deal with the run as it is: it compares, reads or writes.
        aligned: The line that goes on from so many bytes behind `at` to a multiple of the width.
        codes: Of the module struct.
    """

    source: Source
    settle: Callable[[], None]
    aligned: Callable[[int, int], str] = _at_aligned
    codes: str = ''
    size: int = 0
    modulus: int = 8
    rest: int = 0

    def add(self, width: int, count: int = 1, code: str = 'x') -> int:
        """Add primitives behind their alignment.

        Args:
            width: Of one of them, in bytes.
            count: How many of them.
            code: Of the module struct.

        Returns:
            Where the first one begins, counted from `at`.
        """
        if width > self.modulus:
            self.settle()
            self.source.line(self.aligned(self.size, width))
            self.know(width)
        gap = -self.rest % width
        offset = self.size + gap
        self.codes += 'x' * gap + f'{count}{code}'
        self.size = offset + width * count
        self.rest = (self.rest + gap + width * count) % self.modulus
        return offset

    def flush(self) -> None:
        """Deal with the run, and begin another one behind it."""
        self.settle()
        if self.size:
            self.source.line(f'at += {self.size}')
        self.begin()

    def begin(self) -> None:
        """Begin anew right behind these primitives."""
        self.codes, self.size = '', 0

    def know(self, modulus: int) -> None:
        """Begin anew where only this is known: it is aligned to `modulus`."""
        self.begin()
        self.modulus, self.rest = modulus, 0

    def begin_items(self, width: int, some: str) -> None:
        """Go on to the primitives of a sequence, whose number was the last of the run.

        Args:
            width: Of one of them, in bytes.
            some: Whether there are any, as an expression.
        """
        if width == 8:
            # An empty sequence is not followed by the alignment of its items.
            self.source.line(f'if {some}: {self.aligned(0, 8)}')
        self.know(min(width, 4))

    @contextmanager
    def loop(self, head: str) -> Iterator[None]:
        """Let the lines that are written within be those of a loop."""
        self.flush()
        # Where an item begins depends on the items before it.
        self.know(1)
        self.source.line(head)
        self.source.depth += 1
        yield
        self.flush()
        self.source.depth -= 1
        self.know(1)


Made_co = TypeVar('Made_co', covariant=True)


class Visitor(Protocol[Made_co]):
    """What is written for the values of a message.

    The text with each says which one it is, as the function that is written needs it: its path for
    who checks, an expression for who writes it; who reads it makes that expression.
    """

    def number(self, kind: Primitive, which: str, /) -> Made_co:
        """A primitive that is no item of a list."""

    def text(self, kind: String, which: str, /) -> Made_co:
        """A string."""

    def array(self, kind: Array, which: str, /) -> Made_co:
        """An array."""

    def sequence(self, kind: Sequence, which: str, /) -> Made_co:
        """A sequence."""

    def message(self, kind: Layout, which: str, /) -> Made_co:
        """A message, with the values in it."""


def visit(visitor: Visitor[Made_co], kind: Kind, which: str = '') -> Made_co:
    """Write what is written for a value of any kind."""
    match kind:
        case Primitive():
            return visitor.number(kind, which)
        case String():
            return visitor.text(kind, which)
        case Array():
            return visitor.array(kind, which)
        case Sequence():
            return visitor.sequence(kind, which)
        case Layout():
            return visitor.message(kind, which)
