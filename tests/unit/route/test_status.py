"""What is said of a route that had to be left: what is not known of it is not nothing."""

import time

import pytest

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.status import left


@pytest.mark.parametrize('direction', Direction)
def test_what_a_route_held_that_has_told_nothing_is_not_known(direction: Direction) -> None:
    assert left(Counters('orders').nothing_told, direction) == (
        'what is not known: it has told nothing'
    )


def test_what_a_route_held_is_said_to_be_of_before_where_it_had_fallen_silent() -> None:
    told = Counters('orders', taken=9).snapshot(9)
    assert left(told, Direction.KAFKA_TO_ROS).startswith(
        '9 records in flight, read again next time (9 taken'
    )
    old = told._replace(made_s=time.monotonic() - 40)
    assert '9 records in flight, read again next time, as it told 40 s ago (' in left(
        old, Direction.KAFKA_TO_ROS
    )
    nothing = Counters('orders').snapshot(0)._replace(made_s=time.monotonic() - 40)
    assert left(nothing, Direction.ROS_TO_KAFKA).startswith(
        'nothing in flight, as it told 40 s ago ('
    )
