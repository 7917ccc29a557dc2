"""Writing the source of a function that follows the bytes of a message.

Names of fields never become source, only constants beside it.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from types import CodeType
from typing import Any

from ros2_kafka_bridge.errors import ConfigError


@dataclass(slots=True)
class Source:
    """Lines of a function, and the constants that they name.

    Args:
        type_name: Of the message that it follows.
    """

    type_name: str = 'the message type'
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
        """Compile `def made(...)`, whose first line is `head`.

        Raises:
            ConfigError: The message type is nested deeper than Python nests its blocks.
        """
        scope = {**tools, **self.names}
        code = compiled('\n'.join([head, *self.lines]), self.type_name)
        exec(code, scope)  # noqa: S102 -- our own text, see above
        made: Callable[[Any], Any] = scope['made']
        return made


def compiled(source: str, type_name: str) -> CodeType:
    """Compile our own source, which follows a message type.

    Raises:
        ConfigError: The message type is nested deeper than Python nests its blocks.
    """
    try:
        return compile(source, '<format>', 'exec')
    except SyntaxError:
        # A loop for each list, and at most a `try` in it; parentheses for each message.
        problem = f'{type_name} is nested too deeply for the bridge'
        limits = 'at most 18 lists of messages within one another, and 100 messages'
        raise ConfigError([f'{problem}: {limits}']) from None


@dataclass(slots=True)
class Run:
    """Primitives that lie side by side: one call of the module struct.

    What is known of its beginning: it is `rest` modulo `modulus`, counted from behind the header.
    """

    order: str = '<'
    codes: str = ''
    size: int = 0
    values: int = 0
    modulus: int = 8
    rest: int = 0

    def fits(self, width: int) -> bool:
        """Whether it is known how many bytes of alignment such a primitive needs."""
        return width <= self.modulus

    def add(self, code: str, width: int, count: int = 1, *, values: int | None = None) -> int:
        """Add primitives behind their alignment.

        Args:
            code: Of the module struct.
            width: Of one of them, in bytes.
            count: How many of them.
            values: How many values the code takes in all; one for each primitive without it.

        Returns:
            Number of the first value among those of the run.
        """
        gap = -self.rest % width
        self.codes += f'{gap}x' * bool(gap) + (f'{count}{code}' if count != 1 else code)
        first = self.values
        self.size += gap + width * count
        self.values += count if values is None else values
        self.rest = (self.rest + gap + width * count) % self.modulus
        return first

    def compiled(self) -> struct.Struct:
        """The run as one struct."""
        return struct.Struct(self.order + self.codes)

    def know(self, modulus: int) -> None:
        """Begin anew where only this is known: it is aligned to `modulus`."""
        self.codes, self.size, self.values = '', 0, 0
        self.modulus, self.rest = modulus, 0

    def go_on(self) -> None:
        """Begin anew right behind these primitives."""
        self.codes, self.size, self.values = '', 0, 0
