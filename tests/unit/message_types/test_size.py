"""How large a message of a type may be, beside what ROS itself makes of the largest."""

import pytest
from rclpy.serialization import serialize_message
from support.formats.messages import layout_of, new_message

from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)
from ros2_kafka_bridge.message_types.size import largest_message_bytes

ROUTES_BYTES = 1_000_000


@pytest.mark.parametrize(
    'name',
    [
        'geometry_msgs/msg/Twist',
        'geometry_msgs/msg/PoseWithCovariance',
        'unique_identifier_msgs/msg/UUID',
        'builtin_interfaces/msg/Time',
        'std_msgs/msg/Empty',
        'std_msgs/msg/Bool',
        'geometry_msgs/msg/Inertia',
        'sensor_msgs/msg/NavSatStatus',
        'shape_msgs/msg/Plane',
    ],
)
def test_what_has_one_length_is_known_to_the_byte(name: str) -> None:
    sent = serialize_message(new_message(name))
    assert largest_message_bytes(layout_of(name), ROUTES_BYTES) == len(sent)


@pytest.mark.parametrize('name', ['sensor_msgs/msg/Image', 'sensor_msgs/msg/PointCloud2'])
def test_raw_data_of_any_length_is_as_large_as_the_route_takes(name: str) -> None:
    assert largest_message_bytes(layout_of(name), 5_000_000) == 5_000_000


@pytest.mark.parametrize('name', ['std_msgs/msg/String', 'sensor_msgs/msg/LaserScan'])
def test_of_text_and_numbers_of_any_length_nothing_is_known(name: str) -> None:
    assert largest_message_bytes(layout_of(name), ROUTES_BYTES) is None


def test_many_of_one_kind_are_padded_as_they_lie() -> None:
    """A byte and a double: 16 bytes each but for the last, of whatever there is before."""
    inner = Layout('a/msg/B', (Field('d', Primitive('float64')), Field('b', Primitive('int8'))))
    for count in range(1, 40):
        outer = Layout(
            'a/msg/A', (Field('first', Primitive('int8')), Field('all', Array(inner, count)))
        )
        assert largest_message_bytes(outer, ROUTES_BYTES) == 4 + 8 + 16 * (count - 1) + 12


def test_what_has_a_bound_is_as_large_as_that() -> None:
    layout = Layout(
        'a/msg/A',
        (
            Field('name', String(bound=10)),
            Field('data', Sequence(Primitive('uint8'), bound=1000)),
            Field('x', Primitive('float64')),
        ),
    )
    largest = 4 + (4 + 11) + 1 + (4 + 1000) + 4 + 8
    assert largest_message_bytes(layout, ROUTES_BYTES) == largest


@pytest.mark.parametrize(('item', 'size_bytes'), [('uint8', ROUTES_BYTES), ('float32', None)])
def test_a_bound_that_is_far_above_all_messages_says_nothing(
    item: str, size_bytes: int | None
) -> None:
    layout = Layout('a/msg/A', (Field('data', Sequence(Primitive(item), bound=100_000_000)),))
    assert largest_message_bytes(layout, ROUTES_BYTES) == size_bytes


def test_one_length_counts_also_where_the_route_takes_no_such_message() -> None:
    layout = Layout('a/msg/A', (Field('data', Array(Primitive('float64'), 1_000_000)),))
    assert largest_message_bytes(layout, ROUTES_BYTES) == 8_000_004


def test_a_type_that_holds_the_same_again_and_again_is_looked_at_once() -> None:
    kind: Layout = Layout('a/msg/T0', (Field('x', Primitive('int64')),))
    for level in range(1, 40):
        kind = Layout(f'a/msg/T{level}', (Field('a', Array(kind, 2)), Field('b', kind)))
    assert largest_message_bytes(kind, ROUTES_BYTES) == 4 + 8 * 3**39
