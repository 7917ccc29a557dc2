"""The kinds of values that settings hold, each with its check."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import Mistake, kind_of, refused
from ros2_kafka_bridge.kafka.properties import PropertyValue, is_secret, refusal

CheckType = Callable[[str, Sequence[Path]], str | None]
"""Name of a message type, folders of .msg files -> what is wrong with it, None if nothing."""

CheckFormat = Callable[[str], str | None]
"""Name of a format, or tracing -> what it lacks here, None where it lacks nothing."""

CheckKafka = Callable[[Mapping[str, object]], dict[str, str]]


def no_bool(value: object) -> object:
    """The value, if it is not true or false, which Python would count as 1 and 0.

    Raises:
        ValueError: It is.
    """
    if isinstance(value, bool):
        raise ValueError('expected a number, got true or false')  # noqa: TRY004  # pydantic's way
    return value


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
    if not folder.is_dir():
        raise ValueError('no such folder')
    return folder


def _property_values(value: object) -> object:
    if not isinstance(value, dict):
        return value
    mistakes = [Mistake((str(n),), t) for n, v in value.items() for t in _property_mistake(n, v)]
    if mistakes:
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


NotNegative = Annotated[float, Field(ge=0), BeforeValidator(no_bool)]
Domain = Annotated[int, Field(ge=0, le=232), BeforeValidator(no_bool)]
CountOrNone = Annotated[int, Field(ge=0), BeforeValidator(no_bool)]
PositiveCount = Annotated[int, Field(ge=1), BeforeValidator(no_bool)]
Positive = Annotated[float, Field(gt=0), BeforeValidator(no_bool)]
BridgeName = Annotated[str, AfterValidator(checks.bridge_name)]
Name = Annotated[str, AfterValidator(checks.simple_name)]
Directory = Annotated[str, AfterValidator(checks.absolute_path)]
KafkaTopicName = Annotated[str, AfterValidator(checks.kafka_topic)]
RosTopic = Annotated[str, AfterValidator(checks.ros_topic)]
MessageFolder = Annotated[Path, AfterValidator(_folder)]
MessageTypeName = Annotated[str, AfterValidator(_known_type)]
KeyTemplate = Annotated[str, AfterValidator(_template)]
Properties = Annotated[dict[str, PropertyValue], BeforeValidator(_property_values)]
