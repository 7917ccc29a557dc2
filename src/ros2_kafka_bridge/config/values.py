"""The kinds of values that settings hold, each with its check."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

from annotated_types import Ge, Gt, Le

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import After, Before, ValueCheck
from ros2_kafka_bridge.config.mistakes import Mistake, kind_of
from ros2_kafka_bridge.kafka.properties import PropertyValue, is_secret, refusal

if TYPE_CHECKING:
    from pydantic import ValidationInfo

CheckType = Callable[[str, Sequence[Path] | None], str | None]
"""Name of a message type, folders of .msg files -> what is wrong with it, None if nothing."""

CheckField = Callable[[str, str, Sequence[Path] | None], str | None]
"""Message type, path of a field, folders of .msg files -> why it is no number or text, or None."""

CheckFormat = Callable[[str], str | None]
"""Name of a format, or tracing -> what it lacks here, None where it lacks nothing."""

CheckKafka = Callable[[Mapping[str, object], Mapping[str, object] | None], dict[str, str]]
"""Properties, and right ones that go with those of a sink -> what is wrong, by their names."""


def no_bool(value: object) -> object:
    """The value, if it is not true or false, which Python would count as 1 and 0.

    Raises:
        ValueError: It is.
    """
    if isinstance(value, bool):
        raise ValueError('expected a number, got true or false')  # noqa: TRY004  # pydantic's way
    return value


def is_web_address(text: str, schemes: Container[str] = ('http', 'https')) -> bool:
    """Whether a text is an address that a client would take; nothing of it is ever said."""
    try:
        parts = urlsplit(text)
        _ = parts.port  # what is no number may be the beginning of a password that holds a /
    except ValueError:
        return False
    return parts.scheme in schemes and bool(parts.hostname) and not re.search(r'\s', text)


def web_address(example: str, schemes: Container[str] = ('http', 'https')) -> ValueCheck:
    """Make the check of an address; its error names the example."""

    def check(value: str) -> str:
        if not is_web_address(value, schemes):
            raise ValueError(f'expected an address such as {example}')
        return value

    return After(check)


def _known_type(name: str, info: ValidationInfo) -> str:
    checks.message_type(name)
    context = info.context or {}
    check: CheckType | None = context.get('check_type')
    problem = check(name, context.get('message_path', ())) if check else None
    if problem:
        raise ValueError(problem)
    return name


def _folder(path: Path, info: ValidationInfo) -> Path:
    directory: Path | None = (info.context or {}).get('directory')
    if directory is None:
        return path
    folder = directory / path
    if not os.path.isdir(folder):  # noqa: PTH112 (that of a path can raise)
        raise ValueError('no such folder')
    return folder.absolute()


def _property_values(value: object) -> object:
    if not isinstance(value, dict):
        return value
    mistakes = [Mistake((str(n),), t) for n, v in value.items() for t in _property_mistake(n, v)]
    if mistakes:
        from ros2_kafka_bridge.config.validation import refused  # noqa: PLC0415 (heavy: only to read a file)

        raise refused('properties', mistakes)
    return value


def _property_mistake(name: object, value: object) -> Iterator[str]:
    reason = refusal(str(name))
    if reason is not None:
        yield f'is refused: {reason}'
    elif not isinstance(value, str | int | float):
        yield f'expected text, a number, true or false, got {kind_of(value)}'
    elif is_secret(str(name)) and not isinstance(value, str):
        yield 'expected text: put it in quotes, or YAML reads a number and changes it'


def _template(value: str) -> str:
    checks.key_parts(value)
    return value


NotNegative = Annotated[float, Ge(0), Before(no_bool)]
Domain = Annotated[int, Ge(0), Le(232), Before(no_bool)]
CountOrNone = Annotated[int, Ge(0), Before(no_bool)]
PositiveCount = Annotated[int, Ge(1), Before(no_bool)]
Positive = Annotated[float, Gt(0), Before(no_bool)]
BridgeName = Annotated[str, After(checks.bridge_name)]
Name = Annotated[str, After(checks.simple_name)]
Directory = Annotated[str, After(checks.absolute_path)]
KafkaTopicName = Annotated[str, After(checks.kafka_topic)]
RosTopic = Annotated[str, After(checks.ros_topic)]
MessageFolder = Annotated[Path, After(_folder)]
MessageTypeName = Annotated[str, After(_known_type)]
KeyTemplate = Annotated[str, After(_template)]
Properties = Annotated[dict[str, PropertyValue], Before(_property_values)]
