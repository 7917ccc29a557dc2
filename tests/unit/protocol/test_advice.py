"""What the page and /diagnostics say to do about the state of a route."""

from typing import Any

import pytest
from support.bridges.routes import to_kafka, to_ros
from support.monitoring.monitors import snapshot

from ros2_kafka_bridge.config.routes import KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.protocol.advice import advice
from ros2_kafka_bridge.route.counters import State

WAITS = snapshot('a', State.WAITING)


def from_ros(**more: Any) -> RosToKafkaRoute:
    return validated(RosToKafkaRoute, to_kafka('/orders', 'orders', **more))


def from_kafka(**more: Any) -> KafkaToRosRoute:
    return validated(KafkaToRosRoute, to_ros('orders', '/orders', **more))


def test_a_route_that_says_what_it_awaits_is_not_said_to_begin_with_kafka_and_ros() -> None:
    silent = snapshot('a', State.STARTING)
    awaits = silent._replace(reason='waits for a publisher: set ROS_SUPER_CLIENT=TRUE')
    assert 'Kafka and ROS' in advice(silent, from_ros())
    said = advice(awaits, from_ros())
    assert said == 'It begins once what the reason names is there.'


def test_of_a_route_that_the_configuration_has_no_more_what_costs_most_is_said() -> None:
    assert advice(WAITS, None) == advice(WAITS, from_ros()) != advice(WAITS, from_kafka())


@pytest.mark.parametrize('make', [from_ros, from_kafka])
def test_of_a_route_that_drops_no_publisher_is_said_to_lose_anything(make: Any) -> None:
    said = advice(WAITS, make(when_full='drop_oldest'))
    assert 'the oldest is dropped (when_full), and counted' in said
    assert 'lose' not in said
