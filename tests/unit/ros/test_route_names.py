"""What routes are called in names of ROS."""

import re

from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.ros.control.route_names import ros_names

NAMES = st.lists(st.from_regex(r'[A-Za-z0-9._-]{1,90}', fullmatch=True), unique=True, max_size=8)


def test_a_name_that_ros_takes_stays() -> None:
    assert ros_names(['orders', 'to_robot_7']) == {'orders': 'orders', 'to_robot_7': 'to_robot_7'}


def test_what_ros_does_not_take_becomes_an_underscore() -> None:
    found = ros_names(['to.ros', 'a--b', '9lives', '-'])
    assert list(found.values()) == ['to_ros', 'a_b', 'route_9lives', 'route']


def test_names_that_became_alike_are_numbered_in_the_order_of_the_file() -> None:
    names = ['a.b', 'a-b', 'a_b', 'a..b']
    assert ros_names(names) == {'a.b': 'a_b_2', 'a-b': 'a_b_3', 'a_b': 'a_b', 'a..b': 'a_b_4'}


@given(NAMES)
def test_any_names_are_legal_different_and_in_order(names: list[str]) -> None:
    found = ros_names(names)
    assert list(found) == names
    assert len(set(found.values())) == len(names)
    for name in found.values():
        assert re.fullmatch(r'[A-Za-z_][A-Za-z0-9_]*', name)
        assert '__' not in name
        assert len(name) < 100
