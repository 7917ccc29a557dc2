"""How long a route waits for what comes next, while it has nothing else to do."""

import time
from typing import Final

_SHORT_S: Final = 0.1
_LONG_S: Final = 5.0
# By then all has been committed, and told, that the last work has left behind.
_CALM_AFTER_S: Final = 1.5


class Idling:
    """Lets a route wait for long once it has had nothing to do for a while.

    A wait ends with what comes, and by the wakeup of the route; so a long one delays nothing, and
    a route that is idle looks around every few seconds.

    Args:
        busy_s: How long it waits while something is in flight.
    """

    def __init__(self, busy_s: float) -> None:
        self._busy_s = busy_s
        self._busy_at_s = 0.0

    def note_work(self) -> None:
        """Note that the route has, or had just now, something to do."""
        self._busy_at_s = time.monotonic()

    @property
    def is_calm(self) -> bool:
        """Whether the route has had nothing to do for a while."""
        return time.monotonic() - self._busy_at_s >= _CALM_AFTER_S

    def wait_s(self, *, busy: bool) -> float:
        """How long to wait now.

        Args:
            busy: Whether something is in flight.
        """
        if busy:
            self.note_work()
            return self._busy_s
        return _LONG_S if self.is_calm else _SHORT_S
