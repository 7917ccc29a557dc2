"""YAML 1.2 to plain values with the line of each, bounded, and without its values in errors."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, ScalarEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

VALUE_LIMIT = 50_000
TEXT_LIMIT_CHARS = 4 * 1024 * 1024
DEPTH_LIMIT = 50

Path = tuple[str | int, ...]

_CORE = 'tag:yaml.org,2002:'
_TAGS = frozenset(_CORE + kind for kind in ('str', 'int', 'float', 'bool', 'null', 'map', 'seq'))
_NUMBERS = frozenset({_CORE + 'int', _CORE + 'float'})
_READ_AS_TEXT = frozenset({_CORE + 'timestamp', _CORE + 'merge', _CORE + 'value'})

_NUMBER_CHARS = 400
# Libraries of C see the end of a text in a NUL; half of a pair of UTF-16 is no text at all.
UNFIT = re.compile('[\0\ud800-\udfff]')
"""What no text of a configuration may hold."""

_TOO_DEEP = 'nested too deeply for a configuration'
_EACH_TIME = 'aliases counted each time'
_NAME_OF_MANY = 'a list or mapping as the name of a field'

# ruamel's own words can quote the text, which may be a secret.
_WORDS = {
    'found undefined alias': "an alias (*name) without its anchor; a text with '*' needs quotes",
    'could not find expected': "a field without ':'",
    'mapping values are not allowed here': "a ':' out of place; a text with ': ' needs quotes",
    'cannot start any token': 'a character that can begin no value; such a text needs quotes',
    'expected <block end>': 'a line that does not fit the indentation around it',
    "expected ',' or": "a ',' or a closing bracket is missing",
    'but found another document': 'more than one document: a file holds one configuration',
    'tag handle': "a tag (!name); a text that begins with '!' needs quotes",
    'while scanning a quoted scalar': 'a quote without its partner',
    'found unexpected end of stream': 'a quote without its partner',
    'found unknown escape': "an unknown escape after '\\' in double quotes",
}


class YamlError(Exception):
    """The text is not YAML, or more than a configuration can be; line and column from 1."""

    def __init__(self, text: str, line: int, column: int = 1) -> None:
        super().__init__(text)
        self.line = line
        self.column = column


class LocatedMistake(NamedTuple):
    """A mistake at a field; line 0 where the field tells it."""

    path: Path
    text: str
    line: int = 0


@dataclass(slots=True)
class Tree:
    """What a text holds: plain values, where they stand, and repeated fields."""

    data: Any = None
    lines: dict[Path, int] = field(default_factory=dict)
    mistakes: list[LocatedMistake] = field(default_factory=list)

    def line_of(self, path: Path) -> int:
        """The line, from 1, of a field or else of the nearest one around it."""
        places = (path[:length] for length in range(len(path), -1, -1))
        return next((self.lines[place] for place in places if place in self.lines), 1)


def read_yaml(text: str) -> Tree:
    """The values in a text.

    Raises:
        YamlError: It is not YAML, or it holds more than a configuration can be.
    """
    yaml = YAML(typ='safe', pure=True)
    yaml.Composer = _BoundedComposer
    yaml.composer.warn_double_anchors = False
    try:
        root = yaml.compose(text)
    except MarkedYAMLError as error:
        raise _plain(error) from None
    except ReaderError as error:
        raise YamlError(
            'a character that no text has', text.count('\n', 0, error.position) + 1
        ) from None
    except (YAMLError, ValueError, OverflowError):
        raise YamlError('not YAML', yaml.reader.line + 1) from None
    reader = _Reader(yaml)
    if root is not None:
        reader.tree.data = reader.value(root, ())
    return reader.tree


def _plain(error: MarkedYAMLError) -> YamlError:
    said = f'{error.context} {error.problem}'
    words = next((words for part, words in _WORDS.items() if part in said), 'not readable here')
    mark = error.problem_mark or error.context_mark
    return YamlError(f'not YAML: {words}', *((mark.line + 1, mark.column + 1) if mark else (1, 1)))


class _BoundedComposer(Composer):
    """Refuses a text at the value that is one too many, before it has read what follows."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self._count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The node that is next: a field's name where it has no index in a mapping."""
        event = self.parser.peek_event()
        is_name = isinstance(parent, MappingNode) and index is None
        if is_name and not isinstance(event, ScalarEvent | AliasEvent):
            raise _refusal(event, _NAME_OF_MANY)
        self._count += not is_name
        if self._count > VALUE_LIMIT:
            raise _too_many(event)
        if not is_name and self.depth > DEPTH_LIMIT:
            raise _refusal(event, _TOO_DEEP)
        return super().compose_node(parent, index)


class _Reader:
    """Builds the values of one text."""

    def __init__(self, yaml: YAML) -> None:
        self.tree = Tree()
        self._constructor = yaml.constructor
        self._count = self._chars = 0

    def value(self, node: Node, path: Path) -> Any:
        """The value of a node; an alias is read again each time, which the limit bounds."""
        self._count_value(node)
        if len(path) > DEPTH_LIMIT:
            raise _refusal(node, _TOO_DEEP)
        self.tree.lines.setdefault(path, node.start_mark.line + 1)
        if isinstance(node, MappingNode):
            return self._mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.value(item, (*path, place)) for place, item in enumerate(node.value)]
        return self._scalar(node)

    def _count_value(self, node: Node) -> None:
        self._count += 1
        if self._count > VALUE_LIMIT:
            raise _too_many(node)

    def _text(self, node: Node) -> str:
        """The text of a name or value, which the limit bounds as often as it is read."""
        text = str(node.value)
        self._chars += len(text)
        if self._chars > TEXT_LIMIT_CHARS:
            raise _refusal(node, f'more than {TEXT_LIMIT_CHARS} characters, {_EACH_TIME}')
        if UNFIT.search(text):
            raise _refusal(node, 'a NUL, or a character that is none (\\0, \\ud800)')
        return text

    def _mapping(self, node: MappingNode, path: Path) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key, item in node.value:
            if not isinstance(key, ScalarNode):
                raise _refusal(key, _NAME_OF_MANY)
            name, line = self._text(key), key.start_mark.line + 1
            if name in values:
                self._count_value(key)
                first = self.tree.lines[(*path, name)]
                text = f'is there twice, first on line {first}'
                self.tree.mistakes.append(LocatedMistake((*path, name), text, line))
                continue
            self.tree.lines[(*path, name)] = line
            values[name] = self.value(item, (*path, name))
        return values

    def _scalar(self, node: Node) -> Any:
        tag, text = str(node.tag), self._text(node)
        if tag in _READ_AS_TEXT:
            return text
        if tag not in _TAGS:
            raise _refusal(node, "a tag (!name); a text that begins with '!' needs quotes")
        if tag in _NUMBERS and len(text) > _NUMBER_CHARS:
            raise _refusal(node, f'a number of more than {_NUMBER_CHARS} characters')
        try:
            return self._constructor.construct_object(node)
        except (YAMLError, ValueError, ArithmeticError, LookupError):
            raise _refusal(node, 'a value that does not fit its tag') from None


def _too_many(place: Any) -> YamlError:
    return _refusal(place, f'more than {VALUE_LIMIT} values, {_EACH_TIME}')


def _refusal(place: Any, text: str) -> YamlError:
    """The error at a node, or at the event that one would be made of."""
    return YamlError(text, place.start_mark.line + 1, place.start_mark.column + 1)
