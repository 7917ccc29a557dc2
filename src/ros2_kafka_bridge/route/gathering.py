"""When messages that were taken are sent: at once where they come seldom, together where often."""

import time
from collections.abc import Callable
from typing import Final

# A wake-up costs as much as ten messages, a request as much as a hundred. Where messages come
# often, a short rest lets the next ones gather; where they come seldom, none waits for another.
_OFTEN_PER_S: Final = 2000.0
_SMALL_BATCH: Final = 50
_GATHER_S: Final = 0.001


class Gathering:
    """Lets messages gather before they are sent.

    Args:
        hurry: Sends what was produced at once.
    """

    def __init__(self, hurry: Callable[[], None]) -> None:
        self._hurry = hurry
        self._taken_at_s = 0.0

    def send(self, taken: int) -> None:
        """Send a batch that was taken and produced, or rest for the next one."""
        now_s = time.monotonic()
        if 0 < taken < _SMALL_BATCH:
            if taken > _OFTEN_PER_S * (now_s - self._taken_at_s):
                time.sleep(_GATHER_S)
            else:
                self._hurry()
        self._taken_at_s = now_s
