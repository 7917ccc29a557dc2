"""What a bridge does for a route while another runs it."""

from ros2_kafka_bridge.errors import BridgeError, SpoolInUseError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.turns.route_runner import RouteRunner
from ros2_kafka_bridge.turns.term import Standby
from ros2_kafka_bridge.wiring import Wiring


def stand_by(runner: RouteRunner, lock: GroupLock, wiring: Wiring) -> bool:
    """Wait until it is the turn of this bridge; False at a stop."""
    while not runner.stop.asked:
        runner.begin()
        try:
            lock.open()
            while not lock.held and not runner.stop.asked:
                runner.wait_for_turn(lock)
                if not lock.held and runner.owes_backlog:
                    _deliver_backlog(runner, lock, wiring)
        except BridgeError as error:
            runner.fail_meanwhile(error)
            runner.say_failure()
            lock.close()
            runner.stop.wait(runner.again_s)
        else:
            runner.begin_term()
            return lock.held and not runner.stop.asked
    return False


def _deliver_backlog(runner: RouteRunner, lock: GroupLock, wiring: Wiring) -> None:
    """Deliver what this bridge had on disk when another took the route over from it.

    It stands by meanwhile, also where that fails.
    """
    if wiring.is_spool_in_use(runner.route):
        runner.leave_backlog(None)
        return
    try:
        if (pipeline := wiring.make_for_backlog(runner.route, runner.log)) is not None:
            runner.use(pipeline)
            pipeline.deliver_backlog(Standby(runner.stop, lock))
    except BridgeError as error:
        runner.leave_backlog(None if isinstance(error, SpoolInUseError) else error)
    else:
        runner.leave_or_end_backlog()
    finally:
        runner.end_term()
