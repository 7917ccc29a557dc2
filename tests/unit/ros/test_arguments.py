"""The command line of `ros2 run` and launch, taken apart."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros.arguments import config_parameter, taken_apart


def test_arguments_of_ros_end_at_two_dashes_and_may_come_again() -> None:
    found = taken_apart(
        [
            'a.yaml',
            '--ros-args',
            '-r',
            '__node:=x',
            '--',
            '--routes',
            'a',
            '--ros-args',
            '-p',
            'b:=1',
        ]
    )
    assert found.own == ('a.yaml', '--routes', 'a')
    assert found.ros == ('-r', '__node:=x', '-p', 'b:=1')


def test_without_arguments_of_ros_all_is_the_bridges_own() -> None:
    assert taken_apart(['--', '-odd.yaml']).own == ('--', '-odd.yaml')


def test_the_configuration_may_be_a_parameter_and_the_last_one_counts() -> None:
    assert config_parameter(['-p', 'config:=a.yaml', '--param', 'config:=b.yaml']) == 'b.yaml'
    assert config_parameter(['-r', 'config:=a', '-p', 'config_file:=b']) is None


@pytest.mark.parametrize('node', ['/**', '/kafka_bridge', '/robot1/kafka_bridge'])
def test_the_configuration_may_stand_in_a_file_of_parameters(tmp_path: Path, node: str) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(f'{node}:\n  ros__parameters:\n    config: /etc/bridge.yaml\n')
    assert config_parameter(['--params-file', str(file)]) == '/etc/bridge.yaml'


def test_a_file_of_parameters_with_namespaces_is_read_too(tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text('robot1:\n  kafka_bridge:\n    ros__parameters: {config: b.yaml}\n')
    assert config_parameter(['--params-file', str(file)]) == 'b.yaml'


@pytest.mark.parametrize('content', [None, '{', '- 1', 'a: {ros__parameters: {x: 1}}'])
def test_a_file_of_parameters_that_cannot_be_read_is_named(
    tmp_path: Path, content: str | None
) -> None:
    file = tmp_path / 'parameters.yaml'
    if content is not None:
        file.write_text(content)
    if content in {None, '{'}:
        with pytest.raises(ConfigError, match=r'parameters\.yaml'):
            config_parameter(['--params-file', str(file)])
    else:
        assert config_parameter(['--params-file', str(file)]) is None
