"""One route in a running bridge: what runs it, how it fares, what it has counted."""

import math
import time
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.errors import BridgeError, SpoolInUseError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.route.counters import Snapshot, State
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.turns.life import (
    STANDS_BY,
    Ended,
    FailedForGood,
    Life,
    Owed,
    StandingBy,
    waits_for_spool,
)
from ros2_kafka_bridge.turns.overlap import MOST_S
from ros2_kafka_bridge.turns.totals import Totals
from ros2_kafka_bridge.wiring import Pipeline

if TYPE_CHECKING:
    import threading

_LISTEN_S: Final = 0.1
# For a bridge of this machine that ran the route before to put the spool away, beyond its drain.
_SPOOL_S: Final = 5.0
# Until the route is left to it: who went on just now (SIGCONT) needs one of them.
_SPOOL_WAITS: Final = 2
_BACKLOG_S: Final = 2.0
# A route that fails for so long goes to a bridge that may be able to run it. What it holds in
# memory is given up for that, so it is given away only to a bridge that stands by.
_FAILING_S: Final = 30.0
_SAID_AGAIN_S: Final = 60.0


class RouteRunner:
    """One route and what runs it.

    Args:
        route: Its settings.
        stop: Asks it to drain.
        lock: Its exclusive right; None where no other bridge runs it.
        pause: Asks it to pause, perhaps from the start on.
    """

    def __init__(
        self, route: AnyRoute, stop: Stop, lock: GroupLock | None, pause: Pause | None = None
    ) -> None:
        self.route = route
        self.stop = stop
        self.lock = lock
        self.pause = pause or Pause()
        self.thread: threading.Thread | None = None
        self.log = route_log(route.name)
        self._errors = summed(self.log, 1, _SAID_AGAIN_S)
        # Each is a value that is put in place at once: others read it while the route runs.
        self._life = Life()
        self._awaited = ''
        self._work = Totals.of(route.name, has_spool=route.spool is not None)

    @property
    def runs(self) -> bool:
        """Whether its thread has not ended."""
        return self.thread is not None and self.thread.is_alive()

    @property
    def final(self) -> bool:
        """Whether it has failed and is not tried again."""
        return isinstance(self._life.stage, FailedForGood | Ended)

    @property
    def for_good(self) -> bool:
        """Whether that is so for what has failed, and not because the bridge stops."""
        return isinstance(self._life.stage, FailedForGood)

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

    @property
    def pipeline(self) -> Pipeline | None:
        """What runs the route now, or is to be run again."""
        return self._work.pipeline

    def use(self, pipeline: Pipeline | None) -> None:
        """Note what runs the route from now on."""
        self._work = self._work.used(pipeline)

    def begin_term(self) -> None:
        """Forget what was waited for, and what kept this bridge from its turn."""
        self._life = self._life.in_turn()

    def end_term(self) -> None:
        """Forget what has run the route, but for what it has counted."""
        self._work = self._work.given_up()
        self._life = self._life._replace(retries=False)

    def begin(self) -> None:
        """Note that a try begins: to run it, or to have its turn."""
        self._awaited = ''
        # A route that failed before still owes a drain.
        self._life = self._life.tried(time.monotonic(), drains=self.stop.asked)

    def begin_run(self) -> None:
        """Note that nothing is in its way any more."""
        self._life = self._life.running()

    # Failure

    def fail(self, error: BridgeError, stop: Stop) -> None:
        """Note what has failed, and whether it is tried again."""
        self._work = self._work.troubled(error)
        self._life = self._life.failed(
            error, time.monotonic(), self._carried, stops=self.stop.asked, over=stop.over
        )

    def fail_meanwhile(self, error: BridgeError) -> None:
        """Note what has failed while another bridge runs the route: that is always tried again."""
        self._work = self._work.troubled(error)
        self._life = self._life.failed_meanwhile(error, time.monotonic(), self._carried)

    @property
    def again_s(self) -> float:
        """How long to wait before it is tried again; what waits for a spool looks itself."""
        return self._life.past.backoff.wait_s if self._spool_holder is None else _LISTEN_S

    def say_failure(self) -> None:
        """Log why the last run has failed."""
        failure = self._life.failure
        assert failure is not None, 'it has failed'
        text = f'failed: {failure.text}'
        if self.final or self.stop.asked:
            self.log.error('%s', text, extra={'about': failure.about})
        else:
            again = f'; tried again in {self.again_s:.0f} s'
            self._errors.error(text, again, kind=text, about=failure.about)

    def give_away(self, stop: Stop) -> bool:
        """Leave a failed route to a bridge that stands by, where this one cannot run it.

        It has tried for long by then, or twice in vain to get the spool.

        Returns:
            Whether it is another's now, by that or because the lock was lost.
        """
        since_s = self._life.past.since_s
        if self.lock is None or since_s is None:
            return False
        if stop.over:
            return True
        tried_s, holder = time.monotonic() - since_s, self._spool_holder
        if self.stop.asked or (tried_s < _FAILING_S and holder is None):
            return False
        wanted = self.lock.has_standby()
        self._life = self._life.sought(wanted=wanted)
        if not wanted or (holder is not None and self._life.wait.in_vain < _SPOOL_WAITS):
            return False
        self._say_given_away(tried_s, holder)
        self.lock.close()
        return True

    def _say_given_away(self, tried_s: float, holder: str | None) -> None:
        held = 0 if self.pipeline is None else self.pipeline.snapshot.in_flight
        given_up = f', {count(held, "message")} given up' if held else ''
        why = f'has failed for {tried_s:.0f} s'
        if holder is not None:
            why = f'{holder}, so what the reader here holds may be lost'
        self.log.warning('%s: left to a bridge that stands by%s', why, given_up)

    @property
    def _spool_holder(self) -> str | None:
        """Which process has the spool, where it has failed for that."""
        failure = self._life.failure
        return None if failure is None else failure.holder

    @property
    def _carried(self) -> int:
        return self._work.now.carried

    # What it waits for

    def wait_for_turn(self, lock: GroupLock) -> None:
        """Listen whether it has come, for a moment."""
        joined = lock.joined  # a first answer without the lock may be followed at once by another
        lock.poll(_LISTEN_S)
        lock.check()
        if lock.held:
            return
        before = self._life
        self._life = before.heard(joined=joined, away=lock.away)
        if self._stands_by and not isinstance(before.stage, StandingBy):
            self.log.info('%s', STANDS_BY)

    def wait_for_type(self, reason: str) -> None:
        """Note that it is not made yet, for its type has to be learned from others."""
        self._awaited = reason
        self.log.warning('%s', reason)

    def wait_for_spool(self, in_use: SpoolInUseError) -> None:
        """Note that the spool of this term is with another process still.

        Raises:
            SpoolInUseError: It has been for long.
        """
        now_s, before = time.monotonic(), self._life
        self._life = before.without_spool(in_use, now_s)
        since_s = before.wait.since_s
        if since_s is None:
            since_s = now_s
            self.log.info('%s', waits_for_spool(in_use.short))
        if now_s - since_s > MOST_S + self.route.drain_s + _SPOOL_S:
            raise in_use

    # What this bridge has on disk while another runs the route

    @property
    def owes_backlog(self) -> bool:
        """Whether to look now for what it has on disk."""
        return self._stands_by and time.monotonic() >= self._life.owed.look_at_s

    @property
    def _stands_by(self) -> bool:
        return isinstance(self._life.stage, StandingBy)

    def leave_or_end_backlog(self) -> None:
        """Note that it was delivered, as far as it was before its turn came, or a stop."""
        if self._work.now.spooled:
            self.leave_backlog(None)
        else:
            self._life = self._life.owing(Owed(math.inf))

    def leave_backlog(self, error: BridgeError | None) -> None:
        """Note that it is looked for later.

        Args:
            error: What is in the way; None where another process has it, and delivers it.
        """
        now_s = time.monotonic()
        if error is None:
            self._life = self._life.owing(Owed(now_s + _BACKLOG_S))
            return
        self._work = self._work.troubled(error)
        self._life = self._life.undelivered(error, now_s, self._carried)
        self.say_failure()

    # What others are told

    def snapshot(self) -> Snapshot:
        """The counters of the route, at one moment of its own."""
        work = self._work
        if work.pipeline is not None and not work.pipeline.telling.is_asked:
            work.pipeline.telling.is_asked = True
            self.stop.wakeup.ring()  # one that is idle would tell later
        total, life = work.now, self._life
        if (shown := life.shown) is not None:
            state, reason, final = shown
            return total.at_rest._replace(state=state, reason=reason, final=final)
        if self.stop.asked or work.pipeline is None:
            total = total._replace(beat_s=0.0)
        if total.state is State.STARTING and work.pipeline is None:
            if self.paused:
                return total._replace(state=State.PAUSED, reason=self.pause.reason)
            return total._replace(reason=self._awaited)
        failure = life.past.failure
        is_tried = total.state is State.STOPPED and life.retries and not self.stop.asked
        if is_tried and failure is not None:
            # What runs it has told nothing yet since that has ended it.
            reason = f'{failure.text}; tried again now'
            return total.at_rest._replace(state=State.FAILED, reason=reason)
        if total.state is State.WAITING:
            return total._replace(reason=total.reason + life.past.says(total.carried))
        return total.at_rest if total.state is State.STOPPED else total
