"""Types of installed packages."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import load_layout, type_names, unknown_type
from ros2_kafka_bridge.message_types.description import type_hash
from ros2_kafka_bridge.message_types.installed import read_installed
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)


def test_the_installed_types_are_listed_without_services_and_actions() -> None:
    names = type_names()
    assert names == sorted(set(names))
    assert {'std_msgs/msg/String', 'nav_msgs/msg/Odometry', 'test_msgs/msg/WStrings'} <= {*names}
    assert all(re.fullmatch(r'\w+/msg/\w+', name) for name in names)


def test_a_computed_hash_is_the_one_that_the_package_ships() -> None:
    for name in type_names():
        described = read_installed(name)
        assert type_hash(name, described.types) == described.hashes[name]


def test_the_layout_of_a_type_follows_its_definition() -> None:
    layout = load_layout('test_msgs/msg/BoundedSequences')
    fields = {field.name: field for field in layout.fields}
    assert fields['bool_values'].kind == Sequence(Primitive('bool'), 3)
    assert fields['byte_values'].kind == Sequence(Primitive('byte'), 3)
    assert fields['float64_values'].kind == Sequence(Primitive('float64'), 3)
    assert fields['string_values_default'] == Field(
        'string_values_default', Sequence(String(), 3), ('', 'max value', 'min value')
    )
    strings = {field.name: field for field in load_layout('test_msgs/msg/Strings').fields}
    assert strings['bounded_string_value_default2'] == Field(
        'bounded_string_value_default2', String(22), "Hello'world!"
    )
    covariance = load_layout('geometry_msgs/msg/PoseWithCovariance').fields[1]
    assert covariance == Field('covariance', Array(Primitive('float64'), 36))
    wide = {field.name: field for field in load_layout('test_msgs/msg/WStrings').fields}
    assert wide['wstring_value_default3'].kind == String(wide=True)
    assert wide['wstring_value_default3'].default == 'ハローワールド'
    assert wide['array_of_wstrings'].kind == Array(String(wide=True), 3)


def test_every_nested_type_has_its_own_hash() -> None:
    header = load_layout('std_msgs/msg/Header')
    assert header.fields[0].kind == load_layout('builtin_interfaces/msg/Time')
    assert isinstance(header.fields[0].kind, Layout)
    assert re.fullmatch('RIHS01_[0-9a-f]{64}', header.fields[0].kind.type_hash or '')


def test_a_message_without_fields_shows_no_field() -> None:
    assert load_layout('std_msgs/msg/Empty').fields == ()


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
        load_layout(name)
    assert caught.value.problems == [sentence]


def test_a_known_type_has_no_problem() -> None:
    assert unknown_type('std_msgs/msg/String') is None


def test_without_ros_the_sentence_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.setattr('sys.prefix', str(tmp_path))
    monkeypatch.setattr('sysconfig.get_path', lambda _: str(tmp_path))
    assert type_names() == []
    assert 'no ROS 2 messages are installed' in (unknown_type('std_msgs/msg/String') or '')


def test_a_layout_is_read_without_loading_ros() -> None:
    program = (
        'import sys;'
        'from ros2_kafka_bridge.message_types import load_layout, type_names, unknown_type;'
        'assert type_names(); assert unknown_type("a/b"); load_layout("nav_msgs/msg/Odometry");'
        'loaded = {"rclpy", "rosidl_parser", "rosidl_adapter", "std_msgs"} & {*sys.modules};'
        'assert not loaded, loaded'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=60)


def test_threads_that_load_types_at_the_same_time_end_no_process() -> None:
    """As the routes of a bridge do at its start; of ten runs msgspec crashed four."""
    program = (
        'import sys, threading;'
        'sys.setswitchinterval(1e-6);'
        'from ros2_kafka_bridge.message_types.installed import read_installed;'
        'barrier = threading.Barrier(8);'
        'load = lambda: (barrier.wait(), read_installed("std_msgs/msg/String"));'
        'threads = [threading.Thread(target=load) for _ in range(8)];'
        '[thread.start() for thread in threads];'
        '[thread.join() for thread in threads]'
    )
    for _ in range(5):
        subprocess.run([sys.executable, '-c', program], check=True, timeout=60)


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where acme_msgs/msg/Crane is installed, but for its description."""
    index = tmp_path / 'share/ament_index/resource_index/rosidl_interfaces'
    index.mkdir(parents=True)
    (index / 'acme_msgs').write_text('msg/Crane.idl\nmsg/Crane.msg\nsrv/Lift.srv\n')
    (tmp_path / 'share/acme_msgs/msg').mkdir(parents=True)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:/does/not/exist')
    return tmp_path


def described(*fields: tuple[str, int, str, str]) -> str:
    """A description of acme_msgs/msg/Crane with fields of name, type_id, nested type, default."""
    listed = [
        {
            'name': name,
            'type': {
                'type_id': type_id,
                'capacity': 0,
                'string_capacity': 0,
                'nested_type_name': nested,
            },
            'default_value': default,
        }
        for name, type_id, nested, default in fields
    ]
    description = {'type_name': 'acme_msgs/msg/Crane', 'fields': listed}
    message = {'type_description': description, 'referenced_type_descriptions': []}
    return json.dumps({'type_description_msg': message, 'type_hashes': []})


def test_a_workspace_of_the_user_is_searched_too(prefix: Path) -> None:
    assert 'acme_msgs/msg/Crane' in type_names()
    assert 'std_msgs/msg/String' in type_names()
    assert unknown_type('acme_msgs/msg/Crane') is None
    (prefix / 'share/acme_msgs/msg/Crane.json').write_text(described(('height', 11, '', '2.5')))
    layout = load_layout('acme_msgs/msg/Crane')
    assert layout == Layout('acme_msgs/msg/Crane', (Field('height', Primitive('float64'), 2.5),))


def test_a_package_of_before_iron_is_read_by_its_definitions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = {'T': 'std_msgs/Header header\nU[2] parts\n', 'U': 'float64 a 2.5\n'}
    package = write_package(tmp_path / 'src', 'acme_msgs', messages)
    install_package(package, tmp_path, ['std_msgs', 'builtin_interfaces'])
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    of_json = load_layout('acme_msgs/msg/T')
    for name in messages:
        (tmp_path / f'share/acme_msgs/msg/{name}.json').unlink()
    assert load_layout('acme_msgs/msg/T') == of_json


@pytest.mark.usefixtures('prefix')
def test_a_package_without_descriptions_and_definitions_is_told() -> None:
    said = r'installed, and neither share/acme_msgs/msg/Crane\.json nor \.msg can be read: build'
    with pytest.raises(ConfigError, match=said):
        load_layout('acme_msgs/msg/Crane')


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', r'Crane\.json: no description of a message type: Input data was truncated'),
        ('{"type_hashes": []}', r'Crane\.json: no description of .*missing required field'),
        (described(('hook', 1, 'acme_msgs/msg/Hook', '')), 'no description of acme_msgs/msg/Hook'),
        (
            described(('letter', 14, '', '')),
            'Crane, field letter: type_id 14 .* cannot be carried',
        ),
        (described(('letters', 200, '', '')), 'Crane, field letters: there is no type_id 200'),
        (
            described(('height', 11, '', 'tall')),
            "field height: the default 'tall' is no number",
        ),
        (described(('height', 155, '', '(1.0, x)')), "height: the default ' x' is no number"),
        (described(('count', 6, '', 'few')), "field count: the default 'few' is no literal"),
        (described(('count', 6, '', '(')), r"field count: the default '\(' is no literal"),
        (
            described(('crane', 1, 'acme_msgs/msg/Crane', '')),
            'acme_msgs/msg/Crane holds itself: acme_msgs/msg/Crane > acme_msgs/msg/Crane',
        ),
    ],
)
def test_a_description_that_is_no_use_is_told(text: str, problem: str, prefix: Path) -> None:
    (prefix / 'share/acme_msgs/msg/Crane.json').write_text(text)
    with pytest.raises(ConfigError, match=problem):
        load_layout('acme_msgs/msg/Crane')


def test_a_type_is_that_of_the_first_place_that_has_it_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of an overlay hides its underlay, too: the two may differ, and nothing would tell."""
    over, under = tmp_path / 'over', tmp_path / 'under'
    for prefix, text in ((over, 'int32 a\nint32 added\n'), (under, 'int32 a\n')):
        install_package(write_package(prefix / 'src', 'acme_msgs', {'T': text}), prefix)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{over}:{under}')
    assert [field.name for field in load_layout('acme_msgs/msg/T').fields] == ['a', 'added']
    (over / 'share/acme_msgs/msg/T.json').unlink()
    (over / 'share/acme_msgs/msg/T.msg').unlink()
    with pytest.raises(ConfigError, match='acme_msgs/msg/T is installed, and neither'):
        load_layout('acme_msgs/msg/T')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(under))
    assert [field.name for field in load_layout('acme_msgs/msg/T').fields] == ['a']
