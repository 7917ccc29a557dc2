"""What is wrong with a value, and at which field, in words that never show it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

_KINDS: tuple[tuple[type | tuple[type, ...], str], ...] = (
    (bool, 'true or false'),
    ((int, float), 'a number'),
    (str, 'text'),
    (list, 'a list'),
    (type(None), 'nothing'),
)


_LONGEST_WORD = 100

MISTAKES_TOLD = 100
"""How many are told: a file that has more is probably no configuration."""


class Mistake(NamedTuple):
    """What is wrong, at which field; an empty path means the whole."""

    path: tuple[str | int, ...]
    text: str


def kind_of(value: object) -> str:
    """What kind of value it is; never the value, which may be a secret."""
    if isinstance(value, Mapping) or is_dataclass(value):
        return 'a mapping'
    return next((word for kind, word in _KINDS if isinstance(value, kind)), 'something else')


def near(word: str, known: Iterable[str]) -> str:
    """`(did you mean 'x'?)` with a space before it, or nothing."""
    import difflib  # noqa: PLC0415 (only for mistakes)

    if len(word) > _LONGEST_WORD:
        return ''
    found = difflib.get_close_matches(word, sorted(known), 1, 0.6)
    return f" (did you mean '{found[0]}'?)" if found else ''


def _field_names(model: Any) -> Mapping[str, str]:
    names = {str(each.metadata.get('alias', each.name)): each.name for each in fields(model)}
    return MappingProxyType(names)


# No decorator: to mypy a class of instances that have a hash is not `Hashable` itself.
field_names: Callable[[Any], Mapping[str, str]] = cache(_field_names)
"""The spelling of each field of settings in a file, with its name in Python."""
