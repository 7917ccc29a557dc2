"""Fields of a message that are read by their path, and fields that hold raw data."""

import pytest
from rclpy.serialization import serialize_message
from support.formats.messages import Writer, layout_of, new_message, random_message

from ros2_kafka_bridge.errors import ConfigError, DecodeError
from ros2_kafka_bridge.formats.walk import make_reader
from ros2_kafka_bridge.message_types.layout import PRIMITIVES, is_bulk


def test_a_field_is_read_by_its_path_in_both_byte_orders() -> None:
    message = random_message('nav_msgs/msg/Odometry', 9)
    message.child_frame_id = 'bäse'
    layout = layout_of('nav_msgs/msg/Odometry')
    for order in '<>':
        value = Writer(order).value_of(message, layout)
        assert make_reader(layout, 'child_frame_id')(value) == 'bäse'
        assert make_reader(layout, 'header.stamp.sec')(value) == message.header.stamp.sec
        y = message.pose.pose.position.y
        assert make_reader(layout, 'pose.pose.position.y')(value) == y


@pytest.mark.parametrize('path', [*(f'{name}_value' for name in PRIMITIVES if name != 'bool')])
def test_every_primitive_is_read(path: str) -> None:
    name = 'test_msgs/msg/BasicTypes'
    message = random_message(name, 4)
    expected = getattr(message, path)
    found = make_reader(layout_of(name), path)(serialize_message(message))
    assert found == (expected[0] if isinstance(expected, bytes) else expected)


def test_a_bool_is_read_as_a_bool() -> None:
    reader = make_reader(layout_of('std_msgs/msg/Bool'), 'data')
    assert reader(b'\0\1\0\0\1') is True
    assert reader(b'\0\1\0\0\0') is False
    with pytest.raises(DecodeError, match='data: needs a bool'):
        reader(b'\0\1\0\0\2')


def test_a_wide_string_is_read_with_letters_beyond_16_bits() -> None:
    message = new_message('test_msgs/msg/WStrings')
    message.wstring_value = 'aж𝄞'
    reader = make_reader(layout_of('test_msgs/msg/WStrings'), 'wstring_value')
    assert reader(serialize_message(message)) == 'aж𝄞'


def test_a_field_behind_strings_and_sequences_is_read() -> None:
    name = 'sensor_msgs/msg/PointCloud2'
    message = random_message(name, 2)
    value = serialize_message(message)
    assert make_reader(layout_of(name), 'is_dense')(value) == message.is_dense
    with pytest.raises(DecodeError):
        make_reader(layout_of(name), 'is_dense')(value[:-1])


@pytest.mark.parametrize(
    ('path', 'words'),
    [
        ('header.fram_id', 'no number or text at header.fram_id (did you mean header.frame_id?)'),
        ('frame_id', 'no number or text at frame_id (did you mean header.frame_id?)'),
        ('header.stamp', 'no number or text at header.stamp (did you mean header.stamp.sec or '),
        ('pose.covariance', 'no number or text at pose.covariance'),
        ('', 'no number or text at '),
    ],
)
def test_a_path_to_no_scalar_is_a_mistake_in_the_configuration(path: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make_reader(layout_of('nav_msgs/msg/Odometry'), path)
    assert caught.value.problems[0].startswith(f'nav_msgs/msg/Odometry has {words}')


@pytest.mark.parametrize(
    'name',
    [
        'sensor_msgs/msg/Image',
        'sensor_msgs/msg/PointCloud2',
        'stereo_msgs/msg/DisparityImage',
        'nav_msgs/msg/OccupancyGrid',
    ],
)
def test_raw_data_of_any_length_is_seen_in_a_type_and_in_what_it_holds(name: str) -> None:
    assert is_bulk(layout_of(name))


@pytest.mark.parametrize(
    'name',
    [
        'std_msgs/msg/String',
        'sensor_msgs/msg/JointState',
        'sensor_msgs/msg/LaserScan',
        'unique_identifier_msgs/msg/UUID',
        'diagnostic_msgs/msg/DiagnosticArray',
    ],
)
def test_text_numbers_and_what_has_one_length_are_no_raw_data(name: str) -> None:
    assert not is_bulk(layout_of(name))
