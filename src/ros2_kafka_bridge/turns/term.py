"""The time for which this bridge, and no other, runs a route; and that in which it stands by."""

import time
from collections.abc import Mapping
from typing import Final, Protocol

from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.turns.overlap import MOST_AT_END_S, Overlap

# A second is usual after a lock was left, 5.2 s were seen on a busy machine; one that has stood
# still is told late that the other reads.
_COMING_S: Final = 10.0
_LEAVING_S: Final = 7.5  # Kafka is asked who stands by, and the lock is left

OVERLAP_S: Final = _LEAVING_S + _COMING_S + MOST_AT_END_S
"""How long one that ends waits at most for the bridge that goes on."""

_LOOK_S: Final = 0.1


class TurnLock(Protocol):
    """The exclusive right to run a route (`kafka.lock.GroupLock`)."""

    @property
    def held(self) -> bool:
        """Whether it is ours, as far as is known."""
        ...

    def poll(self, timeout_s: float) -> None:
        """Learn whether it still is."""

    def has_standby(self) -> bool:
        """Whether another bridge stands by."""
        ...

    def close(self) -> None:
        """Leave it to another."""


class Successor(Protocol):
    """Another bridge that is to read the ROS topic (`ros.successor.RosSuccessor`)."""

    def note_readers(self, *, may_read: bool) -> None:
        """Note who reads now.

        Args:
            may_read: Whether it may be one of them already.
        """

    def is_needed(self) -> bool:
        """Whether what is published while nobody reads would be lost."""
        ...

    def has_come(self) -> bool:
        """Whether one reads that was not noted then."""
        ...


class _Listener:
    """Polls a lock at most every 0.1 s, however often it is called.

    Whoever looks at a stop listens by it: a route needs no second thread for its lock.

    Args:
        lock: The lock.
    """

    def __init__(self, lock: TurnLock) -> None:
        self._lock = lock
        self._again_at_s = 0.0

    def listen(self) -> bool:
        """Poll the lock, unless that was done just now; tells whether it was polled."""
        now_s = time.monotonic()
        if now_s < self._again_at_s:
            return False
        self._again_at_s = now_s + _LOOK_S
        self._lock.poll(0.0)
        return True


class Standby(Stop):
    """The stop of what a bridge does while another runs the route: the lock ends it, too.

    Args:
        stop: That of the bridge.
        lock: Not held, at the beginning.
    """

    look_s = _LOOK_S

    def __init__(self, stop: Stop, lock: TurnLock) -> None:
        super().__init__(stop.wakeup)
        self._stop = stop
        self._lock = lock
        self._listener = _Listener(lock)

    def look(self) -> bool:
        """Learn whether the turn of this bridge has come; tells whether to drain."""
        self.listen()
        return self.asked

    def listen(self) -> None:
        """Learn whether the turn of this bridge has come."""
        self._listener.listen()

    @property
    def asked(self) -> bool:
        """Whether to drain."""
        return self._stop.asked or self._lock.held

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight."""
        return self._stop.at_once


class Term(Stop):
    """The stop that a route looks at while it runs by a lock: it comes also when that is lost.

    When the bridge stops, the lock goes to another first. Then, and where Kafka has given it to
    another, the route runs on until that one reads, too: nothing is published to nobody. What
    both have taken is twice in Kafka.

    Args:
        stop: That of the bridge.
        lock: Held, at the beginning.
        successor: Who is to go on after a stop.
    """

    look_s = _LOOK_S

    def __init__(self, stop: Stop, lock: TurnLock, successor: Successor) -> None:
        super().__init__(stop.wakeup)
        self._stop = stop
        self._lock = lock
        self._listener = _Listener(lock)
        self._successor = successor
        self._look_at_s = 0.0  # for the successor
        self._over = False
        self._drains = False
        self._left = False  # the lock is another's, because this bridge stops
        self._waits_until_s: float | None = None  # for the successor
        self._overlap: Overlap | None = None  # with the successor

    def look(self) -> bool:
        """Learn whether the lock is still held; at the end of the term, look for the successor.

        That end may take a while (`OVERLAP_S`), and the first look at it as long as Kafka does to
        tell who stands by, and to let this one leave.

        Returns:
            Whether to drain.
        """
        self.listen()
        if not self._drains and (self._over or self._stop.asked):
            self._drains = self._stop.at_once or not self._run_on()
        return self._drains

    def listen(self) -> None:
        """Learn whether the lock is still held."""
        if self._left or not self._listener.listen():
            return
        if self._over and self._lock.held and not self._drains:
            self._over, self._waits_until_s, self._overlap = False, None, None
        self._over = self._over or not self._lock.held

    @property
    def over(self) -> bool:
        """Whether the lock was lost; once a drain has begun for it, this term is over."""
        return self._over

    @property
    def asked(self) -> bool:
        """Whether to drain."""
        return self._drains

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight."""
        return self._stop.at_once

    @property
    def is_end(self) -> bool:
        """Whether the bridge stops; where it only hands over, it can wait for what it holds."""
        return self._stop.asked

    def note_taken(self, newest: Mapping[bytes, int] | None) -> None:
        """Note what a take has brought: what the successor may not have is waited for."""
        if self._overlap is not None:
            self._overlap.note(newest)

    @property
    def overlaps(self) -> bool:
        """Whether the successor reads, too: it counts now what is taken meanwhile."""
        return self._overlap is not None

    def _run_on(self) -> bool:
        """Read on at the end, because no other bridge does yet; tells whether it is too early."""
        if self._waits_until_s is None:
            if not self._leave():
                return False
            self._waits_until_s = time.monotonic() + _COMING_S
        if self._overlap is None and self._may_read(self._waits_until_s):
            self._overlap = Overlap()
        return self._overlap is None or not self._overlap.is_over(is_end=self.is_end)

    def _may_read(self, until_s: float) -> bool:
        """Whether the successor reads, or may: not every graph shows it, nor at once."""
        now_s = time.monotonic()
        if now_s >= until_s:
            return True
        if now_s < self._look_at_s:
            return False
        self._look_at_s = now_s + _LOOK_S
        return self._successor.has_come()

    def _leave(self) -> bool:
        """Leave the lock to a bridge that stands by; tells whether one is to be waited for."""
        self._successor.note_readers(may_read=self._over)
        if not self._successor.is_needed():
            return False
        if not self._over:
            if not self._lock.has_standby():
                return False
            self._lock.close()
            self._left = True
        return True
