"""The orders' whole way through the bridge: start, send, wait, end, count."""

import math
import time
from collections.abc import Callable
from typing import Final, NamedTuple

from ros2_kafka_bridge.demo.child import Child
from ros2_kafka_bridge.demo.ends import DemoEnds
from ros2_kafka_bridge.demo.table import Look
from ros2_kafka_bridge.demo.tally import Tally
from ros2_kafka_bridge.demo.traffic import Receiver, Sender
from ros2_kafka_bridge.threads.stop import Stop

START_S: Final = 60.0
# How long nothing may arrive until what is missing counts as lost: for a bridge that knows of
# nothing any more, and for one that still holds messages, or has not read all.
_QUIET_S: Final = 3.0
_QUIET_HOLDING_S: Final = 30.0
_END_S: Final = 20.0
_READ_S: Final = 20.0
_LOOK_S: Final = 0.5
_STEP_S: Final = 0.05


class SendPlan(NamedTuple):
    """What is sent: `total` orders, `rate` a second."""

    rate: float
    total: int


class Trip:
    """The bridge, the orders, and what became of them.

    Args:
        ends: What the bridge joins.
        bridge: Its process, not started yet.
        plan: How many orders, how fast.
        stop: Asks for an early end.
        show: Called again and again while the orders move.
    """

    def __init__(
        self,
        ends: DemoEnds,
        bridge: Child,
        plan: SendPlan,
        stop: Stop,
        show: Callable[[Look], None],
    ) -> None:
        self.problems: list[str] = []
        self._ends = ends
        self._bridge = bridge
        self._stop = stop
        self._show = show
        self._phase = 'starting'
        self._tally = Tally()
        self._sender = Sender({'bootstrap.servers': ends.bootstrap_servers}, ends.source, *plan)
        self._receiver = Receiver(ends.consumer, ends.sink)

    def run(self) -> Look:
        """Carry the orders; returns what is known at the end."""
        with self._sender, self._bridge, self._receiver:
            if self._ready():
                self._send()
                self._settle()
            self._end()
            self._count_rest()
        self._phase = 'done'
        final = self._look(final=True)
        self._show(final)
        return final

    def _ready(self) -> bool:
        """Wait until an order that does not count has come through."""
        self._sender.probe()
        come = self._receiver.probed.is_set
        if not self._until(lambda: come() or self._stop.asked or self._broken(), START_S):
            self.problems.append(f'bridge: not one order came through in {START_S:.0f} s')
        return come() and not self._stop.asked

    def _send(self) -> None:
        self._phase = 'sending'
        self._sender.start()
        self._receiver.started_s = self._sender.started_s
        self._until(lambda: self._stop.asked or self._broken() or not self._sender.sends)
        self._sender.stop()
        self._phase = 'waiting for the rest'
        self._until(lambda: not self._sender.sends)
        if untaken := self._sender.sent - self._sender.produced:
            self.problems.append(f'{untaken:,} orders were not taken by the broker')

    def _settle(self) -> None:
        """Wait until all are back, or nothing moves any more."""
        before, moved_s = self._moved(), time.monotonic()
        while not (self._complete() or self._broken()):
            self._until(self._complete, _LOOK_S)
            now = self._moved()
            if now != before:
                before, moved_s = now, time.monotonic()
            elif time.monotonic() - moved_s > (_QUIET_HOLDING_S if self._holds() else _QUIET_S):
                return

    def _end(self) -> None:
        """End the bridge, which takes what it holds to its end."""
        self._phase = 'ending'
        if not self._bridge.runs:
            self.problems.append(self._bridge.story())
        self._bridge.ask_to_end()
        if not self._until(lambda: not self._bridge.runs, _END_S):
            self.problems.append(f'bridge: still running {_END_S:.0f} s after SIGTERM')

    def _count_rest(self) -> None:
        """Count what is in the topic: nobody writes to it any more."""
        self._receiver.finish()
        if not self._until(lambda: not self._receiver.reads, _READ_S):
            self.problems.append(f'{self._ends.sink} could not be read to its end')
        if self._receiver.failure:
            self.problems.append(self._receiver.failure)

    # What is known

    def _look(self, *, final: bool = False) -> Look:
        since_s = self._sender.started_s
        now_s = time.monotonic() - since_s
        produced = self._sender.produced
        return Look(
            phase=self._phase,
            rate=self._sender.rate if since_s else 0.0,
            seconds=now_s if since_s else 0.0,
            produced=produced,
            kafka_to_ros=self._confirmed('kafka_to_ros'),
            ros_to_kafka=self._confirmed('ros_to_kafka'),
            consumed=self._tally.consumed,
            lost=self._tally.lost(produced) if final else self._tally.overdue(now_s),
            deleted=self._deleted(),
            duplicated=self._tally.duplicated,
            latency=self._tally.latency(),
            rates=self._tally.rates(None if final else now_s),
            final=final,
        )

    def _complete(self) -> bool:
        return self._tally.consumed >= self._sender.produced

    def _broken(self) -> bool:
        return not (self._bridge.runs and self._receiver.reads)

    def _moved(self) -> tuple[int | None, ...]:
        return (
            self._tally.consumed,
            self._confirmed('kafka_to_ros'),
            self._confirmed('ros_to_kafka'),
        )

    def _holds(self) -> bool:
        """Whether the bridge says that it holds messages, or has not read all that there is."""
        return any(told.in_flight or told.lag for told in self._bridge.snapshots.values())

    def _confirmed(self, route: str) -> int | None:
        told = self._bridge.snapshots.get(route)
        return None if told is None else max(0, told.carried - 1)  # but for the probe

    def _deleted(self) -> int:
        """Orders that the broker had deleted before the bridge or the receiver read them."""
        told = self._bridge.snapshots.get('kafka_to_ros')
        return self._receiver.deleted + (told.lost_upstream if told else 0)

    def _until(self, done: Callable[[], bool], limit_s: float = math.inf) -> bool:
        """Wait until something is so, and show the orders meanwhile; tells whether it is."""
        deadline_s = time.monotonic() + limit_s
        while not (is_done := done()) and time.monotonic() < deadline_s:
            self._take()
            self._show(self._look())
            time.sleep(_STEP_S)
        self._take()
        return is_done

    def _take(self) -> None:
        waiting = self._receiver.arrivals
        self._tally.add([waiting.popleft() for _ in range(len(waiting))])
