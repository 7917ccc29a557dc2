"""The orders' whole way through one contestant: start, send, wait, end, count."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Final, NamedTuple

from ros2_kafka_bridge.demo.children import Child
from ros2_kafka_bridge.demo.contestants import Contestant, Ends
from ros2_kafka_bridge.demo.table import Look
from ros2_kafka_bridge.demo.tally import Tally
from ros2_kafka_bridge.demo.traffic import Receiver, Sender
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.threads.stop import Stop

START_S: Final = 60.0
# How long nothing may arrive until what is missing counts as lost: for a contestant that knows
# of nothing any more, and for one that still holds messages, or has not read all.
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
    """One contestant, its orders, and what became of them.

    Args:
        contestant: Who carries them.
        ends: Between what.
        plan: How many, how fast.
        stop: Asks for an early end.
        show: Called again and again while the orders move.
    """

    def __init__(
        self,
        contestant: Contestant,
        ends: Ends,
        plan: SendPlan,
        stop: Stop,
        show: Callable[[], None],
    ) -> None:
        self.problems: list[str] = []
        self.started = False  # whether an order was sent that counts
        self.name = contestant.name
        self._title = contestant.title
        self._programs = contestant.programs(ends)
        self._ends = ends
        self._stop = stop
        self._show = show
        self._phase = 'starting'
        self._last: Look | None = None
        self._tally = Tally()
        kafka = {'bootstrap.servers': ends.bootstrap_servers}
        self._sender = Sender(kafka, ends.source, *plan)
        self._receiver = Receiver({**kafka, **ends.properties}, ends.sink)
        self._children: list[Child] = []

    def look(self) -> Look:
        """Everything that is known now."""
        return self._last or self._look(final=False)

    def run(self, environ: Mapping[str, str]) -> None:
        """Carry the orders.

        Args:
            environ: For the contestant's processes, added to this one's.
        """
        with ExitStack() as stack:
            stack.enter_context(self._sender)
            self._children = [
                stack.enter_context(Child(program, self._ends.place / f'{number}.log', environ))
                for number, program in enumerate(self._programs)
            ]
            stack.enter_context(self._receiver)
            if self._ready():
                self._send()
                self._settle()
            self._end()
            self._count_rest()
        self._phase = 'done'
        self._last = self._look(final=True)
        self._show()

    def _ready(self) -> bool:
        """Wait until an order that does not count has come through."""
        self._sender.probe()
        come = self._receiver.probed.is_set
        self._until(lambda: come() or self._stop.asked or self._broken(), START_S)
        if not (come() or self._stop.asked or self._broken()):
            self.problems.append(f'{self.name}: not one order came through in {START_S:.0f} s')
        return come() and not self._stop.asked

    def _send(self) -> None:
        self._phase = 'sending'
        self._sender.start()
        self._receiver.started_s = self._sender.started_s
        self.started = True
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
        """End the contestant, which takes what it holds to its end."""
        self._phase = 'ending'
        self.problems += [child.story() for child in self._children if not child.runs]
        for child in self._children:
            child.ask_to_end()
        if not self._until(lambda: not any(child.runs for child in self._children), _END_S):
            self.problems.append(f'{self.name}: still running {_END_S:.0f} s after SIGTERM')

    def _count_rest(self) -> None:
        """Count what is in the topic: nobody writes to it any more."""
        self._receiver.finish()
        if not self._until(lambda: not self._receiver.reads, _READ_S):
            self.problems.append(f'{self._ends.sink} could not be read to its end')
        if self._receiver.failure:
            self.problems.append(self._receiver.failure)

    # What is known

    def _look(self, *, final: bool) -> Look:
        now_s = time.monotonic() - self._sender.started_s
        produced = self._sender.produced
        return Look(
            name=self.name,
            title=self._title,
            phase=self._phase,
            rate=self._sender.rate if self.started else 0.0,
            seconds=max(0.0, now_s) if self.started else 0.0,
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
        return not all(child.runs for child in self._children) or not self._receiver.reads

    def _moved(self) -> tuple[int | None, ...]:
        return (
            self._tally.consumed,
            self._confirmed('kafka_to_ros'),
            self._confirmed('ros_to_kafka'),
        )

    def _holds(self) -> bool:
        """Whether a process says that it holds messages, or has not read all that there is."""
        snapshots = [one for child in self._children for one in child.snapshots.values()]
        return any(one.in_flight or one.lag for one in snapshots)

    def _confirmed(self, route: str) -> int | None:
        snapshot = self._snapshot(route)
        return None if snapshot is None else max(0, snapshot.carried - 1)  # but for the probe

    def _deleted(self) -> int:
        """Orders that the broker had deleted before a contestant or the receiver read them."""
        snapshot = self._snapshot('kafka_to_ros')
        return self._receiver.deleted + (snapshot.lost_upstream if snapshot else 0)

    def _snapshot(self, route: str) -> Snapshot | None:
        found = (c.snapshots[route] for c in self._children if route in c.snapshots)
        return next(found, None)

    def _until(self, done: Callable[[], bool], limit_s: float = math.inf) -> bool:
        """Wait until something is so, and show the orders meanwhile; tells whether it is."""
        deadline_s = time.monotonic() + limit_s
        while not (is_done := done()) and time.monotonic() < deadline_s:
            self._take()
            self._show()
            time.sleep(_STEP_S)
        self._take()
        return is_done

    def _take(self) -> None:
        waiting = self._receiver.arrivals
        self._tally.add([waiting.popleft() for _ in range(len(waiting))])
