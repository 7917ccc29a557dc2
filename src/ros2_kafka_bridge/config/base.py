"""How settings speak: every mistake at once, in plain words, and never a secret."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from ros2_kafka_bridge.kafka.properties import is_secret

MASK = '***'
PLAIN = 'plain'

_CREDENTIALS = re.compile(r'://[^/?#\s]*@')

_WORDS = {
    'bool_parsing': 'expected true or false',
    'bool_type': 'expected true or false',
    'dict_type': 'expected a mapping, got {got}',
    'finite_number': 'expected a finite number',
    'float_parsing': 'expected a number, got {got}',
    'float_type': 'expected a number, got {got}',
    'frozen_instance': 'a configuration cannot be changed',
    'greater_than': 'must be more than {gt:g}',
    'greater_than_equal': 'must be at least {ge:g}',
    'int_from_float': 'expected a whole number, got a fraction',
    'int_parsing': 'expected a whole number, got {got}',
    'int_parsing_size': 'expected a smaller number',
    'int_type': 'expected a whole number, got {got}',
    'less_than': 'must be less than {lt:g}',
    'less_than_equal': 'must be at most {le:g}',
    'list_type': 'expected a list, got {got}',
    'literal_error': 'expected {expected}{hint}',
    'model_attributes_type': 'expected a mapping, got {got}',
    'model_type': 'expected a mapping, got {got}',
    'string_type': 'expected text, got {got}{quotes}',
    'too_short': 'needs at least one',
    'value_error': '{error}',
}
_KINDS: tuple[tuple[type | tuple[type, ...], str], ...] = (
    (bool, 'true or false'),
    ((int, float), 'a number'),
    (str, 'text'),
    (list, 'a list'),
    ((dict, BaseModel), 'a mapping'),
    (type(None), 'nothing'),
)


class Mistake(NamedTuple):
    """What is wrong, at which field; an empty path means the whole."""

    path: tuple[str | int, ...]
    text: str


def kind_of(value: object) -> str:
    """What kind of value it is; never the value, which may be a secret."""
    return next((word for kind, word in _KINDS if isinstance(value, kind)), 'something else')


def mistakes_in(model: type[BaseModel], error: ValidationError) -> list[Mistake]:
    """The findings of pydantic about one model, in plain words."""
    return [
        Mistake(tuple(found['loc']), _text(model, found))
        for found in error.errors(include_url=False)
    ]


def refused(title: str, mistakes: Iterable[Mistake]) -> ValidationError:
    """The error that carries mistakes through pydantic without the values they were found in."""
    lines = [
        InitErrorDetails(
            # A context, though empty, would make pydantic read the braces in a text.
            type=PydanticCustomError(PLAIN, mistake.text),
            loc=mistake.path,
            input=None,
        )
        for mistake in mistakes
    ]
    return ValidationError.from_exception_data(title, lines, hide_input=True)


def near(word: str, known: Iterable[str]) -> str:
    """`(did you mean 'x'?)` with a space before it, or nothing."""
    found = difflib.get_close_matches(word, sorted(known), 1, 0.6)
    return f" (did you mean '{found[0]}'?)" if found else ''


def field_names(model: type[BaseModel]) -> dict[str, str]:
    """The spelling of each field in a file, with its name in Python."""
    return {field.alias or name: name for name, field in model.model_fields.items()}


class Settings(BaseModel):
    """What all settings share: frozen, no unknown field, every mistake at once in plain words."""

    model_config = ConfigDict(
        frozen=True,
        extra='forbid',
        populate_by_name=True,
        hide_input_in_errors=True,
        allow_inf_nan=False,
    )

    @classmethod
    def mistakes(
        cls, given: Mapping[str, Any], context: Mapping[str, Any], /
    ) -> Iterator[Mistake]:
        """The mistakes that no single field shows.

        Args:
            given: Fields by their spelling in a file; unchecked where another one is wrong.
            context: The checks that the caller of the loader brings along.
        """
        _ = given, context
        yield from ()

    @model_validator(mode='wrap')
    @classmethod
    def _all_mistakes(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        if isinstance(data, cls):
            return data
        found: list[Mistake] = []
        given: Mapping[str, Any] = data if isinstance(data, Mapping) else {}
        try:
            made = handler(data)
            given = {spelled: getattr(made, n) for spelled, n in field_names(cls).items()}
        except ValidationError as error:
            found = mistakes_in(cls, error)
        paths = {mistake.path for mistake in found}
        found += [m for m in cls.mistakes(given, info.context or {}) if m.path not in paths]
        if found:
            raise refused(cls.__name__, found)
        return made

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        spelled = {name: alias for alias, name in field_names(type(self)).items()}
        for name, value in super().__repr_args__():
            secret = value is not None and is_secret(spelled.get(name or '', ''))
            yield name, MASK if secret else masked_values(value)


def look(value: Any, *path: str) -> Any:
    """A field inside checked settings or unchecked mappings, None where it is not there."""
    for key in path:
        if isinstance(value, Settings):
            value = getattr(value, field_names(type(value)).get(key, ''), None)
        else:
            value = value.get(key) if isinstance(value, Mapping) else None
    return value


def masked_values(value: Any) -> Any:
    """The same value, every secret property in it masked, and passwords in addresses."""
    if isinstance(value, Mapping):
        return {n: MASK if is_secret(str(n)) else masked_values(v) for n, v in value.items()}
    if isinstance(value, str):
        return _CREDENTIALS.sub(f'://{MASK}@', value)
    return [masked_values(item) for item in value] if isinstance(value, list) else value


def _text(model: type[BaseModel], found: Mapping[str, Any]) -> str:
    if found['type'] == PLAIN:
        return str(found['msg'])
    name = str(found['loc'][-1]) if found['loc'] else ''
    if found['type'] == 'extra_forbidden':
        return f"unknown field '{name}'{near(name, field_names(model))}"
    if found['type'] == 'missing':
        return f'is missing: {_meaning(model, name)}'
    words = str(_WORDS.get(found['type'], found['msg']))
    value = found['input']
    context = dict(found.get('ctx', {}))
    expected = str(context.get('expected', '')).replace("'", '')
    return words.format(
        **context
        | {
            'got': kind_of(value),
            'expected': expected,
            'hint': near(value, expected.replace(' or ', ', ').split(', '))
            if isinstance(value, str)
            else '',
            'quotes': ' (put it in quotes)' if isinstance(value, bool | int | float) else '',
        }
    )


def _meaning(model: type[BaseModel], name: str) -> str:
    field = model.model_fields[field_names(model).get(name, name)]
    first = (field.description or '').split('. ')[0].rstrip('.')
    return first[:1].lower() + first[1:]
