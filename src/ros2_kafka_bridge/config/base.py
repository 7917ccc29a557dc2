"""What all settings are: plain values, each with its meaning, and never a secret shown.

`config.validation` makes them of what a file says, and is loaded only to do so: a process that
runs routes for weeks holds the values alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, TypeVar, dataclass_transform

from ros2_kafka_bridge.config.mistakes import Mistake, field_names
from ros2_kafka_bridge.kafka.properties import is_secret
from ros2_kafka_bridge.outside.masking import MASK, masked_address, masked_query, masked_setting

_ADDRESS = re.compile(r'(^|\.)(url|proxy|endpoint)$')
_QUERY = re.compile(r'\.query$')
_Class = TypeVar('_Class')

Values = Mapping[str, Any]
"""Plain values by their names, checked or not."""


class ValueCheck(NamedTuple):
    """Annotates a type with a check; `Before` and `After` make one.

    Args:
        validator: The name of the class in pydantic.
        check: The value, and what the caller of the loader brings along (pydantic's
            `ValidationInfo`) if it takes two -> the value to go on with.
    """

    validator: str
    check: Callable[..., Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Be what pydantic calls a validator."""
        import pydantic  # noqa: PLC0415 (heavy: only to read a file)

        made = getattr(pydantic, self.validator)(self.check)
        return made.__get_pydantic_core_schema__(source, handler)


Before = partial(ValueCheck, 'BeforeValidator')
"""A check of a value before anything else looks at it."""

After = partial(ValueCheck, 'AfterValidator')
"""A check of a value that is one of that type."""


def setting(
    description: str,
    *,
    default: Any = MISSING,
    default_factory: Callable[[], Any] | None = None,
    spelled: str = '',
    secret: bool = False,
) -> Any:
    """Describe a field of settings.

    Args:
        description: What it means, in sentences: for the docs, editors, and who has left it out.
        default: Its value where a file does not say it; without one it must.
        default_factory: Makes the default, if that is no constant.
        spelled: Its name in a file, if that is not the one in Python.
        secret: Whether an editor is to hide it.
    """
    meaning: dict[str, Any] = {'description': description}
    if spelled:
        meaning['alias'] = spelled
    if secret:
        meaning['json_schema_extra'] = {'writeOnly': True}
    if default_factory is not None:
        return field(default_factory=default_factory, metadata=meaning)
    return field(default=default, metadata=meaning)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(setting,))
def settings(model: type[_Class]) -> type[_Class]:
    """Make a class of settings, a subclass of `Settings`, of fields that are each a `setting`."""
    return dataclass(frozen=True, kw_only=True, repr=False)(model)


def dotted(model: type[_Class]) -> type[_Class]:
    """Spell the fields of a class in a file with dots: `a.b` is `a_b` in Python."""
    for name, value in vars(model).items():
        if isinstance(value, Field):
            spelled = {'alias': name.replace('_', '.')}
            value.metadata = MappingProxyType({**value.metadata, **spelled})
    return model


@settings
class Settings:
    """What all settings share: frozen, no unknown field, every mistake at once in plain words."""

    # How pydantic is to check them; it looks for this name.
    __pydantic_config__: ClassVar[dict[str, Any]] = {
        'frozen': True,
        'extra': 'forbid',
        'populate_by_name': True,
        'hide_input_in_errors': True,
        'allow_inf_nan': False,
    }

    @classmethod
    def prepared(cls, data: Any) -> Any:
        """What a file says, as the fields are to be read from it."""
        return data

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """The mistakes that no single field shows.

        Args:
            given: Fields by their spelling in a file; unchecked where another one is wrong.
            context: The checks that the caller of the loader brings along.
        """
        _ = given, context
        yield from ()

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Be checked as `config.validation` does."""
        from ros2_kafka_bridge.config.validation import schema_of  # noqa: PLC0415 (heavy: only to read a file)

        return schema_of(cls, handler(source))

    def __repr__(self) -> str:
        spelled = {name: spelling for spelling, name in field_names(type(self)).items()}
        shown = []
        for name, spelling in spelled.items():
            value = getattr(self, name)
            shown.append(f'{name}={None if value is None else masked_value(spelling, value)!r}')
        return f'{type(self).__name__}({", ".join(shown)})'


def look(value: Any, *path: str) -> Any:
    """A field inside checked settings or unchecked mappings, None where it is not there."""
    for key in path:
        if isinstance(value, Settings):
            value = getattr(value, field_names(type(value)).get(key, ''), None)
        else:
            value = value.get(key) if isinstance(value, Mapping) else None
    return value


def masked_values(value: Any) -> Any:
    """The same value, every secret in it masked: properties, and what addresses hold."""
    if isinstance(value, Mapping):
        return {name: masked_value(str(name), item) for name, item in value.items()}
    if isinstance(value, str):
        return masked_setting(value)
    return [masked_values(item) for item in value] if isinstance(value, list) else value


def masked_value(name: str, value: Any) -> Any:
    """The same of what has a name, which tells an address also where it has no scheme."""
    if is_secret(name):
        return MASK
    if isinstance(value, str) and _ADDRESS.search(name):
        return masked_address(value)
    if isinstance(value, str) and _QUERY.search(name):
        return masked_query(value)
    return masked_values(value)
