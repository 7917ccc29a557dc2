"""Which bridge a file is for, and where that answers, though the rest of the file may be wrong.

What asks a running bridge needs no more of its file: it may have been spoilt since the start, and
the variables and message types that it names may be there for the bridge alone.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import look
from ros2_kafka_bridge.config.file import read_text
from ros2_kafka_bridge.config.monitoring import Address, MonitoringSettings, is_address
from ros2_kafka_bridge.config.references import expand
from ros2_kafka_bridge.config.tree import Tree, YamlError, read_yaml
from ros2_kafka_bridge.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_TOLD: Final = (('name',), ('monitoring',), ('monitoring', 'listen'))
_FIELD: Final = re.compile(r'^[^\s#]', re.MULTILINE)
_MOST_CUTS: Final = 16
_SHORT_CHARS: Final = 64 * 1024


class BridgeAddress(NamedTuple):
    """The name of a bridge, and the address that it listens on."""

    name: str
    address: Address


def bridge_address(path: Path, environ: Mapping[str, str]) -> BridgeAddress | None:
    """What a file says of the two; None where that cannot be told."""
    try:
        tree = _readable(read_text(path))
    except (ConfigError, YamlError):
        return None
    values = _values(tree)
    found = expand(values, environ, path.parent)
    if found.mistakes or any(mistake.path in _TOLD for mistake in tree.mistakes):
        return None
    name, listen = found.data['name'], found.data['listen']
    is_known = _is_name(name) and isinstance(listen, str) and is_address(listen)
    return BridgeAddress(name, Address(listen)) if is_known else None


def _readable(text: str) -> Tree:
    """The fields of a text that stand before the one where it is no YAML.

    Raises:
        YamlError: There are none.
    """
    for _ in range(_MOST_CUTS if len(text) < _SHORT_CHARS else 1):
        try:
            return read_yaml(text)
        except YamlError as error:
            text = _before(text, error.line)
    return read_yaml(text)


def _before(text: str, line: int) -> str:
    """A text without the field that a line belongs to, and without all that follows."""
    begun = ''.join(text.splitlines(keepends=True)[:line])
    begins = [match.start() for match in _FIELD.finditer(begun)]
    return begun[: begins[-1]] if begins else ''


def _values(tree: Tree) -> dict[str, Any]:
    monitoring, listen = look(tree.data, 'monitoring'), look(tree.data, 'monitoring', 'listen')
    if isinstance(monitoring, dict) and 'listen' not in monitoring:
        listen = MonitoringSettings.listen
    return {'name': look(tree.data, 'name'), 'listen': listen}


def _is_name(value: object) -> bool:
    try:
        return isinstance(value, str) and bool(checks.bridge_name(value))
    except ValueError:
        return False
