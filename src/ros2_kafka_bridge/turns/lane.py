"""One route in a running bridge: what runs it, how it fares, what it has counted."""

import math
import time
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError, SpoolInUseError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.route.counters import Snapshot, State
from ros2_kafka_bridge.threads.backoff import Backoff
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.turns.term import OVERLAP_S, Term
from ros2_kafka_bridge.turns.totals import Totals
from ros2_kafka_bridge.wiring import Direction, Route

if TYPE_CHECKING:
    import threading

    from ros2_kafka_bridge.errors import About

_LISTEN_S: Final = 0.1
# For a bridge of this machine that ran the route before to put the spool away, beyond its drain.
_SPOOL_S: Final = 5.0
# Until the route is left to it: who went on just now (SIGCONT) needs one of them.
_SPOOL_WAITS: Final = 2
_BACKLOG_S: Final = 2.0
# A route that fails for so long goes to a bridge that may be able to run it. What it holds in
# memory is given up for that, so it is given away only to a bridge that stands by.
_FAILING_S: Final = 30.0
# A run that was longer than this was well, also where there was nothing to send. Not less: an
# unknown topic is noticed after half a minute of nothing.
_WELL_S: Final = 180.0
_SAID_AGAIN_S: Final = 60.0
_STANDS_BY: Final = 'stands by: another bridge runs this route'
_JOINS: Final = 'asks Kafka which bridge runs this route'


class Lane:
    """One route and what runs it.

    Args:
        route: Its settings.
        stop: Asks it to drain.
        lock: Its exclusive right; None where no other bridge runs it.
        pause: Asks it to pause, perhaps from the start on.
    """

    def __init__(
        self, route: Route, stop: Stop, lock: GroupLock | None, pause: Pause | None = None
    ) -> None:
        self.route = route
        self.stop = stop
        self.lock = lock
        self.pause = pause or Pause()
        self.thread: threading.Thread | None = None
        self.log = route_log(route.name)
        self.failure = ''
        self.waits = ''  # for its turn
        self.stands_by = False  # another bridge runs the route
        self._backlog_at_s = 0.0  # when to look for what this bridge has on disk meanwhile
        self._undelivered = ''  # why that is still there
        self._in_use: SpoolInUseError | None = None  # what has failed last, if that was it
        self._spool_since_s: float | None = None  # since when the spool is waited for
        self._spool_waits = 0  # in vain, for a bridge that is there
        self.final = False
        self.for_good = False  # final, and not for the end of a drain
        self.backoff = Backoff()
        self._about: About | None = None  # what the failure is about
        self._errors = summed(self.log, 1, _SAID_AGAIN_S)
        self._began_s = 0.0
        self._failing_since_s: float | None = None
        self._failed = ''  # the last failure
        self._confirmed = 0  # at that one
        self._draining = False
        # One attribute, so that others see both at one moment.
        self._work = Totals.of(route.name)

    @property
    def runs(self) -> bool:
        """Whether its thread has not ended."""
        return self.thread is not None and self.thread.is_alive()

    @property
    def paused(self) -> bool:
        """Whether it was asked to pause."""
        return self.pause.asked

    def ask_to_pause(self, *, asked: bool) -> None:
        """Ask it to pause, or to go on; called by another thread."""
        if asked != self.pause.asked:
            self.pause.asked = asked
            words = 'takes nothing until it is resumed' if asked else 'goes on'
            self.log.info('%s by an operator: %s', 'paused' if asked else 'resumed', words)

    @property
    def direction(self) -> Direction | None:
        """What runs the route now, or is to be run again."""
        return self._work.direction

    def use(self, direction: Direction | None) -> None:
        """Note what runs the route from now on."""
        self._work = self._work.used(direction)

    def begin_term(self) -> None:
        """Forget what was waited for, and what kept this bridge from its turn."""
        self.waits = self._undelivered = ''
        self.stands_by = False
        self._backlog_at_s = 0.0
        self._spool_since_s, self._spool_waits = None, 0
        self.final = self.for_good = False
        self._failing_since_s = None

    def end_term(self) -> None:
        """Forget what has run the route, but for what it has counted."""
        self._work = self._work.given_up()

    def begin(self) -> None:
        """Note that a run begins."""
        self._began_s = time.monotonic()
        self._draining = self.stop.asked  # a route that failed before still owes a drain

    def fail(self, error: BridgeError, stop: Stop) -> None:
        """Note what has failed, and whether it is tried again."""
        now_s = time.monotonic()
        ran_s = now_s - self._began_s
        self.backoff = self.backoff.after(ran_s)
        confirmed = self._work.now.confirmed
        was_well = confirmed > self._confirmed or ran_s > _WELL_S
        if self._failing_since_s is None or was_well:
            self._failing_since_s = now_s
        self._confirmed = confirmed
        handed_over = isinstance(stop, Term) and stop.over and not self.stop.asked
        final = isinstance(error, ConfigError) or (isinstance(error, RouteError) and error.final)
        for_good = final and not handed_over
        self._work = self._work.troubled(error)
        self.for_good = for_good and not self.stop.asked
        self.failure = self._failed = str(error)
        self._about = error.about if isinstance(error, RouteError) else None
        self._in_use = error if isinstance(error, SpoolInUseError) else None
        self.final = self._draining or for_good

    def fail_meanwhile(self, error: BridgeError) -> None:
        """Note what has failed while another bridge runs the route: that is always tried again."""
        self.fail(error, self.stop)
        self.final = self.for_good = False

    @property
    def again_s(self) -> float:
        """How long to wait before it is tried again; what waits for a spool looks itself."""
        return self.backoff.wait_s if self._in_use is None else _LISTEN_S

    def say_failure(self) -> None:
        """Log why the last run has failed."""
        text = f'failed: {self.failure}'
        if self.final or self.stop.asked:
            self.log.error('%s', text, extra={'about': self._about})
        else:
            again = f'; tried again in {self.again_s:.0f} s'
            self._errors.error(text, again, kind=text, about=self._about)

    def is_given_away(self, stop: Stop) -> bool:
        """Whether a failed route is left to another bridge, for this one has tried for long."""
        if not isinstance(stop, Term) or self.lock is None or self._failing_since_s is None:
            return False
        if stop.over:
            return True
        tried_s = time.monotonic() - self._failing_since_s
        if self.stop.asked or (tried_s < _FAILING_S and self._in_use is None):
            return False
        if not self.lock.is_wanted():
            self._spool_waits = 0
            return False
        if self._in_use is not None:
            self._spool_waits += 1
            if self._spool_waits < _SPOOL_WAITS:
                return False
        held = 0 if self.direction is None else self.direction.snapshot.in_flight
        given_up = f', {count(held, "message")} given up' if held else ''
        why = f'has failed for {tried_s:.0f} s'
        if self._in_use is not None:
            why = f'{self._in_use.short}, so what the reader here holds may be lost'
        self.log.warning('%s: left to a bridge that stands by%s', why, given_up)
        self.lock.close()
        return True

    def wait_for_turn(self, lock: GroupLock) -> None:
        """Listen whether it has come, for a moment."""
        joined = lock.joined  # a first answer without the lock may be followed at once by another
        lock.poll(_LISTEN_S)
        lock.check()
        if lock.held:
            return
        before, self.stands_by = self.stands_by, joined and not lock.away
        if self.stands_by and not before:
            self.log.info('%s', _STANDS_BY)
        self.waits = lock.away or _JOINS
        if self.stands_by:
            self.waits = '; '.join(filter(None, [_STANDS_BY, self._undelivered]))
        if joined:
            self.failure = ''

    def wait_for_spool(self, in_use: SpoolInUseError) -> None:
        """Note that the spool of this term is with another process still.

        Raises:
            SpoolInUseError: It has been for long.
        """
        now_s = time.monotonic()
        self.failure, self.waits = '', f'its turn has come, but {in_use.short}'
        if self._spool_since_s is None:
            self._spool_since_s = now_s
            self.log.info('%s', self.waits)
        if now_s - self._spool_since_s > OVERLAP_S + self.route.drain_s + _SPOOL_S:
            self._spool_since_s = None
            raise in_use

    def has_spool(self) -> None:
        """Note that it is with no other process."""
        self._spool_since_s, self._spool_waits, self.waits = None, 0, ''

    # What this bridge has on disk while another runs the route

    @property
    def owes_backlog(self) -> bool:
        """Whether to look now for what it has on disk."""
        return self.stands_by and time.monotonic() >= self._backlog_at_s

    def leave_or_end_backlog(self) -> None:
        """Note that it was delivered, as far as it was before its turn came, or a stop."""
        if self.snapshot().spooled:
            self.leave_backlog(None)
        else:
            self._backlog_at_s, self._undelivered = math.inf, ''

    def leave_backlog(self, error: BridgeError | None) -> None:
        """Note that it is looked for later.

        Args:
            error: What is in the way; None where another process has it, and delivers it.
        """
        wait_s = _BACKLOG_S
        self._undelivered = ''
        if error is not None:
            self.fail_meanwhile(error)
            self.say_failure()
            self._undelivered = f'what this one has on disk is not delivered: {error}'
            wait_s = self.backoff.wait_s
        self._backlog_at_s = time.monotonic() + wait_s

    def snapshot(self) -> Snapshot:
        """The counters of the route, at one moment of its own."""
        total = self._work.now
        if self.failure or self.waits or self.stop.asked or self.direction is None:
            total = total._replace(beat_s=0.0)
        if self.failure:
            return total._replace(state=State.FAILED, reason=self.failure, final=self.for_good)
        if self.waits:
            return total._replace(state=State.WAITING, reason=self.waits)
        if self.direction is None and self.paused and total.state is State.STARTING:
            return total._replace(state=State.PAUSED, reason=self.pause.reason)
        if total.state is State.WAITING and self._failed and total.confirmed == self._confirmed:
            return total._replace(reason=f'{total.reason}; has failed before: {self._failed}')
        return total
