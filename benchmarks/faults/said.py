"""What bridges have said of a route, read from the lines of their logs."""

import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Final

_TIME_CHARS: Final = len('2026-01-31 12:00:00,000')
_SAID: Final = r'\S+ \S+ (?:INFO|WARNING) +(\S+): '
_LOST: Final = re.compile(f'{_SAID}(?:lost|hands over) ')
_WAITS: Final = r'(?:waiting \()?its turn has come'  # and is said again while it waits
_HANDED: Final = re.compile(f'{_SAID}(?:takes over: |hands over: |{_WAITS})')


def hand_overs_ns(route: str, lines: Iterable[str], *, is_from_kafka: bool) -> list[int]:
    """When a route went from one bridge to another, in nanoseconds since 1970, ascending."""
    said = _LOST if is_from_kafka else _HANDED
    found = [_time_ns(line) for line in lines if (told := said.match(line)) and told[1] == route]
    # The first bridge to take a route has it from nobody.
    return sorted(found)[0 if is_from_kafka else 1 :]


def last_of(route: str, lines: Sequence[str]) -> str:
    """What a bridge has said last of a route."""
    return next((line for line in reversed(lines) if f' {route}: ' in line), 'nothing')


def _time_ns(line: str) -> int:
    said = datetime.strptime(line[:_TIME_CHARS], '%Y-%m-%d %H:%M:%S,%f').astimezone()
    return int(said.timestamp() * 1e9)
