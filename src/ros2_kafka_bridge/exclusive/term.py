"""The time for which this bridge, and no other, runs a route; and how it hands the route over."""

import threading
import time
from collections.abc import Sequence
from typing import Final, Protocol

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.exclusive.handover_window import MOST_AT_END_S, HandoverWindow
from ros2_kafka_bridge.threads.stop import Stop

# A second is usual after a lock was left, 5.2 s were seen on a busy machine; one that has stood
# still is told late that the other reads.
_COMING_S: Final = 10.0
_LEAVING_S: Final = 7.5  # Kafka is asked who stands by, and the lock is left

HANDOVER_S: Final = _LEAVING_S + _COMING_S + MOST_AT_END_S
"""How long one that ends waits at most for the bridge that goes on."""


class RouteLock(Protocol):
    """The exclusive right to run a route (`kafka.lock.GroupLock`)."""

    @property
    def held(self) -> bool:
        """Whether it is ours, as far as is known."""

    def poll(self, timeout_s: float) -> None:
        """Learn whether it still is."""

    def has_standby(self) -> bool:
        """Whether another bridge stands by."""

    def close(self) -> None:
        """Leave it to another."""


class Successor(Protocol):
    """Another bridge that is to read the ROS topic (`ros.successor.SuccessorWatch`)."""

    def note_readers(self, *, may_read: bool) -> None:
        """Note who reads now.

        Args:
            may_read: Whether it may be one of them already.
        """

    def is_needed(self) -> bool:
        """Whether what is published while nobody reads would be lost."""

    def has_come(self) -> bool:
        """Whether one reads that was not noted then."""


class Term:
    """Ends what runs a route when the bridge stops, or the lock is lost, and not too early.

    When the bridge stops, the lock goes to another first. Then, and where Kafka has given it to
    another, the route runs on until that one reads, too: nothing is published to nobody. What
    both have taken is twice in Kafka.

    Args:
        whole: The stop of the route in this bridge.
        lock: Held, at the beginning.
        successor: Who is to go on after it.
    """

    def __init__(self, whole: Stop, lock: RouteLock, successor: Successor) -> None:
        self.is_lost = False  # the lock, and this bridge has not got it back in time
        self.guard = threading.RLock()  # of the lock: the thread of the route uses it, too
        self._whole = whole
        self._lock = lock
        self._successor = successor
        self._is_over = False
        self._has_left = False  # the lock: this bridge stops, or cannot run the route
        self._waits_until_s: float | None = None  # for the successor
        self._window: HandoverWindow | None = None  # with the successor
        self._taken_at_s = time.monotonic()

    def step(self, *, takes: bool) -> bool:
        """Learn whether the lock is still held; at the end, look for the successor.

        Called each 0.1 s. That end may take a while (`HANDOVER_S`), and its first step as long as
        Kafka does to tell who stands by, and to let this one leave.

        Args:
            takes: Whether the route takes messages now, as far as there is room for them.

        Returns:
            Whether the route is to drain.
        """
        with self.guard:
            self.listen()
            if not self._is_over and (self.is_lost or self._whole.asked):
                self._is_over = self._whole.at_once or not self._takes_on(takes=takes)
            return self._is_over

    def listen(self) -> None:
        """Learn whether the lock is still held; with the guard held."""
        if self._has_left:
            return
        self._lock.poll(0.0)
        if self.is_lost and self._lock.held and not self._is_over:
            self.is_lost, self._waits_until_s, self._window = False, None, None
        self.is_lost = self.is_lost or not self._lock.held

    def has_standby(self) -> bool:
        """Whether another bridge stands by; asked with the guard held."""
        return self._lock.has_standby()

    def leave(self) -> None:
        """Leave the lock to a bridge that stands by; with the guard held."""
        self._lock.close()
        self._has_left = True

    def note_taken(self, messages: Sequence[Message]) -> None:
        """Note what a take has brought: what the successor may not have is waited for."""
        self._taken_at_s = time.monotonic()
        if (window := self._window) is not None:
            window.note({message.gid: message.source_time_ns for message in messages})

    def _takes_on(self, *, takes: bool) -> bool:
        """Take on at the end, because no other bridge does yet; tells whether it is too early."""
        if self._waits_until_s is None:
            if not self._leave_if_needed():
                return False
            self._waits_until_s = time.monotonic() + _COMING_S
        if self._window is None:
            if time.monotonic() < self._waits_until_s and not self._successor.has_come():
                return True
            # It takes, or may: not every graph shows it, nor at once.
            self._window = HandoverWindow(self._taken_at_s)
        self._whole.wakeup.ring()  # a take that waits for long would tell nothing meanwhile
        return not self._window.is_over(is_end=self._whole.asked, takes=takes)

    def _leave_if_needed(self) -> bool:
        """Leave the lock to a bridge that stands by; tells whether one is to be waited for."""
        self._successor.note_readers(may_read=self.is_lost)
        if not self._successor.is_needed():
            return False
        if not self.is_lost:
            if not self.has_standby():
                return False
            self.leave()
        return True
