"""What a bridge does for a route while another runs it."""

from ros2_kafka_bridge.errors import BridgeError, SpoolInUseError
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.turns.lane import Lane
from ros2_kafka_bridge.turns.term import Standby
from ros2_kafka_bridge.wiring import Wiring


def stand_by(lane: Lane, lock: GroupLock, wiring: Wiring) -> bool:
    """Wait until it is the turn of this bridge; False at a stop."""
    while not lane.stop.asked:
        lane.begin()
        try:
            lock.open()
            while not lock.held and not lane.stop.asked:
                lane.wait_for_turn(lock)
                if not lock.held and lane.owes_backlog:
                    _deliver_backlog(lane, lock, wiring)
        except BridgeError as error:
            lane.fail_meanwhile(error)
            lane.say_failure()
            lock.close()
            lane.stop.wait(lane.again_s)
        else:
            lane.begin_term()
            return lock.held and not lane.stop.asked
    return False


def _deliver_backlog(lane: Lane, lock: GroupLock, wiring: Wiring) -> None:
    """Deliver what this bridge had on disk when another took the route over from it.

    It stands by meanwhile, also where that fails.
    """
    if wiring.is_spool_in_use(lane.route):
        lane.leave_backlog(None)
        return
    try:
        if (pipeline := wiring.make_for_backlog(lane.route, lane.log)) is not None:
            lane.use(pipeline)
            pipeline.deliver_backlog(Standby(lane.stop, lock))
    except BridgeError as error:
        lane.leave_backlog(None if isinstance(error, SpoolInUseError) else error)
    else:
        lane.leave_or_end_backlog()
    finally:
        lane.end_term()
