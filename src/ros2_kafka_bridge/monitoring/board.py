"""The sections that the page shows, each as JSON with the number of its last change."""

import threading
from typing import Any

import msgspec


class Board:
    """Holds each section as it is now, for everybody who looks.

    Each method may be called from any thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sections: dict[str, tuple[int, bytes]] = {}
        self._number = 0

    def put(self, name: str, content: Any) -> None:
        """Show a section; one that is as before counts as unchanged."""
        data = msgspec.json.encode(content)
        with self._lock:
            if self._sections.get(name, (0, b''))[1] != data:
                self._number += 1
                self._sections[name] = self._number, data

    def clear(self) -> None:
        """Show nothing: it would be old before somebody looks again."""
        with self._lock:
            self._sections.clear()

    def newer(self, seen: dict[str, int]) -> bytes:
        """A JSON object of the sections that have changed since; empty if none has.

        Args:
            seen: Which change of each section was seen last; brought up to date.
        """
        with self._lock:
            changed = {n: it for n, it in self._sections.items() if it[0] != seen.get(n)}
        seen.update({name: number for name, (number, _) in changed.items()})
        if not changed:
            return b''
        parts = (b'"%s":%s' % (name.encode(), data) for name, (_, data) in changed.items())
        return b'{' + b','.join(parts) + b'}'
