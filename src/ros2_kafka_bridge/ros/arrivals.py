"""Which topics may have messages: DDS itself tells, so it costs what is ready, not what is there.

A wait set is filled anew for each wait, and asks every subscription in it. Here each topic has an
eventfd that DDS writes to when a message comes.
"""

import contextlib
import math
import select
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any, Final

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.threads.wakeup import Wakeup

# Where a middleware tells nothing, all topics are looked at, again and again.
_UNTOLD_S: Final = 0.01


@contextmanager
def enough_files() -> Iterator[None]:
    """Say what helps where this process may open no more files.

    Raises:
        RouteError: So it is.
    """
    try:
        yield
    except OSError as error:
        raise RouteError(
            f'{error.strerror}: raise the limit of open files of the bridge (ulimit -Hn, '
            'LimitNOFILE of systemd)'
        ) from error


class _Limit:
    """How long waits may last, all of them and the next one."""

    def __init__(self) -> None:
        self._all_s = self._next_s = math.inf

    def next_wait(self, limit_s: float) -> None:
        """Let the next wait last no longer."""
        self._next_s = min(self._next_s, limit_s)

    def all_waits(self, limit_s: float) -> None:
        """Let no wait last longer from now on."""
        self._all_s = limit_s

    def taken(self, timeout_s: float) -> float:
        """How long a wait lasts that begins now."""
        limit_s, self._next_s = min(self._next_s, self._all_s), math.inf
        return min(limit_s, timeout_s)


class Notifier:
    """Lets the subscriptions of one topic ring when a message comes.

    Args:
        limit: Of the waits for it.
    """

    def __init__(self, limit: _Limit) -> None:
        self.wakeup = Wakeup()
        self._limit = limit
        self._may_ring = False  # a subscription that it was attached to

    def attach(self, subscription: Any) -> None:
        """Let a subscription of rclpy ring; also for messages that are there."""
        from ros2_kafka_bridge.ros import rcl  # noqa: PLC0415 (heavy)

        rings = False
        with contextlib.suppress(Exception):  # what is wrong with it, the next take tells
            rings = rcl.notify(subscription, self.wakeup)
        self._may_ring = self._may_ring or rings
        if not rings:
            self._limit.all_waits(_UNTOLD_S)

    def look_again(self, within_s: float) -> None:
        """Let the next wait last no longer: the topic has something to look at then."""
        self._limit.next_wait(within_s)

    def detach(self, subscription: Any) -> None:
        """Let it ring no more."""
        from ros2_kafka_bridge.ros import rcl  # noqa: PLC0415 (heavy)

        is_silent = False
        with contextlib.suppress(Exception):  # it may be of no use any more: then it is left
            is_silent = rcl.notify_nobody(subscription)
        if self._may_ring and not is_silent:
            self.wakeup.keep_open()


class Arrivals:
    """Waits for messages of many topics, or until somebody ends the wait.

    Args:
        wakeup: By which others end it.
    """

    def __init__(self, wakeup: Wakeup) -> None:
        self._wakeup = wakeup
        self._ready = select.epoll()
        self._ready.register(wakeup.descriptor, select.EPOLLIN)
        self._limit = _Limit()
        self._topics: dict[int, tuple[str, Notifier]] = {}  # by descriptor

    def of(self, topic: str) -> Notifier:
        """Make what tells of the messages of one topic."""
        notifier = Notifier(self._limit)
        descriptor = notifier.wakeup.descriptor
        self._topics[descriptor] = topic, notifier
        self._ready.register(descriptor, select.EPOLLIN)
        return notifier

    def wait(self, timeout_s: float) -> Collection[str]:
        """Wait up to `timeout_s`.

        Returns:
            The topics on which something came; none where the wait has ended otherwise.
        """
        ready = []
        for descriptor, _ in self._ready.poll(self._limit.taken(timeout_s)):
            if descriptor == self._wakeup.descriptor:
                self._wakeup.clear()
                continue
            topic, notifier = self._topics[descriptor]
            notifier.wakeup.clear()  # before the take: what comes from now on rings again
            ready.append(topic)
        return ready
