"""What a route is called and what is to be done about its state, for people and for labels."""

from typing import Final

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.route.counters import Snapshot, State

_AGAIN: Final = 'It is tried again by itself; mend what the reason names.'
_FINAL: Final = 'It is not tried again: mend what the reason names, then reload the configuration.'
_ADVICE: Final = {
    State.STARTING: 'Wait: it begins once Kafka and ROS have answered.',
    State.RUNNING: '',
    State.WAITING: 'Nothing is lost: it goes on by itself once that has ended.',
    State.PAUSED: 'Resume it when the reason for the pause is gone; what comes meanwhile waits.',
    State.STOPPED: 'It ends with the bridge, or was taken out of the configuration.',
}

ERROR_ADVICE: Final = {
    'DecodeError': "Look into its dead letter, mend its sender or the route's format, replay it.",
    'EncodeError': "Look into its dead letter, mend the route's format or its schema, replay it.",
    'RecordTooLargeError': 'Raise the limit that is named, then replay its dead letter.',
    'RouteError': 'The route is tried again by itself: mend what is named.',
    'TransportError': 'It goes on by itself once the other side is back.',
}
"""What to do about an error whose text does not say it, by its class."""


def direction_of(route: AnyRoute) -> str:
    """`kafka_to_ros` or `ros_to_kafka`."""
    return 'kafka_to_ros' if isinstance(route, KafkaToRosRoute) else 'ros_to_kafka'


def ends_of(route: AnyRoute) -> tuple[str, str]:
    """The topic that a route reads, and the one that it writes."""
    if isinstance(route, KafkaToRosRoute):
        return route.source.kafka, route.sink.ros
    return route.source.ros, route.sink.kafka


def type_of(route: AnyRoute) -> str:
    """The message type; empty where the graph tells it."""
    if isinstance(route, KafkaToRosRoute):
        return route.sink.type
    return route.source.type or ''


def advice(snapshot: Snapshot) -> str:
    """What to do about the state of a route; empty where it is well."""
    if snapshot.state is State.FAILED:
        return _FINAL if snapshot.final else _AGAIN
    return _ADVICE[snapshot.state]
