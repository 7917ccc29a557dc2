"""Files that people write in YAML: their values, and where each one stands, for good errors."""

import re
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

_WHERE = re.compile(r' - at `\$(?P<path>.*)`$')
_STEP = re.compile(r'\.([^.\[\]]+)|\[(\d+)\]')
_TEXT: Final = 'tag:yaml.org,2002:str'
_MERGE: Final = 'tag:yaml.org,2002:merge'
_MOST: Final = 10**15  # a whole number up to which nothing is rounded on its way
_UNKNOWN = re.compile(r'unknown field `(?P<field>.*?)`')


class FileError(ValueError):
    """A file that cannot be used: says which file, line and field, and what would be right."""


class YamlFile(NamedTuple):
    """The values of a file, and the line of each."""

    path: Path
    data: Any
    lines: dict[tuple[str | int, ...], int]

    def names(self, *field: str | int) -> tuple[str, ...]:
        """The names in the mapping at `field`, in their order; none if it is not there.

        Raises:
            FileError: It is no mapping.
        """
        value = self._at(field)
        if value is None:
            return ()
        if not isinstance(value, dict):
            raise self.error('must be a mapping (name: value)', *field)
        return tuple(str(name) for name in value)

    def value(self, kind: Any, *field: str | int) -> Any:
        """The value at `field`, as `kind`: a Struct that forbids unknown fields, for example.

        Raises:
            FileError: It is something else.
        """
        try:
            return msgspec.convert(self._at(field), kind)
        except msgspec.ValidationError as error:
            raise self._said(str(error), field, kind) from None

    def error(self, text: str, *field: str | int) -> FileError:
        """An error at a field, to be raised."""
        places = (field[:length] for length in range(len(field), -1, -1))
        line = next((self.lines[place] for place in places if place in self.lines), 1)
        name = f'{_spelled(field)}: ' if field else ''
        return FileError(f'{self.path}, line {line}: {name}{text}')

    def _at(self, field: tuple[str | int, ...]) -> Any:
        value = self.data
        for step in field:
            if isinstance(value, dict):
                value = value.get(step)
            else:
                value = value[step] if isinstance(value, list) and isinstance(step, int) else None
        return value

    def _said(self, text: str, field: tuple[str | int, ...], kind: Any) -> FileError:
        where = _WHERE.search(text)
        steps = _STEP.findall(where['path']) if where else []
        place = (*field, *(name or int(number) for name, number in steps))
        words = _WHERE.sub('', text)
        if unknown := _UNKNOWN.search(words):
            known = [item.name for item in msgspec.structs.fields(kind)]
            near = get_close_matches(unknown['field'], known, 1)
            meant = f'did you mean {near[0]}?' if near else f'there are {", ".join(known)}'
            return self.error(f'unknown field; {meant}', *place, unknown['field'])
        return self.error(words[:1].lower() + words[1:].replace('`', ''), *place)


def read_yaml(path: Path) -> YamlFile:
    """The values of a YAML 1.2 file.

    Raises:
        FileError: It cannot be read, is not YAML, holds a name twice or one that is no text, a
            number without end, or an anchor that holds itself.
    """
    yaml = YAML(typ='safe', pure=True)
    lines: dict[tuple[str | int, ...], int] = {}
    try:
        text = path.read_text(encoding='utf-8')
        root = yaml.compose(text)
        if root is not None:
            _check_nodes(path, root, ())
        data = None if root is None else yaml.constructor.construct_document(root)
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise FileError(f'{path}: is not text in UTF-8') from None
    except RecursionError:
        raise FileError(f'{path}: is nested too deeply') from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise FileError(f'{path}, line {line}: not YAML: {error.problem}') from None
    except YAMLError as error:
        raise FileError(f'{path}: not YAML: {error}') from None
    if root is not None:
        _note_lines(root, (), lines)
    file = YamlFile(path, data, lines)
    _check_numbers(file, data, ())
    return file


def _check_nodes(path: Path, node: Node, above: tuple[Node, ...]) -> None:
    """Refuse what YAML can say, and no file of ours means."""
    where = f'{path}, line {node.start_mark.line + 1}'
    if any(node is other for other in above):
        raise FileError(f'{where}: the anchor holds itself: write out what is meant')
    if isinstance(node, MappingNode):
        for key, value in node.value:
            if key.tag not in (_TEXT, _MERGE):
                name = key.value if isinstance(key.value, str) else 'this'
                raise FileError(
                    f'{path}, line {key.start_mark.line + 1}: {name}: a name must be text: '
                    f"put it in quotes ('{name}')"
                )
            _check_nodes(path, value, (*above, node))
    elif isinstance(node, SequenceNode):
        for value in node.value:
            _check_nodes(path, value, (*above, node))


def _check_numbers(file: YamlFile, value: Any, place: tuple[str | int, ...]) -> None:
    """No comparison says that NaN is wrong."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _check_numbers(file, inner, (*place, name))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            _check_numbers(file, inner, (*place, number))
    elif isinstance(value, float) and not isfinite(value):
        raise file.error(f'must be a finite number, is {value}', *place)
    elif isinstance(value, int) and abs(value) > _MOST:
        raise file.error('is too large a number', *place)


def _note_lines(
    node: Node, place: tuple[str | int, ...], lines: dict[tuple[str | int, ...], int]
) -> None:
    lines.setdefault(place, node.start_mark.line + 1)
    if isinstance(node, MappingNode):
        for key, value in node.value:
            lines[(*place, str(key.value))] = key.start_mark.line + 1
            _note_lines(value, (*place, str(key.value)), lines)
    elif isinstance(node, SequenceNode):
        for number, value in enumerate(node.value):
            _note_lines(value, (*place, number), lines)


def _spelled(field: tuple[str | int, ...]) -> str:
    text = ''
    for step in field:
        text += f'[{step}]' if isinstance(step, int) else f'.{step}' if text else step
    return text
