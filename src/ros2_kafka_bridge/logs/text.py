"""Numbers with their nouns, times of day; and text of others, made safe to be shown."""

import re
from datetime import datetime, timedelta
from typing import Final

# Control characters, line ends, marks that turn the direction of writing, and lone surrogates.
_HOSTILE: Final = re.compile(
    '[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]'
)


def in_mb(size_bytes: int) -> str:
    """Say how much it is, rounded up: `111 MB`."""
    return f'{-(-size_bytes // 1_000_000):,} MB'


def count(number: int, thing: str) -> str:
    """Say how many there are of a thing: `1 route`, `2 routes`."""
    return f'{number} {thing}' if number == 1 else f'{number} {thing}s'


def clock_time(ago_s: float = 0.0) -> str:
    """What the clock of the log showed so many seconds ago."""
    return (datetime.now().astimezone() - timedelta(seconds=ago_s)).strftime('%H:%M:%S')


def printable(text: str) -> str:
    r"""Write what no line may hold as its escape, such as \n or \x1b."""
    return _HOSTILE.sub(_escaped, text)


def printable_lines(text: str) -> str:
    """The same, but for the ends of lines."""
    return '\n'.join(map(printable, text.split('\n')))


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode('unicode_escape').decode()
