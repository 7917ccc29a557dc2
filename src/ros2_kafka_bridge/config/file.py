"""From the text of a file to a configuration, or to every mistake in it with its line."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import ValidationError

from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.tree import Finding, Tree, YamlError, read_yaml
from ros2_kafka_bridge.config.words import mistakes_in
from ros2_kafka_bridge.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ros2_kafka_bridge.config.values import CheckKafka, CheckType

SIZE_LIMIT_BYTES = 1024 * 1024

_VARIABLE = re.compile(r'\$(\$(?=\{)|\{([A-Za-z_][A-Za-z0-9_]*)\}|\{)')


class _Expanded(NamedTuple):
    data: Any
    findings: list[Finding]


def load(
    path: Path,
    environ: Mapping[str, str],
    check_type: CheckType | None = None,
    check_kafka: CheckKafka | None = None,
) -> Config:
    """The configuration in a file.

    Args:
        path: The file; named in messages as it is given here.
        environ: What `${NAME}` is read from.
        check_type: Says what is wrong with the name of a message type, None where nothing is.
        check_kafka: Says what is wrong with librdkafka properties, by their names.

    Raises:
        ConfigError: With every mistake in the file.
    """
    try:
        with path.open('rb') as file:
            content = file.read(SIZE_LIMIT_BYTES + 1)
    except OSError as error:
        raise ConfigError([f'{path}: {_plain_os_error(error)}']) from error
    if len(content) > SIZE_LIMIT_BYTES:
        raise ConfigError([f'{path}: larger than {SIZE_LIMIT_BYTES} bytes: no configuration'])
    try:
        text = content.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        raise ConfigError([f'{path}:{line}: not UTF-8: save the file in this encoding']) from error
    return loads(text, str(path), environ, check_type, check_kafka)


def loads(
    text: str,
    file_name: str,
    environ: Mapping[str, str],
    check_type: CheckType | None = None,
    check_kafka: CheckKafka | None = None,
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
    expanded = _expand(tree, environ)
    context = {'check_type': check_type, 'check_kafka': check_kafka}
    findings = [*tree.findings, *expanded.findings]
    config = None
    try:
        config = Config.model_validate(expanded.data, context=context)
    except ValidationError as error:
        findings += _found_by_settings(error, expanded.findings)
    if config is None or findings:
        raise ConfigError(_told(findings, tree, file_name))
    return config


def _plain_os_error(error: OSError) -> str:
    if isinstance(error, FileNotFoundError):
        return 'no such file'
    if isinstance(error, IsADirectoryError):
        return 'a directory: name the file in it'
    if isinstance(error, PermissionError):
        return 'no permission to read it'
    return error.strerror or 'cannot be read'


def _found_by_settings(error: ValidationError, known: list[Finding]) -> list[Finding]:
    """The settings' findings, but for values that are wrong already for their variable."""
    reported = {finding.path for finding in known}
    return [
        Finding(mistake.path, mistake.text)
        for mistake in mistakes_in(Config, error)
        if not any(mistake.path[: len(path)] == path for path in reported)
    ]


def _told(findings: list[Finding], tree: Tree, file_name: str) -> list[str]:
    lined = [(finding.line or tree.line_of(finding.path), finding) for finding in findings]
    ordered = sorted(lined, key=lambda entry: entry[0])
    lines = [f'{file_name}:{line}: {_field(f.path)}{f.text}' for line, f in ordered]
    return list(dict.fromkeys(lines))


def _field(path: tuple[str | int, ...]) -> str:
    parts = [f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path]
    shown = ''.join(parts).removeprefix('.')
    return f'{shown}: ' if shown else ''


def _expand(tree: Tree, environ: Mapping[str, str]) -> _Expanded:
    """The data with `${NAME}` replaced in its texts, and `$${` for a literal `${`."""
    findings: list[Finding] = []

    def expanded(value: Any, path: tuple[str | int, ...]) -> Any:
        if isinstance(value, dict):
            return {name: expanded(item, (*path, name)) for name, item in value.items()}
        if isinstance(value, list):
            return [expanded(item, (*path, place)) for place, item in enumerate(value)]
        if isinstance(value, str) and '$' in value:
            findings.extend(Finding(path, text) for text in _wrong_variables(value, environ))
            return _VARIABLE.sub(lambda match: _replaced(match, environ), value)
        return value

    data = expanded(tree.data, ())
    return _Expanded(data, findings)


def _wrong_variables(value: str, environ: Mapping[str, str]) -> list[str]:
    found = []
    for match in _VARIABLE.finditer(value):
        if match[1] == '{':
            found.append('${ without a name and }: a variable is written ${NAME}')
        elif match[2] and match[2] not in environ:
            found.append(f'the environment has no variable {match[2]}')
    return found


def _replaced(match: re.Match[str], environ: Mapping[str, str]) -> str:
    return environ.get(match[2], match[0]) if match[2] else '$'
