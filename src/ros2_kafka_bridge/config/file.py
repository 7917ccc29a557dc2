"""From the text of a file to a configuration, or to every mistake in it with its line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD
from ros2_kafka_bridge.config.references import expand
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.tree import LocatedMistake, Tree, YamlError, read_yaml
from ros2_kafka_bridge.config.validation import attempted
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.text import count, printable
from ros2_kafka_bridge.outside.files import UnreadableError, read_any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ros2_kafka_bridge.config.mistakes import Mistake
    from ros2_kafka_bridge.config.values import CheckField, CheckFormat, CheckKafka, CheckType


LINE_LIMIT_CHARS = 2000
STEP_LIMIT_CHARS = 300


def load(
    path: Path,
    environ: Mapping[str, str],
    check_type: CheckType | None = None,
    check_kafka: CheckKafka | None = None,
    check_format: CheckFormat | None = None,
    check_field: CheckField | None = None,
) -> Config:
    """The configuration in a file.

    Args:
        path: The file; named in messages as it is given here. A path in `${file:PATH}` is
            relative to its directory.
        environ: What `${NAME}` is read from.
        check_type: Says what is wrong with the name of a message type, None where nothing is.
        check_kafka: Says what is wrong with librdkafka properties, by their names.
        check_format: Says what a format, or tracing, lacks here; None where it lacks nothing.
        check_field: Says why a message type has no number or text at a path, None where it has.

    Raises:
        ConfigError: With every mistake in the file.
    """
    checks = (check_type, check_kafka, check_format, check_field)
    return loads(read_text(path), str(path), environ, *checks)


def read_text(path: Path) -> str:
    """What a file holds.

    Raises:
        ConfigError: It cannot be read, or is no text.
    """
    try:
        content = read_any(path)
    except UnreadableError as error:
        raise ConfigError([f'{path}: {error}']) from error
    try:
        return content.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        raise ConfigError([f'{path}:{line}: not UTF-8: save the file in this encoding']) from error


def loads(
    text: str,
    file_name: str,
    environ: Mapping[str, str],
    check_type: CheckType | None = None,
    check_kafka: CheckKafka | None = None,
    check_format: CheckFormat | None = None,
    check_field: CheckField | None = None,
) -> Config:
    """The configuration in a text; see `load`.

    Raises:
        ConfigError: With every mistake in the text.
    """
    try:
        tree = read_yaml(text)
    except YamlError as error:
        raise ConfigError([f'{file_name}:{error.line}:{error.column}: {error}']) from None
    if tree.data is None:
        text = 'the file is empty: it needs at least name, kafka and routes'
        raise ConfigError([f'{file_name}:1: {text}'])
    directory = Path(file_name).parent
    expanded = expand(tree.data, environ, directory)
    context = {
        'check_type': check_type,
        'check_kafka': check_kafka,
        'check_format': check_format,
        'check_field': check_field,
        'environ': environ,
        'directory': directory,
        'message_path': _message_path(expanded.data, directory),
    }
    config, found = attempted(Config, expanded.data, context)
    mistakes = [*tree.mistakes, *expanded.mistakes]
    mistakes += _not_known(found, expanded.mistakes)
    if config is None or mistakes:
        raise ConfigError(_told(mistakes, tree, file_name))
    return config


def _message_path(data: Any, directory: Path) -> list[Path] | None:
    """Where types are looked up while the rest is still unchecked; None for packages alone."""
    ros = data.get('ros') if isinstance(data, dict) else None
    if isinstance(ros, dict) and ros.get('packages') == 'import':
        return None
    folders = ros.get('message_path') if isinstance(ros, dict) else None
    found = folders if isinstance(folders, list) else []
    return [directory / folder for folder in found if isinstance(folder, str)]


def _not_known(found: list[Mistake], known: list[LocatedMistake]) -> list[LocatedMistake]:
    """The settings' mistakes, but for values that are wrong already for their reference."""
    reported = {one.path for one in known}
    return [
        LocatedMistake(mistake.path, mistake.text)
        for mistake in found
        if not any(mistake.path[:length] in reported for length in range(len(mistake.path) + 1))
    ]


def _told(mistakes: list[LocatedMistake], tree: Tree, file_name: str) -> list[str]:
    lined = [(one.line or tree.line_of(one.path), one) for one in mistakes]
    ordered = sorted(lined, key=lambda entry: entry[0])
    lines = [f'{file_name}:{line}: {_field(one.path)}{one.text}' for line, one in ordered]
    told = [_short(printable(line)) for line in dict.fromkeys(lines)]
    if len(told) <= MISTAKES_TOLD:
        return told
    more = count(len(told) - MISTAKES_TOLD, 'more mistake')
    return [*told[:MISTAKES_TOLD], f'{file_name}: and {more}']


def _short(line: str) -> str:
    return line if len(line) <= LINE_LIMIT_CHARS else f'{line[:LINE_LIMIT_CHARS]}...'


def _field(path: tuple[str | int, ...]) -> str:
    parts = [
        f'[{step}]' if isinstance(step, int) else f'.{step[:STEP_LIMIT_CHARS]}' for step in path
    ]
    shown = ''.join(parts).removeprefix('.')
    return f'{shown}: ' if shown else ''
