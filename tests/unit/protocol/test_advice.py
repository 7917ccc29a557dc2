"""What the page and /diagnostics say to do about the state of a route."""

from monitors import snapshot

from ros2_kafka_bridge.protocol.advice import advice
from ros2_kafka_bridge.route.counters import State


def test_a_route_that_says_what_it_awaits_is_not_said_to_begin_with_kafka_and_ros() -> None:
    silent = snapshot('a', State.STARTING)
    awaits = silent._replace(reason='waits for a publisher: set ROS_SUPER_CLIENT=TRUE')
    assert 'Kafka and ROS' in advice(silent, to_ros=False)
    assert advice(awaits, to_ros=False) == 'It begins once what the reason names is there.'
