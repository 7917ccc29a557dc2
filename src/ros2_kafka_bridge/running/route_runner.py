"""One route in a running bridge: it runs until a stop, again and again while it fails."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, Self

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.route.counters import Counters, Measures, Snapshot, State
from ros2_kafka_bridge.route.measuring import Troubles
from ros2_kafka_bridge.running.route_status import (
    Ended,
    FailedForGood,
    Failure,
    FailureHistory,
    RouteStatus,
    Shown,
)
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Pipeline

if TYPE_CHECKING:
    import threading

_SPOOL_AGAIN_S: Final = 0.1  # a spool that another process has is waited for where it is opened
_SAID_AGAIN_S: Final = 60.0

Make = Callable[[Stop, ExitStack], Pipeline | None]
"""Makes what runs a route, or nothing where a stop comes first; the stack closes it."""


class Conditions(Protocol):
    """On what a route runs where another bridge may run it (`exclusive.lease.Lease`)."""

    def may_run(self, pipeline: Pipeline, stop: Stop) -> bool:
        """Wait until what was made may run; False at a stop."""

    def is_ours(self) -> bool:
        """Whether no other bridge goes on with the route: else what has failed is not for good."""

    def is_kept(self) -> bool:
        """Whether it is tried again here after a failure."""


class _Unconditional:
    """The `Conditions` of a route that no other bridge runs."""

    def may_run(self, _pipeline: Pipeline, _stop: Stop) -> bool:
        return True

    def is_ours(self) -> bool:
        return True

    is_kept = is_ours


class Totals(NamedTuple):
    """What a route has counted in its former runs, and what counts now.

    Args:
        before: The former runs together, with the failures of all.
        pipeline: What runs the route now, or is to be run again.
    """

    before: Snapshot
    pipeline: Pipeline | None = None

    @classmethod
    def of(cls, route: str, *, has_spool: bool = False) -> Self:
        """Those of a route that has not run: what lies in its spool is not known."""
        on_disk = None if has_spool else 0
        measures = Measures(spool_bytes=on_disk)
        return cls(Counters(route).snapshot(0, spooled=on_disk, measures=measures))

    @property
    def now(self) -> Snapshot:
        """All together."""
        if self.pipeline is None:
            return self.before
        return _sum(self.before, self.pipeline.snapshot)

    def used(self, pipeline: Pipeline | None) -> Self:
        """What runs the route from now on is this."""
        return self.__class__(_without_spooled(self.before), pipeline)

    def given_up(self) -> Self:
        """What has run the route is no more, and what it still held is held by nobody."""
        return self.__class__(_given_up(self.now))

    def troubled(self, error: BridgeError) -> Self:
        """The route has failed."""
        troubles = Troubles()
        troubles.note(error)
        measures = self.before.measures.plus(troubles.measures())
        return self._replace(before=self.before._replace(measures=measures))


_SUMMED = [name for name, kind in Snapshot.__annotations__.items() if kind is int]


def _sum(before: Snapshot, now: Snapshot) -> Snapshot:
    sums = {name: getattr(before, name) + getattr(now, name) for name in _SUMMED}
    return now._replace(**sums, measures=before.measures.plus(now.measures))


def _given_up(total: Snapshot) -> Snapshot:
    """Count as given up what was in flight."""
    return total._replace(
        state=State.STARTING, reason='', measures=total.measures.at_rest,
        given_up=total.given_up + total.in_flight, in_flight=0,
    )  # fmt: skip


def _without_spooled(before: Snapshot) -> Snapshot:
    """Leave out what waits on disk: the next to open the file counts it as taken again."""
    waits = before.spooled or 0
    return before._replace(taken=before.taken - waits, spooled=None if waits else before.spooled)


class RouteRunner:
    """One route and what runs it.

    Args:
        route: Its settings.
        stop: Asks it to drain.
        pause: Asks it to pause, perhaps from the start on.
    """

    def __init__(self, route: AnyRoute, stop: Stop, pause: Pause | None = None) -> None:
        self.route = route
        self.stop = stop
        self.pause = pause or Pause()
        self.thread: threading.Thread | None = None
        self.log = route_log(route.name)
        # Told that it has failed for good, before anything else happens.
        self.tell_final: Callable[[], None] = lambda: None
        self._errors = summed(self.log, 1, _SAID_AGAIN_S)
        # Each is a value that is put in place at once: others read it while the route runs.
        self._status = RouteStatus()
        self._awaited = ''
        self._work = Totals.of(route.name, has_spool=route.spool is not None)

    @property
    def runs(self) -> bool:
        """Whether its thread has not ended."""
        return self.thread is not None and self.thread.is_alive()

    @property
    def takes(self) -> bool:
        """Whether what runs the route is at work: made, not waited for, and not failed."""
        return self._status.has_begun and self._status.failure is None

    @property
    def final(self) -> bool:
        """Whether it has failed and is not tried again."""
        return isinstance(self._status.stage, FailedForGood | Ended)

    @property
    def for_good(self) -> bool:
        """Whether that is so for what has failed, and not because the bridge stops."""
        return isinstance(self._status.stage, FailedForGood)

    @property
    def failure(self) -> Failure | None:
        """Why it does not run, as far as that is a failure."""
        return self._status.failure

    @property
    def failures(self) -> FailureHistory:
        """What its failures so far say."""
        return self._status.history

    @property
    def pipeline(self) -> Pipeline | None:
        """What runs the route now, or is to be run again."""
        return self._work.pipeline

    @property
    def spooled(self) -> int | None:
        """How much waits on disk, as far as is known."""
        return self._work.now.spooled

    # Run

    def run(self, stop: Stop, make: Make, conditions: Conditions | None = None) -> None:
        """Run the route until a stop, again and again while it fails.

        Args:
            stop: Asks to drain.
            make: Makes what runs it.
            conditions: On which it runs; None where no other bridge runs it.
        """
        conditions = conditions or _Unconditional()
        with ExitStack() as stack:
            while (error := self._try(stop, stack, make, conditions)) is not None:
                self._fail(error, ours=conditions.is_ours())
                if self.for_good:
                    self.tell_final()
                self.say_failure()
                if self.final or not conditions.is_kept():
                    break
                stop.wait(self.again_s)

    def _try(
        self, stop: Stop, stack: ExitStack, make: Make, conditions: Conditions
    ) -> BridgeError | None:
        """Run it until it stops or fails; returns why it has failed."""
        self.begin()
        try:
            if self.pipeline is None:
                self.use(make(stop, stack))
            if self.pipeline is None or not conditions.may_run(self.pipeline, stop):
                return None
            self._status = self._status.running()
            self.pipeline.run(stop, self.pause)
        except BridgeError as error:
            # Of a route that was never made, a stop in its try is one between two of them.
            return None if self.stop.asked and self.pipeline is None else error
        return None

    def begin(self) -> None:
        """Note that a try begins: to run it, or to be the one who does."""
        self._awaited = ''
        # A route that failed before still owes a drain.
        self._status = self._status.tried(time.monotonic(), drains=self.stop.asked)

    def use(self, pipeline: Pipeline | None) -> None:
        """Note what runs the route from now on."""
        self._work = self._work.used(pipeline)

    def begin_anew(self) -> None:
        """Note that it is to be run in other circumstances than those that it has failed in."""
        self._status = self._status.anew()

    def forget_pipeline(self) -> None:
        """Forget what has run the route, but for what it has counted."""
        self._work = self._work.given_up()
        self._status = self._status._replace(retries=False)

    # Failure

    def _fail(self, error: BridgeError, *, ours: bool) -> None:
        """Note what has failed, and whether that is for good."""
        now_s, carried = time.monotonic(), self._carried
        self._work = self._work.troubled(error)
        self._status = self._status.failed(error, now_s, carried, stops=self.stop.asked, ours=ours)

    def note_failure(self, error: BridgeError) -> None:
        """Note what has failed while another bridge runs the route: it says how long to wait."""
        self._work = self._work.troubled(error)
        self._status = self._status.noted(error, time.monotonic(), self._carried)

    @property
    def again_s(self) -> float:
        """How long to wait before it is tried again."""
        last = self.failures.last
        waits_itself = last is not None and last.holder is not None
        return _SPOOL_AGAIN_S if waits_itself else self.failures.backoff.wait_s

    def say_failure(self) -> None:
        """Log what has failed last."""
        failure = self.failures.last
        assert failure is not None, 'it has failed'
        text = f'failed: {failure.text}'
        if self.final or self.stop.asked:
            self.log.error('%s', text, extra={'about': failure.about})
        else:
            again = f'; tried again in {self.again_s:.0f} s'
            self._errors.error(text, again, kind=text, about=failure.about)

    @property
    def _carried(self) -> int:
        return self._work.now.carried

    # What others ask for, and are told

    @property
    def paused(self) -> bool:
        """Whether it was asked to pause."""
        return self.pause.asked

    def ask_to_pause(self, *, asked: bool) -> None:
        """Ask it to pause, or to go on; called by another thread."""
        if asked != self.pause.asked:
            self.pause.asked = asked
            self.stop.wakeup.ring()
            words = 'takes nothing until it is resumed' if asked else 'goes on'
            self.log.info('%s by an operator: %s', 'paused' if asked else 'resumed', words)

    def wait_for_type(self, reason: str) -> None:
        """Note that it is not made yet, for its type has to be learned from others."""
        self._awaited = reason
        self.log.warning('%s', reason)

    def show(self, shown: Shown | None) -> None:
        """Say this of it until it runs, or something else is said.

        Args:
            shown: None where that is for the route to say.
        """
        self._status = self._status._replace(instead=shown)

    def snapshot(self) -> Snapshot:
        """The counters of the route, at one moment of its own."""
        work = self._work
        if work.pipeline is not None and not work.pipeline.telling.is_asked:
            work.pipeline.telling.is_asked = True
            self.stop.wakeup.ring()  # one that is idle would tell later
        total, status = work.now, self._status
        if (shown := status.shown) is not None:
            state, reason, final = shown
            return total.at_rest._replace(state=state, reason=reason, final=final)
        if self.stop.asked or work.pipeline is None:
            total = total._replace(beat_s=0.0)
        if total.state is State.STARTING and work.pipeline is None:
            if self.paused:
                return total._replace(state=State.PAUSED, reason=self.pause.reason)
            return total._replace(reason=self._awaited)
        failure = status.history.last
        is_tried = total.state is State.STOPPED and status.retries and not self.stop.asked
        if is_tried and failure is not None:
            # What runs it has told nothing yet since that has ended it.
            reason = f'{failure.text}; tried again now'
            return total.at_rest._replace(state=State.FAILED, reason=reason)
        if total.state is State.WAITING:
            return total._replace(reason=total.reason + status.history.says(total.carried))
        return total.at_rest if total.state is State.STOPPED else total
