"""Numbers and words for people: thousands with commas, three digits that count, no empty zeros."""

import math
from collections.abc import Callable, Iterable

NONE = '—'


def even(value: float, count: int = 3) -> str:
    """Write so many digits that count, for columns; a whole number keeps all of its own."""
    if not value:
        return '0'
    places = max(0, count - 1 - math.floor(math.log10(abs(value))))
    return _signed(f'{value:,.{places}f}')


def digits(value: float, count: int = 3) -> str:
    """The same without zeros at the end, for sentences."""
    text = even(value, count)
    return text.rstrip('0').rstrip('.') if '.' in text else text


def count(value: float) -> str:
    """Write how many."""
    return _signed(f'{value:,.0f}')


def percent(share: float) -> str:
    """Write a share, 0 to 1; a little never reads as 0 %, nor almost all as 100 %."""
    value = 100 * share
    if 0 < value < 0.001:
        return '< 0.001 %'
    if 99.9 < value < 100:
        return '> 99.9 %'
    return f'{even(value) if value < 100 else digits(value)} %'


def tenths(value: float) -> str:
    """Write with one decimal place, for columns that are compared."""
    return f'{value:,.1f}'


def between(values: Iterable[float], form: Callable[[float], str] = digits) -> str:
    """Write the range of values: `1.2 to 3.4`, or `1.2` where there is but one."""
    ordered = sorted(values)
    low, high = form(ordered[0]), form(ordered[-1])
    return low if low == high else f'{low} to {high}'


def duration(seconds: float) -> str:
    """Write a time of seconds or minutes."""
    if seconds >= 120 and seconds % 60 == 0:
        return f'{digits(seconds / 60)} minutes'
    return f'{digits(seconds)} s'


def named(words: Iterable[str]) -> str:
    """Write a list: `a, b and c`."""
    *first, last = words
    return f'{", ".join(first)} and {last}' if first else last


def _signed(text: str) -> str:
    return text.replace('-', '\N{MINUS SIGN}')


def plain(text: object) -> str:
    """Words that Markdown takes for words; of one line."""
    said = str(text)
    for sign in '\\`*_|<[]#':
        said = said.replace(sign, '&lt;' if sign == '<' else f'\\{sign}')
    return ' '.join(said.split())
