"""What a bridge does for a route while another runs it, or nobody has told which one does."""

import math
import time
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge.errors import BridgeError, SpoolInUseError
from ros2_kafka_bridge.exclusive.beside import LOOK_S, beside
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.running.route_runner import RouteRunner
from ros2_kafka_bridge.running.route_status import Failure, Shown
from ros2_kafka_bridge.wiring import Wiring

_BACKLOG_S: Final = 2.0
_JOINS: Final = 'asks Kafka which bridge runs this route'

STANDS_BY: Final = 'stands by: another bridge runs this route'
"""What a route says of itself meanwhile."""


class PendingBacklog(NamedTuple):
    """What a bridge has on disk while another runs the route: it delivers that as well.

    Args:
        look_at_s: When to look for it; infinite once it is delivered.
        failure: Why it is still there; None where nothing has failed.
    """

    look_at_s: float = 0.0
    failure: Failure | None = None


class StandbyStatus(NamedTuple):
    """How a bridge fares that does not run a route.

    Args:
        stands_by: Whether Kafka has told that another one does.
        away: Why it does not tell; empty while it is asked.
        backlog: What this bridge has on disk.
        failure: What has failed since the lock was heard last.
    """

    stands_by: bool = False
    away: str = ''
    backlog: PendingBacklog = PendingBacklog()
    failure: Failure | None = None

    @property
    def shown(self) -> Shown:
        """What is said of the route."""
        if self.failure is not None:
            return Shown(State.FAILED, self.failure.text)
        if not self.stands_by:
            return Shown(State.WAITING, self.away or _JOINS)
        if self.backlog.failure is None:
            return Shown(State.WAITING, STANDS_BY)
        why = self.backlog.failure.text
        text = f'{STANDS_BY}; what this one has on disk is not delivered: {why}'
        return Shown(State.WAITING, text)

    def heard(self, *, joined: bool, away: str) -> Self:
        """The lock is not held.

        Args:
            joined: Whether Kafka had told who holds it.
            away: Why it does not tell now.
        """
        told = self._replace(stands_by=joined and not away, away=away)
        # Until Kafka has told, a failure is what is known.
        return told._replace(failure=None) if joined else told

    def failed(self, failure: Failure) -> Self:
        """This bridge could not wait; one that stood by still does: nobody has told otherwise."""
        return self._replace(failure=failure)


class Standby:
    """Waits until this bridge is the one that runs a route.

    Args:
        lock: By which it becomes that.
        runner: Of the route.
        wiring: Makes what delivers the backlog.
    """

    def __init__(self, lock: GroupLock, runner: RouteRunner, wiring: Wiring) -> None:
        self._lock = lock
        self._runner = runner
        self._wiring = wiring
        self._status = StandbyStatus(failure=runner.failure)

    def wait(self) -> bool:
        """Wait until then; False at a stop."""
        runner, lock = self._runner, self._lock
        while not runner.stop.asked:
            runner.begin()
            try:
                lock.open()
                while not lock.held and not runner.stop.asked:
                    self._listen()
                    if not lock.held and self._owes_backlog:
                        self._deliver_backlog()
            except BridgeError as error:
                self._fail(error)
            else:
                self._begin_term()
                return lock.held and not runner.stop.asked
        return False

    def _listen(self) -> None:
        """Listen for a moment whether it is."""
        joined = self._lock.joined  # what is said first may be followed by more at once
        self._lock.poll(LOOK_S)
        self._lock.check()
        if self._lock.held:
            return
        before = self._status
        self._show(before.heard(joined=joined, away=self._lock.away))
        if self._status.stands_by and not before.stands_by:
            self._runner.log.info('%s', STANDS_BY)

    def _fail(self, error: BridgeError) -> None:
        """Note what has failed: it is always tried again."""
        self._runner.note_failure(error)
        self._show(self._status.failed(Failure.of(error)))
        self._runner.say_failure()
        self._lock.close()
        self._runner.stop.wait(self._runner.again_s)

    def _begin_term(self) -> None:
        """Forget what was waited for; a failure is shown until the route runs."""
        self._runner.begin_anew()
        self._runner.show(None if self._status.failure is None else self._status.shown)

    def _show(self, status: StandbyStatus) -> None:
        self._status = status
        self._runner.show(status.shown)

    # What this bridge has on disk

    @property
    def _owes_backlog(self) -> bool:
        return self._status.stands_by and time.monotonic() >= self._status.backlog.look_at_s

    def _deliver_backlog(self) -> None:
        """Deliver what this bridge had on disk when another took the route over from it.

        It stands by meanwhile, also where that fails.
        """
        runner, wiring = self._runner, self._wiring
        if wiring.is_spool_in_use(runner.route):
            self._look_later(None)
            return
        try:
            if (pipeline := wiring.make_for_backlog(runner.route, runner.log)) is not None:
                runner.use(pipeline)
                self._deliver(pipeline)
        except BridgeError as error:
            self._look_later(None if isinstance(error, SpoolInUseError) else error)
        else:
            if runner.spooled:
                self._look_later(None)
            else:
                self._show(self._status._replace(backlog=PendingBacklog(math.inf)))
        finally:
            runner.forget_pipeline()

    def _deliver(self, pipeline: RosToKafka) -> None:
        """Let it run until all is delivered, the turn of this bridge comes, or a stop."""
        whole, name = self._runner.stop, self._runner.route.name
        with beside(pipeline.deliver_backlog, whole, name) as work:
            while not work.has_ended():
                self._lock.poll(0.0)
                if self._lock.held or whole.asked:
                    work.end(limited=True)

    def _look_later(self, error: BridgeError | None) -> None:
        """Look again for what is on disk.

        Args:
            error: What is in the way; None where another process has it, and delivers it.
        """
        if error is None:
            backlog = PendingBacklog(time.monotonic() + _BACKLOG_S)
            self._show(self._status._replace(backlog=backlog))
            return
        self._runner.note_failure(error)
        failure = Failure.of(error)
        backlog = PendingBacklog(time.monotonic() + self._runner.again_s, failure)
        self._show(self._status._replace(backlog=backlog).failed(failure))
        self._runner.say_failure()
