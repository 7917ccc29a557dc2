"""What `${...}` in a value stands for: a variable of the environment, or the text of a file."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

from ros2_kafka_bridge.config.tree import UNFIT, LocatedMistake
from ros2_kafka_bridge.outside.files import UnreadableError, read_regular

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

EXPANDED_LIMIT_CHARS = 16 * 1024 * 1024
"""Characters that the references of one configuration stand for, all together."""

_REFERENCE = re.compile(r'\$(\$(?=\{)|\{([A-Za-z_][A-Za-z0-9_]*)\}|\{file:([^{}]+)\}|\{)')


class Expanded(NamedTuple):
    """Values without references, and what is wrong with the references."""

    data: Any
    mistakes: list[LocatedMistake]


def expand(data: Any, environ: Mapping[str, str], directory: Path) -> Expanded:
    """Replace `${NAME}` and `${file:PATH}` in every text, and `$${` by a literal `${`.

    Args:
        data: Values of a file, as YAML gives them.
        environ: What `${NAME}` is read from.
        directory: What the path in `${file:PATH}` is relative to.
    """
    reader = _Reader(environ, directory)
    return Expanded(reader.expanded(data, ()), reader.mistakes)


class _Reader:
    """Replaces the references of one configuration; each file is read once."""

    def __init__(self, environ: Mapping[str, str], directory: Path) -> None:
        self.mistakes: list[LocatedMistake] = []
        self._environ = environ
        self._directory = directory
        self._texts: dict[str, str | UnreadableError] = {}
        self._room_chars = EXPANDED_LIMIT_CHARS

    def expanded(self, value: Any, path: tuple[str | int, ...]) -> Any:
        if isinstance(value, dict):
            return {name: self.expanded(item, (*path, name)) for name, item in value.items()}
        if isinstance(value, list):
            return [self.expanded(item, (*path, place)) for place, item in enumerate(value)]
        if isinstance(value, str) and '$' in value:
            return _REFERENCE.sub(lambda match: self._replaced(match, path), value)
        return value

    def _replaced(self, match: re.Match[str], path: tuple[str | int, ...]) -> str:
        found, variable, file = match.groups()
        if found == '$':
            return '$'
        if variable is None and file is None:
            wrong = '${ without a name and }: a variable is ${NAME}, a file ${file:PATH}'
            self.mistakes.append(LocatedMistake(path, wrong))
        elif variable is not None and UNFIT.search(self._environ.get(variable, '')):
            self.mistakes.append(LocatedMistake(path, f'the variable {variable} is not UTF-8'))
        elif variable is not None and variable in self._environ:
            return self._within_room(self._environ[variable], path)
        elif variable is not None:
            self.mistakes.append(
                LocatedMistake(path, f'the environment has no variable {variable}')
            )
        else:
            text = self._text(file)
            if isinstance(text, str):
                return self._within_room(text, path)
            self.mistakes.append(
                LocatedMistake(path, f'the file {self._directory / file}: {text}')
            )
        return match[0]

    def _within_room(self, text: str, path: tuple[str | int, ...]) -> str:
        """The text, or nothing once all of them together are too long: one may come often."""
        room_chars, self._room_chars = self._room_chars, self._room_chars - len(text)
        if len(text) <= room_chars:
            return text
        if room_chars >= 0:
            much = f'what ${{...}} stands for has more than {EXPANDED_LIMIT_CHARS} characters'
            self.mistakes.append(LocatedMistake(path, f'{much} in this file, all together'))
        return ''

    def _text(self, file: str) -> str | UnreadableError:
        if file not in self._texts:
            try:
                self._texts[file] = _text_of(self._directory / file)
            except UnreadableError as error:
                self._texts[file] = error
        return self._texts[file]


def _text_of(path: Path) -> str:
    """The text of a file without the newline that editors and `echo` put at its end."""
    try:
        text = read_regular(path).decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise UnreadableError('not UTF-8: it holds no text') from error
    text = text.removesuffix('\n').removesuffix('\r')
    if not text:
        raise UnreadableError('it is empty')
    if UNFIT.search(text):
        raise UnreadableError('it holds a NUL: it is no text')
    return text
