"""What a person can do about the state of a route, and about an error."""

from typing import Final

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.route.counters import Snapshot, State

_AGAIN: Final = 'It is tried again by itself; mend what the reason names.'
_AWAITED: Final = 'It begins once what the reason names is there.'
_FINAL: Final = 'It is not tried again: mend what the reason names, then reload the configuration.'
_DROPS: Final = (
    'It goes on by itself once that has ended. Where too much waits meanwhile, the oldest is '
    'dropped (when_full), and counted.'
)
_ADVICE: Final = {
    State.STARTING: 'Wait: it begins once Kafka and ROS have answered.',
    State.RUNNING: '',
    State.STOPPED: 'It ends with the bridge, which stops or is not active, or was taken out of '
    'the configuration.',
}
_HELD_BACK: Final = {
    Direction.KAFKA_TO_ROS: {
        State.WAITING: 'It goes on by itself once that has ended. What comes meanwhile waits in '
        'Kafka, as long as that keeps it.',
        State.PAUSED: 'Resume it when the reason for the pause is gone; what comes meanwhile '
        'waits in Kafka, as long as that keeps it.',
    },
    Direction.ROS_TO_KAFKA: {
        State.WAITING: 'It goes on by itself once that has ended. What it cannot take meanwhile, '
        'publishers lose that are not reliable and KEEP_ALL.',
        State.PAUSED: 'Resume it when the reason for the pause is gone; publishers that are not '
        'reliable and KEEP_ALL lose what they send meanwhile.',
    },
}

ERROR_ADVICE: Final = {
    'DecodeError': "Look into its dead letter, mend its sender or the route's format, replay it.",
    'EncodeError': "Look into its dead letter, mend the route's format or its schema, replay it.",
    'LoopError': 'Let its sender leave bridge.origin out, or set skip_own: true; then replay it.',
    'RecordTooLargeError': 'Raise the limit that is named, then replay its dead letter.',
    'RouteError': 'Mend what is named: its route tells whether it is tried again by itself.',
    'TimestampError': 'Mend the wrong clock, or the unit of the timestamps, then replay it.',
    'TransportError': 'It goes on by itself once the other side is back.',
}
"""What to do about an error whose text does not say it, by its class."""


def advice(snapshot: Snapshot, route: AnyRoute | None) -> str:
    """What to do about the state of a route; empty where it is well.

    Args:
        snapshot: Of the route.
        route: Its settings; None where the configuration has it no more: then what costs most is
            said.
    """
    if snapshot.state is State.FAILED:
        return _FINAL if snapshot.final else _AGAIN
    if snapshot.state is State.STARTING and snapshot.reason:
        return _AWAITED
    if snapshot.state is State.WAITING and route is not None and route.drops:
        return _DROPS
    direction = Direction.ROS_TO_KAFKA if route is None else route.direction
    return (_ADVICE | _HELD_BACK[direction])[snapshot.state]
