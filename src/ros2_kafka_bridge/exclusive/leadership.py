"""The exclusive right of a bridge to run a route: a wrapper around whatever runs it."""

from functools import partial

from ros2_kafka_bridge.exclusive.beside import beside
from ros2_kafka_bridge.exclusive.lease import Lease
from ros2_kafka_bridge.exclusive.standby import Standby
from ros2_kafka_bridge.exclusive.term import Term
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.running.route_runner import RouteRunner
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Wiring


class Leadership:
    """Runs a route whenever this bridge is the one to do so.

    This thread looks after the lock; the route has a thread of its own while it runs.

    Args:
        lock: Tells which bridge that is.
        wiring: Makes what runs the route.
    """

    def __init__(self, lock: GroupLock, wiring: Wiring) -> None:
        self._lock = lock
        self._wiring = wiring

    def run(self, runner: RouteRunner) -> None:
        """Run a route until a stop, or until it has failed for good.

        Its ROS endpoint is open in a term only: nobody would take from it in between, and it
        would hold the publishers back.
        """
        with self._lock:
            while not runner.final and Standby(self._lock, runner, self._wiring).wait():
                self._lead(runner)

    def _lead(self, runner: RouteRunner) -> None:
        """Let the route run for a term."""
        runner.log.info('takes over: this bridge runs the route')
        route, wiring = runner.route, self._wiring
        term = Term(runner.stop, self._lock, wiring.successor(route))
        lease = Lease(runner, term, wiring.claim_spool)
        make = partial(
            wiring.make, route, runner.log, say=runner.wait_for_type, on_take=term.note_taken
        )

        def run(stop: Stop) -> None:
            runner.run(stop, make, lease)

        with beside(run, runner.stop, route.name) as work:
            while not work.has_ended():
                if term.step(takes=runner.takes):
                    work.end(limited=False)
        runner.forget_pipeline()
        if term.is_lost and not self._lock.held:
            runner.log.warning('hands over: another bridge runs this route')
