""".msg files, read with the parser of ROS 2: what a type holds, its constants, its comments."""

import contextlib
import importlib.util
import io
import threading
from bisect import bisect_left
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError, RouteError, blamed
from ros2_kafka_bridge.message_types.description import (
    EMPTY_MEMBER,
    FieldDescription,
    FieldType,
    Ids,
    Lists,
    TypeDescription,
)
from ros2_kafka_bridge.message_types.layout import PRIMITIVES, Constant, Primitive, String
from ros2_kafka_bridge.outside.extras import how_to_get_ros
from ros2_kafka_bridge.outside.files import UnreadableError, read_regular

_UINT8: Final = FieldType(Ids.UINT8, 0, 0, '')
_ROS1: Final = {'time': 'builtin_interfaces/Time', 'duration': 'builtin_interfaces/Duration'}
# No character: a private one, that no comment has.
_BRACKET: Final = '\ue000'
# There is one for all threads, as there is one stderr.
_STDERR: Final = threading.Lock()


class Docs(NamedTuple):
    """What a .msg file says for people.

    Args:
        doc: Of the type.
        fields: The doc of each field.
    """

    doc: str
    fields: dict[str, str]
    constants: tuple[Constant, ...]


def has_parser() -> bool:
    """Whether .msg files can be read here; the parser comes with ROS 2."""
    return importlib.util.find_spec('rosidl_adapter') is not None


def read_definition(name: str, file: Path) -> TypeDescription:
    """What a .msg file says of a type.

    Raises:
        ConfigError: The file cannot be read; with the line.
    """
    text = _text(file)
    fields = tuple(_field(field, text, file) for field in _parse(name, file, text).fields)
    empty = FieldDescription(EMPTY_MEMBER, _UINT8)
    return TypeDescription(name, fields or (empty,))


def read_docs(name: str, file: Path) -> Docs:
    """What a .msg file says for people.

    Raises:
        ConfigError: The file cannot be read; with the line.
    """
    # The parser takes a single [word] out of a comment, as a unit. A doc keeps it.
    lines = [line.partition('#') for line in _text(file).splitlines()]
    text = '\n'.join(f'{head}{mark}{tail.replace("[", _BRACKET)}' for head, mark, tail in lines)
    parsed = _parse(name, file, text)
    return Docs(
        _doc(parsed),
        {field.name: _doc(field) for field in parsed.fields},
        tuple(_constant(constant) for constant in parsed.constants),
    )


def line_of(field: str, file: Path) -> int:
    """Where a field stands in its file, from 1 on."""
    return _line_of(field, _text(file))


def _line_of(field: str, text: str) -> int:
    lines = (line.partition('#')[0].split()[1:2] for line in text.splitlines())
    return next((number for number, words in enumerate(lines, 1) if words == [field]), 1)


def _text(file: Path) -> str:
    try:
        data = read_regular(file)
    except UnreadableError as error:
        raise ConfigError([f'{file}: {error}']) from error
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        found = data[error.start]
        raise ConfigError([f'{file}:{line}: not UTF-8: {found:#04x}']) from error


def _parser() -> Any:
    try:
        with blamed('.msg files are read with rosidl_adapter, and it cannot be loaded'):
            from rosidl_adapter import parser  # noqa: PLC0415 -- comes with ROS
    except RouteError as error:
        raise ConfigError([f'{error} ({how_to_get_ros()})']) from error
    return parser


def _parse(name: str, file: Path, text: str) -> Any:
    """A MessageSpecification of the parser, which tells no lines: the first bad one is sought."""
    parser = _parser()
    parsed, mistake = _attempt(parser, name, text)
    if mistake is None:
        return parsed
    lines = text.splitlines()
    number = bisect_left(
        range(len(lines) + 1),
        True,  # noqa: FBT003 -- what is sought
        key=lambda count: _attempt(parser, name, '\n'.join(lines[:count]))[1] is not None,
    )
    if number == 0:
        raise ConfigError([f'{file}: {mistake}'])
    _, mistake = _attempt(parser, name, '\n'.join(lines[:number]))
    line = lines[number - 1].rstrip()
    raise ConfigError([f'{file}:{number}: {line!r}: {_words(str(mistake), line)}'])


def _words(mistake: str, line: str) -> str:
    if line[:1].isspace():
        return 'the type of a field stands at the beginning of the line, without spaces before it'
    if mistake in line:
        return 'expected TYPE NAME, TYPE NAME DEFAULT or TYPE NAME=VALUE'
    return mistake


def _attempt(parser: Any, name: str, text: str) -> tuple[Any, Exception | None]:
    package, _, short_name = name.split('/')
    # The parser prints what it raises. Of two at once, the last would put back the first one's.
    with _STDERR, contextlib.redirect_stderr(io.StringIO()):
        try:
            return parser.parse_message_string(package, short_name, text), None
        except Exception as error:  # noqa: BLE001 -- it raises nearly all there are, on purpose
            return None, error


def _field(field: Any, text: str, file: Path) -> FieldDescription:
    if field.type.type in _ROS1:
        instead = _ROS1[field.type.type]
        line = _line_of(field.name, text)
        raise ConfigError([f'{file}:{line}: {field.type.type} is of ROS 1, use {instead}'])
    return FieldDescription(field.name, _field_type(field.type), _default(field.default_value))


def _field_type(parsed: Any) -> FieldType:
    nested = f'{parsed.pkg_name}/msg/{parsed.type}' if parsed.pkg_name else ''
    bound = parsed.string_upper_bound or 0
    return FieldType(_base_id(parsed) + _list_id(parsed), parsed.array_size or 0, bound, nested)


def _base_id(parsed: Any) -> int:
    if parsed.pkg_name:
        return Ids.NESTED
    name = 'uint8' if parsed.type == 'char' else parsed.type
    return Ids[f'bounded_{name}'.upper() if parsed.string_upper_bound else name.upper()]


def _list_id(parsed: Any) -> int:
    if not parsed.is_array:
        return Lists.NONE
    if parsed.is_fixed_size_array():
        return Lists.ARRAY
    return Lists.BOUNDED_SEQUENCE if parsed.array_size else Lists.SEQUENCE


def _default(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, list):
        return str(tuple(value))
    return _unescaped(value) if isinstance(value, str) else str(value)


def _unescaped(text: str) -> str:
    """As the generators of ROS 2 read the escapes in a text."""
    try:
        return text.encode().decode('unicode_escape').encode('latin-1').decode()
    except UnicodeError:
        return text


def _constant(parsed: Any) -> Constant:
    name = 'uint8' if parsed.type == 'char' else parsed.type
    kind = Primitive(name) if name in PRIMITIVES else String(wide=name == 'wstring')
    value = _unescaped(parsed.value) if isinstance(parsed.value, str) else parsed.value
    return Constant(parsed.name, kind, value, _doc(parsed))


def _doc(instance: Any) -> str:
    text = '\n'.join(line.rstrip() for line in instance.annotations.get('comment', ()))
    return text.replace(_BRACKET, '[').strip('\n')
