"""Which letters are meant: by route, reason, time and place."""

import re
from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta
from typing import Final, NamedTuple

from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark
from ros2_kafka_bridge.errors import ConfigError

_AGE: Final = re.compile(r'(\d{1,9}(?:\.\d{1,9})?)\s*([smhdw])', re.ASCII)
_UNITS: Final = {'s': 'seconds', 'm': 'minutes', 'h': 'hours', 'd': 'days', 'w': 'weeks'}


class LetterFilter(NamedTuple):
    """Which letters are asked for; None and empty ask for all.

    Args:
        route: Name of the route.
        reason: A text or a regular expression that the reason holds.
        since_ms: The first time, since 1970; that of the letter's record counts.
        until_ms: The time before which it was written.
        partition: Of the dead-letter topic.
        offset: In that partition.
        limit: How many, the oldest first.
        places: These letters and no others.
    """

    route: str = ''
    reason: str = ''
    since_ms: int | None = None
    until_ms: int | None = None
    partition: int | None = None
    offset: int | None = None
    limit: int | None = None
    places: frozenset[LetterPlace] | None = None

    @property
    def is_narrow(self) -> bool:
        """Whether it leaves any out."""
        return self != LetterFilter()

    def fits(self, letter: Letter) -> bool:
        """Whether this letter is meant; the limit is left to the caller."""
        about = letter.about
        return (
            (not self.route or (about is not None and about.route == self.route))
            and (not self.reason or (about is not None and self._has_reason(about.reason)))
            and (self.since_ms is None or letter.time_ms >= self.since_ms)
            and (self.until_ms is None or letter.time_ms < self.until_ms)
            and self.partition in {None, letter.place.partition}
            and self.offset in {None, letter.place.offset}
            and (self.places is None or letter.place in self.places)
        )

    def _has_reason(self, reason: str) -> bool:
        if self.reason in reason:
            return True
        try:
            return re.search(self.reason, reason) is not None
        except re.error:  # then it was meant as a text
            return False


class Index(NamedTuple):
    """Letters without values and headers, in the order of each partition, and all marks."""

    letters: list[Letter]
    marks: dict[LetterPlace, Mark]


def read_index(found: Iterable[Letter | Mark], letter_filter: LetterFilter) -> Index:
    """Keep the letters that are meant, and where each was replayed to."""
    index = Index([], {})
    for one in found:
        if isinstance(one, Mark):
            index.marks[one.letter] = one
        elif letter_filter.fits(one):
            index.letters.append(one._replace(value=None, headers=[]))
    return index


def limited(letters: Iterable[Letter], limit: int | None) -> Iterator[Letter]:
    """The first of them."""
    for number, letter in enumerate(letters):
        if limit is not None and number >= limit:
            return
        yield letter


def time_ms(text: str, option: str, now: datetime) -> int | None:
    """Read a time: ISO (local where it names no zone), or an age such as 2h; None if empty.

    Raises:
        ConfigError: It is neither.
    """
    if not text:
        return None
    if age := _AGE.fullmatch(text.strip()):
        try:
            moment = now - timedelta(**{_UNITS[age[2]]: float(age[1])})
        except OverflowError:
            moment = datetime.fromtimestamp(0, now.tzinfo)
    else:
        try:
            moment = datetime.fromisoformat(text.strip()).astimezone()
        except (ValueError, OverflowError):
            what = 'a time such as 2026-01-31T08:00, or an age such as 90s, 30m, 2h, 7d'
            raise ConfigError([f'{option}: {text!r} is not {what}']) from None
    return max(0, int(moment.timestamp() * 1000))
