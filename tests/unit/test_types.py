"""Message types by name."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.layout import Array, Layout, Primitive, Sequence, String
from ros2_kafka_bridge.ros.types import load_type, type_names, unknown_type


def test_the_installed_types_are_listed_without_services_and_actions() -> None:
    names = type_names()
    assert names == sorted(set(names))
    assert {'std_msgs/msg/String', 'nav_msgs/msg/Odometry', 'test_msgs/msg/WStrings'} <= {*names}
    assert all(re.fullmatch(r'\w+/msg/\w+', name) for name in names)


@pytest.mark.parametrize('name', type_names())
def test_every_listed_type_loads_with_layout_and_hash(name: str) -> None:
    loaded = load_type(name)
    assert loaded.name == loaded.layout.type_name == name
    assert loaded.python_class.__name__ == name.split('/')[2]
    assert re.fullmatch('RIHS01_[0-9a-f]{64}', loaded.type_hash or '')


def test_the_layout_of_a_type_follows_its_definition() -> None:
    layout = load_type('test_msgs/msg/BoundedSequences').layout
    fields = dict(layout.fields)
    assert fields['bool_values'] == Sequence(Primitive('bool'), 3)
    assert fields['byte_values'] == Sequence(Primitive('byte'), 3)
    assert fields['float64_values'] == Sequence(Primitive('float64'), 3)
    assert fields['string_values'] == Sequence(String(), 3)
    covariance = dict(load_type('geometry_msgs/msg/PoseWithCovariance').layout.fields)
    assert covariance['covariance'] == Array(Primitive('float64'), 36)
    wide = dict(load_type('test_msgs/msg/WStrings').layout.fields)
    assert wide['wstring_value'] == String(wide=True)
    header = dict(load_type('std_msgs/msg/Header').layout.fields)
    assert isinstance(header['stamp'], Layout)
    assert header['stamp'].type_name == 'builtin_interfaces/msg/Time'
    assert load_type('std_msgs/msg/Empty').layout == Layout('std_msgs/msg/Empty', ())


@pytest.mark.parametrize(
    ('name', 'sentence'),
    [
        (
            'std_msgs/msg/Strin',
            'no message type std_msgs/msg/Strin here (did you mean std_msgs/msg/String?)',
        ),
        (
            'std_msgs/msg/string',
            'no message type std_msgs/msg/string here (did you mean std_msgs/msg/String?)',
        ),
        (
            'std_msgs/msg/Odometry',
            'no message type std_msgs/msg/Odometry here (did you mean nav_msgs/msg/Odometry?)',
        ),
        (
            'std_msgs/String',
            'std_msgs/String is not of the form pkg/msg/Type (did you mean std_msgs/msg/String?)',
        ),
        (
            'std_msgs.msg.String',
            (
                'std_msgs.msg.String is not of the form pkg/msg/Type'
                ' (did you mean std_msgs/msg/String?)'
            ),
        ),
        (
            'Twist',
            'Twist is not of the form pkg/msg/Type (did you mean geometry_msgs/msg/Twist?)',
        ),
        ('qqqq', 'qqqq is not of the form pkg/msg/Type'),
        ('', 'an empty name is not of the form pkg/msg/Type'),
        ('acme_msgs/msg/Zyzzyva', 'no message type acme_msgs/msg/Zyzzyva here'),
    ],
)
def test_an_unknown_type_is_named_with_what_is_near(name: str, sentence: str) -> None:
    assert unknown_type(name) == sentence
    with pytest.raises(ConfigError) as caught:
        load_type(name)
    assert caught.value.problems == [sentence]


def test_a_known_type_has_no_problem() -> None:
    assert unknown_type('std_msgs/msg/String') is None


def test_a_workspace_of_the_user_is_searched_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = tmp_path / 'share/ament_index/resource_index/rosidl_interfaces'
    index.mkdir(parents=True)
    (index / 'acme_msgs').write_text('msg/Crane.idl\nmsg/Crane.msg\nsrv/Lift.srv\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:/does/not/exist')
    assert 'acme_msgs/msg/Crane' in type_names()
    assert 'std_msgs/msg/String' in type_names()
    assert unknown_type('acme_msgs/msg/Crane') is None
    with pytest.raises(ConfigError, match='acme_msgs/msg/Crane cannot be loaded: No module'):
        load_type('acme_msgs/msg/Crane')


def test_without_ros_the_sentence_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.setattr('sys.prefix', str(tmp_path))
    monkeypatch.setattr('sysconfig.get_path', lambda _: str(tmp_path))
    assert type_names() == []
    assert 'no ROS 2 messages are installed' in (unknown_type('std_msgs/msg/String') or '')


def test_types_are_listed_without_loading_ros() -> None:
    program = (
        'import sys; from ros2_kafka_bridge.ros.types import type_names, unknown_type;'
        'assert type_names(); assert unknown_type("a/b");'
        'loaded = {"rclpy", "rosidl_parser", "std_msgs"} & {*sys.modules}; assert not loaded'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)
