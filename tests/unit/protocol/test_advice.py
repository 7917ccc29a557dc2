"""What the page and /diagnostics say to do about the state of a route."""

from support.monitoring.monitors import snapshot

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.protocol.advice import advice
from ros2_kafka_bridge.route.counters import State


def test_a_route_that_says_what_it_awaits_is_not_said_to_begin_with_kafka_and_ros() -> None:
    silent = snapshot('a', State.STARTING)
    awaits = silent._replace(reason='waits for a publisher: set ROS_SUPER_CLIENT=TRUE')
    assert 'Kafka and ROS' in advice(silent, Direction.ROS_TO_KAFKA)
    said = advice(awaits, Direction.ROS_TO_KAFKA)
    assert said == 'It begins once what the reason names is there.'


def test_of_a_route_that_the_configuration_has_no_more_what_costs_most_is_said() -> None:
    waits = snapshot('a', State.WAITING)
    said = {direction: advice(waits, direction) for direction in Direction}
    assert advice(waits, None) == said[Direction.ROS_TO_KAFKA] != said[Direction.KAFKA_TO_ROS]
