"""The time in which two bridges read one ROS topic: one goes, and the other has just come."""

import threading
import time
from collections.abc import Mapping
from typing import Final

KNOWN_S: Final = 3.5
"""How long DDS may take to make a process known that has just begun.

Until then a publisher may not send to its readers. Of 58 readers that were made 0.7 s after their
process had begun, seven were sent to 1.4 to 2.4 s later, the others within 0.4 s; all of 299 in a
process that was known within 15 ms (Fast DDS, one machine).
"""

MOST_S: Final = 30.0
"""How long the window may last; the next bridge may wait for the spool of this one meanwhile."""

MOST_AT_END_S: Final = 10.0
"""The same where the bridge stops: somebody waits for its end."""

# A publisher sends again what a reader has missed at its next heartbeat, every 3 s by default. One
# that has stood still may miss two of them: Fast DDS took its shared memory for that of a dead
# process, and makes it anew (of 24 on a machine with ten times the load it bears, one heard the
# first after 7.2 s).
_QUIET_S: Final = 10.0
_HELD_UP_S: Final = 1.0


class HandoverWindow:
    """Tells when the bridge that goes has taken what the other may not have.

    That is what was published before the publishers knew the other. That nothing is left to take
    does not tell: of what was published while a bridge stood still, its reader has only what
    found room; the rest comes by and by. So each publisher has to be heard with something newer,
    or not at all for longer than a heartbeat. How far its clock is ahead of this one and how long
    it takes to know the other may be `KNOWN_S` together.

    One thread takes, and another one asks.

    Args:
        taken_at_s: When something could be taken last, by the monotonic clock.
    """

    def __init__(self, taken_at_s: float) -> None:
        self._newer_ns = time.time_ns() + int(KNOWN_S * 1e9)
        self._began_s = self._listens_since_s = self._older_at_s = time.monotonic()
        self._taken_at_s = taken_at_s
        self._older: set[bytes] = set()  # the publishers that were heard with nothing newer yet
        self._lock = threading.Lock()

    def note(self, newest: Mapping[bytes, int]) -> None:
        """Note what a take has brought; while there was none, nothing could be heard.

        Args:
            newest: Publisher -> when its newest message was published, in ns since 1970.
        """
        with self._lock:
            now_s = time.monotonic()
            if now_s - self._taken_at_s > _HELD_UP_S:
                self._listens_since_s = now_s
            self._taken_at_s = now_s
            older = {gid for gid, published_ns in newest.items() if published_ns < self._newer_ns}
            self._older = self._older - newest.keys() | older
            if older:
                self._older_at_s = now_s

    def is_over(self, *, is_end: bool, takes: bool) -> bool:
        """Whether nothing is to come any more that the other has not.

        Args:
            is_end: Whether the bridge stops; one that goes on has more time.
            takes: Whether takes are to be expected; they may be held up.
        """
        with self._lock:
            now_s = time.monotonic()
            most_s, quiet_s = (MOST_AT_END_S, KNOWN_S) if is_end else (MOST_S, _QUIET_S)
            since_s = self._older_at_s if self._older else self._began_s
            quiet_since_s = max(since_s, self._listens_since_s)
            heard_s = self._taken_at_s if takes else now_s
            return heard_s - quiet_since_s >= quiet_s or now_s - self._began_s >= most_s
