"""A key that names fields of a type is looked at with the file, not when its route runs."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.process.load import load_checked

POSE = 'geometry_msgs/msg/PoseStamped'
ARRAY = 'std_msgs/msg/Float32MultiArray'


def written(place: Path, key: str, message_type: str | None) -> Path:
    file = place / 'bridge.yaml'
    kind = f', type: {message_type}' if message_type else ''
    file.write_text(
        "name: b\nkafka: {bootstrap.servers: 'localhost:1'}\nroutes:\n  - name: a\n"
        f"    from: {{ros: /a{kind}}}\n    to:\n      kafka: a\n      key: '{key}'\n"
        '    format: cdr\n'
    )
    return file


@pytest.mark.parametrize(
    ('message_type', 'key', 'said'),
    [
        (POSE, '{message.header.robot}', ': header has stamp, frame_id'),
        (POSE, '{message.header.fram_id}', ' (did you mean header.frame_id?)'),
        (POSE, '{message.header}', ' (did you mean header.stamp.sec or header.stamp.nanosec or '),
        (POSE, 'a-{message.header.frame_id.x}', ': header.frame_id has no fields'),
        (POSE, '{message.robot}', ': it has header, pose'),
        (ARRAY, '{message.data}', ': data is a list'),
        (ARRAY, '{message.layout.dim.label}', ': layout.dim is a list'),
        ('std_msgs/msg/Empty', '{message.data}', ': it has no fields'),
    ],
)
def test_a_key_of_a_field_that_the_type_lacks_is_a_mistake_with_its_line(
    tmp_path: Path, message_type: str, key: str, said: str
) -> None:
    file = written(tmp_path, key, message_type)
    with pytest.raises(ConfigError) as caught:
        load_checked(file)
    field = key.partition('{message.')[2].rstrip('}')
    [problem] = caught.value.problems
    at = f'{file}:8: routes[0].to.key: {message_type} has no number or text at {field}'
    assert problem.startswith(f'{at}{said}')


def test_each_wrong_field_of_a_key_is_told_once(tmp_path: Path) -> None:
    file = written(tmp_path, '{message.a}{message.b}{message.a}', POSE)
    with pytest.raises(ConfigError) as caught:
        load_checked(file)
    [problem] = caught.value.problems
    assert problem.count(' has no number or text at ') == 2


@pytest.mark.parametrize(
    ('message_type', 'key'),
    [
        (POSE, '{message.header.frame_id}/{message.header.stamp.sec}'),
        ('test_msgs/msg/WStrings', '{message.wstring_value}'),
        (None, '{message.whatever.there.is}'),  # the graph will tell
    ],
)
def test_a_key_of_which_nothing_is_wrong_is_right(
    tmp_path: Path, message_type: str | None, key: str
) -> None:
    [route] = load_checked(written(tmp_path, key, message_type)).routes
    assert getattr(route.sink, 'key', '') == key


def test_of_a_type_that_is_not_here_the_key_is_not_spoken_of(tmp_path: Path) -> None:
    file = written(tmp_path, '{message.data}', 'std_msgs/msg/Nothing')
    with pytest.raises(ConfigError) as caught:
        load_checked(file)
    [problem] = caught.value.problems
    assert 'routes[0].from.type: no message type' in problem


def test_a_folder_of_types_is_looked_at_where_no_ros_is_needed(tmp_path: Path) -> None:
    (tmp_path / 'robots' / 'msg').mkdir(parents=True)
    (tmp_path / 'robots' / 'package.xml').write_text('<package><name>robots</name></package>')
    (tmp_path / 'robots' / 'msg' / 'Id.msg').write_text('string robot\n')
    file = written(tmp_path, '{message.robo}', 'robots/msg/Id')
    file.write_text(f'ros: {{message_path: [{tmp_path}]}}\n{file.read_text()}')
    with pytest.raises(ConfigError, match=r'at robo \(did you mean robot\?\)'):
        load_checked(file)
