"""Settings of what a file says, by pydantic: every mistake at once, in plain words.

Loaded by what reads a file, or writes out what one says; never by what runs a bridge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError, ValidationInfo, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD, Mistake, field_names, kind_of, near

_PLAIN = 'plain'
_WORDS = {
    'bool_parsing': 'expected true or false',
    'bool_type': 'expected true or false',
    'dataclass_type': 'expected a mapping, got {got}',
    'dict_type': 'expected a mapping, got {got}',
    'finite_number': 'expected a finite number',
    'float_parsing': 'expected a number, got {got}',
    'float_type': 'expected a number, got {got}',
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
    'string_type': 'expected text, got {got}{quotes}',
    'too_short': 'needs at least one',
    'value_error': '{error}',
}

_Model = TypeVar('_Model')

_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def validated(model: type[_Model], data: Any, context: Mapping[str, Any] | None = None) -> _Model:
    """The settings that are in plain values.

    Args:
        model: What they are to be.
        data: The values, by their spelling in a file.
        context: The checks that the caller brings along; see `Settings.mistakes`.

    Raises:
        pydantic.ValidationError: With every mistake.
    """
    made: _Model = _adapter(model).validate_python(data, context=context)
    return made


def attempted(
    model: type[_Model], data: Any, context: Mapping[str, Any] | None = None
) -> tuple[_Model | None, list[Mistake]]:
    """The same without an error: None, and every mistake, where there are some."""
    try:
        return validated(model, data, context), []
    except ValidationError as error:
        return None, _mistakes_in(model, error)


def plain(settings: object, *, without_none: bool = False) -> dict[str, Any]:
    """The plain values of settings, by their spelling in a file. They hold secrets."""
    values: dict[str, Any] = _adapter(type(settings)).dump_python(
        settings, mode='json', by_alias=True, exclude_none=without_none
    )
    return values


def json_schema(model: type[Any]) -> dict[str, Any]:
    """JSON Schema of a file that holds such settings."""
    return _adapter(model).json_schema(by_alias=True)


def refused(title: str, mistakes: Iterable[Mistake]) -> ValidationError:
    """The error that carries mistakes through pydantic without the values they were found in."""
    lines = [
        InitErrorDetails(
            # A context, though empty, would make pydantic read the braces in a text.
            type=PydanticCustomError(_PLAIN, mistake.text),
            loc=mistake.path,
            input=None,
        )
        for mistake in mistakes
    ]
    return ValidationError.from_exception_data(title, lines, hide_input=True)


def schema_of(model: type[Any], inner: CoreSchema) -> CoreSchema:
    """What pydantic does with a model: first what concerns its fields, then all the rest.

    Args:
        model: The model.
        inner: What pydantic would do with its fields.
    """

    def check(data: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        return _checked(model, data, handler, info.context or {})

    return core_schema.with_info_wrap_validator_function(check, inner)


def _mistakes_in(model: type[Any], error: ValidationError) -> list[Mistake]:
    """The findings of pydantic about one model, in plain words."""
    return [
        Mistake(tuple(found['loc']), _text(model, found, hint=number < MISTAKES_TOLD))
        for number, found in enumerate(error.errors(include_url=False))
    ]


def _checked(
    model: type[Any],
    data: Any,
    handler: ValidatorFunctionWrapHandler,
    context: Mapping[str, Any],
) -> Any:
    if isinstance(data, model):
        return data
    found: list[Mistake] = []
    given: Mapping[str, Any] = data if isinstance(data, Mapping) else {}
    try:
        made = handler(model.prepared(data))
        given = {spelled: getattr(made, n) for spelled, n in field_names(model).items()}
    except ValidationError as error:
        found = _mistakes_in(model, error)
    paths = {mistake.path for mistake in found}
    found += [m for m in model.mistakes(given, context) if m.path not in paths]
    if found:
        raise refused(model.__name__, found)
    return made


def _text(model: type[Any], found: Mapping[str, Any], *, hint: bool) -> str:
    if found['type'] == _PLAIN:
        return str(found['msg'])
    name = str(found['loc'][-1]) if found['loc'] else ''
    if found['type'] == 'unexpected_keyword_argument':
        return f"unknown field '{name}'{near(name, field_names(model)) if hint else ''}"
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


def _meaning(model: type[Any], name: str) -> str:
    described = {each.name: each.metadata['description'] for each in fields(model)}
    first = str(described[field_names(model).get(name, name)]).split('. ')[0].rstrip('.')
    return first[:1].lower() + first[1:]
