"""Lines that repeat are summed: the first few at once, then one a period, the rest at the end."""

import logging
import re
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from ros2_kafka_bridge.errors import About
from ros2_kafka_bridge.logs.text import count

FIRST: Final = 5
PERIOD_S: Final = 10.0
_MOST_KINDS: Final = 64
_OTHERS: Final = 'others'
# What differs between two lines of one kind: places, numbers, ids, quoted values.
_DETAIL: Final = re.compile(r"""[0-9a-f]{16,}|\d+|'[^']*'|"[^"]*\"""")


@dataclass(slots=True)
class _Kind:
    """What was said of one kind, and what was kept back since."""

    since_s: float
    said: int = 0
    kept_back: int = 0
    level: int = 0
    text: str = ''
    more: str = ''
    about: About | None = None
    bug: Exception | None = None


class Summed:
    """Says the first lines of each kind at once, then how many more came, once a period.

    Kinds do not count against each other. One that has been quiet for a period begins anew.
    Any thread may use it.

    Args:
        log: Where to say it.
        first: How many of each kind are said at once.
        period_s: How often the others are summed.
    """

    def __init__(
        self,
        log: logging.LoggerAdapter[logging.Logger],
        first: int = FIRST,
        period_s: float = PERIOD_S,
    ) -> None:
        self._log = log
        self._first = first
        self._period_s = period_s
        self._kinds: dict[str, _Kind] = {}
        self._lock = threading.Lock()

    def info(
        self, text: str, more: str = '', *, about: About | None = None, kind: str = ''
    ) -> None:
        """Say what may be worth knowing; see `warning`."""
        self._say(_Kind(0.0, 0, 0, logging.INFO, text, more, about), kind)

    def warning(
        self,
        text: str,
        more: str = '',
        *,
        about: About | None = None,
        kind: str = '',
        first: int | None = None,
    ) -> None:
        """Say a warning, at once or in a sum.

        Args:
            text: What has happened.
            more: What follows it.
            about: The record or message.
            kind: What it is summed with; without it, whatever differs in numbers, ids and quoted
                values only.
            first: How many of it are said at once; without it as many as of any kind.
        """
        self._say(_Kind(0.0, 0, 0, logging.WARNING, text, more, about), kind, first)

    def error(
        self,
        text: str,
        more: str = '',
        *,
        about: About | None = None,
        kind: str = '',
        bug: Exception | None = None,
    ) -> None:
        """Say an error, with the traceback of a bug; see `warning`."""
        self._say(_Kind(0.0, 0, 0, logging.ERROR, text, more, about, bug), kind)

    def tick(self) -> None:
        """Say what was kept back for a period; to be called now and then."""
        now_s = time.monotonic()
        with self._lock:
            for name, kind in list(self._kinds.items()):
                if now_s - kind.since_s >= self._period_s:
                    self._sum(name, kind, now_s)

    def close(self) -> None:
        """Say all that was kept back."""
        with self._lock:
            for name, kind in list(self._kinds.items()):
                self._sum(name, kind, 0.0)
            self._kinds.clear()

    def _say(self, line: _Kind, name: str, first: int | None = None) -> None:
        now_s = time.monotonic()
        with self._lock:
            name = self._room_for(name or _DETAIL.sub('#', line.text), now_s)
            kind = self._kinds.get(name)
            if kind is None or (self._is_over(kind, now_s) and not kind.kept_back):
                kind = self._kinds[name] = _Kind(now_s)
            kind.level, kind.text, kind.more, kind.about, kind.bug = (
                line.level, line.text, line.more, line.about, line.bug,
            )  # fmt: skip
            if kind.said < (first or self._first):
                kind.said += 1
                self._write(kind, '', None)
                return
            kind.kept_back += 1
            if self._is_over(kind, now_s):
                self._sum(name, kind, now_s)

    def _room_for(self, name: str, now_s: float) -> str:
        """The name, or where there are too many of them one for all others."""
        if name in self._kinds or len(self._kinds) < _MOST_KINDS:
            return name
        for quiet in [n for n, kind in self._kinds.items() if self._is_over(kind, now_s)]:
            self._sum(quiet, self._kinds.pop(quiet), now_s)
        return name if len(self._kinds) < _MOST_KINDS else _OTHERS

    def _is_over(self, kind: _Kind, now_s: float) -> bool:
        return now_s - kind.since_s >= self._period_s

    def _sum(self, name: str, kind: _Kind, now_s: float) -> None:
        """Say how many were kept back; forget a kind of which there were none."""
        if kind.kept_back:
            again = f' ({count(kind.kept_back, "time")} more)'
            self._write(kind, again, {'times': kind.kept_back})
            kind.since_s, kind.kept_back = now_s, 0
        else:
            self._kinds.pop(name, None)

    def _write(self, kind: _Kind, again: str, extra: Mapping[str, Any] | None) -> None:
        told = {'about': kind.about, **(extra or {})}
        self._log.log(
            kind.level, '%s%s%s', kind.text, again, kind.more, extra=told, exc_info=kind.bug
        )
        kind.bug = None  # its traceback holds the record, and all that was made of it
