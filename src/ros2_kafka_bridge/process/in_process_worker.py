"""The bridge of this process, as one of the workers that it looks after itself."""

import math
import os
import time
from collections import deque
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.process.orders import run_order
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import ORDERS, Begun, Drain, Event
from ros2_kafka_bridge.route.counters import to_line
from ros2_kafka_bridge.threads.wakeup import Wakeup

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge, Tell

_PERIOD_S: Final = 1.0


class InProcessWorker:
    """Speaks as a `ChildProcess`, but is not started again: it ends with its process.

    Args:
        bridge: With all routes.
        wakeup: Rung for whoever looks after it, when it has something to tell.
        tells_often: Whether it tells the counters of its routes before its end.
    """

    is_due = False
    next_look_s = math.inf

    def __init__(self, bridge: 'Bridge', wakeup: Wakeup, *, tells_often: bool) -> None:
        self.has_begun = False
        self._bridge = bridge
        self._wakeup = wakeup
        self._told: deque[bytes] = deque()
        self._next_s = 0.0 if tells_often else math.inf
        self._drains = 0
        self._status: int | None = None  # of a bridge that has ended
        self._was_taken = False
        bridge.stop.wake_also(wakeup)

    def run(self, tell: 'Tell') -> int:
        """Run the bridge to its end, in the thread that calls; returns its status.

        Args:
            tell: Told of what happens, too.
        """

        def told(event: Event) -> None:
            self.has_begun = self.has_begun or isinstance(event, Begun)
            self._told.append(wire.to_line(event))
            self._wakeup.ring()
            tell(event)

        status = 1
        try:
            status = self._bridge.run(told)
        finally:
            self._status = status
            self._wakeup.ring()
        return status

    @property
    def pid(self) -> int:
        """The id of this process."""
        return os.getpid()

    @property
    def is_running(self) -> bool:
        """Whether its end is still to come, or to be taken."""
        return not self._was_taken

    @property
    def is_stopping(self) -> bool:
        """Whether it was asked to stop, also by itself, as after a bug in a route."""
        return self._bridge.stop.asked

    def send(self, line: bytes) -> None:
        """Let it do what an order says."""
        order = ORDERS.decode(line)
        if isinstance(order, Drain):
            self._drains += 1
            if self._drains == 1 and self.is_stopping:
                return  # by itself: once more would be an end at once
        run_order(self._bridge, order)

    def exchange(self) -> list[bytes]:
        """The lines that it has told since, and the counters of its routes.

        These are told once a second and beside each event, where they are told often; and at the
        end.
        """
        lines = [self._told.popleft() for _ in range(len(self._told))]
        now_s = time.monotonic()
        if self._was_taken or now_s >= self._next_s or (lines and self._next_s < math.inf):
            self._next_s = max(self._next_s, now_s + _PERIOD_S)
            lines.append(to_line(self._bridge.snapshots()))
        return lines

    def exit_status(self) -> int | None:
        """Its status, once it has ended."""
        if self._was_taken or self._status is None:
            return None
        self._was_taken = True
        return self._status

    def close(self) -> None:
        """It has no pipe."""
