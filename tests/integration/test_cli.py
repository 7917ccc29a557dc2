"""The command line as a user meets it: what it prints, and its exit status."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.bridges.routes import lines, to_kafka, to_ros
from support.patience import patient
from support.processes.harness import START, Bench, Process
from support.processes.terminal import finished

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.commands.run import run
from ros2_kafka_bridge.outside.extras import how_to_get_ros
from ros2_kafka_bridge.testing.local_kafka import free_port

Unique = Callable[[str], str]
SECRET = 'open-sesame'  # noqa: S105 (of the test)
SASL = {
    'security.protocol': 'SASL_PLAINTEXT',
    'sasl.mechanisms': 'PLAIN',
    'sasl.username': 'robot',
    'sasl.password': SECRET,
}
BAD = """\
name: warehouse-1
kafka: {bootstrap.servers: localhost:9092, group.id: mine}
routes:
  - name: orders
    from: {kafka: orders, start: earlyest}
    to: {ros: /orders, type: std_msgs/msg/Strin}
    format: text
"""
MISTAKES = """\
{file}:2: kafka.group.id: is refused: use 'group' in 'from' of a route: every route has a group \
of its own
{file}:5: routes[0].from.start: expected latest or earliest (did you mean 'earliest'?)
{file}:6: routes[0].to.type: no message type std_msgs/msg/Strin here (did you mean \
std_msgs/msg/String?)
"""


def kafka_too(file: Path, properties: dict[str, str]) -> Path:
    """Add librdkafka properties to a configuration."""
    more = ''.join(f', {name}: {value}' for name, value in properties.items())
    file.write_text(re.sub(r'(bootstrap\.servers: [^}]*)', rf'\g<1>{more}', file.read_text()))
    return file


# Start


def test_help_loads_nothing_heavy() -> None:
    program = (
        'import sys; sys.argv = ["ros2-kafka-bridge", "--help"]\n'
        'from ros2_kafka_bridge.cli import main\n'
        'try: main()\n'
        'except SystemExit as end: assert end.code == 0\n'
        'heavy = {"rclpy", "confluent_kafka", "pydantic", "ruamel.yaml", "msgspec", "rich"}\n'
        'assert not heavy & {*sys.modules}, heavy & {*sys.modules}'
    )
    done = finished([sys.executable, '-c', program])
    assert done.returncode == 0, done.stderr
    assert {'run', 'check'} <= set(done.stdout.split())


def test_the_version_is_told(bench: Bench) -> None:
    assert bench.command('--version') == (0, f'{__version__}\n', '')


def test_without_a_command_the_help_is_shown(bench: Bench) -> None:
    _, out, err = bench.command()
    assert 'Usage: ' in out + err


# A file that is wrong


@pytest.mark.parametrize('command', ['check', 'run'])
def test_every_mistake_in_a_file_is_one_line_and_nothing_is_started(
    bench: Bench, command: str
) -> None:
    file = bench.place / 'bad.yaml'
    file.write_text(BAD)
    assert bench.command(command, str(file)) == (2, '', MISTAKES.format(file=file))


@pytest.mark.parametrize('command', ['check', 'run'])
def test_a_file_that_cannot_be_read_is_one_line(bench: Bench, command: str) -> None:
    missing = bench.place / 'missing.yaml'
    assert bench.command(command, str(missing)) == (2, '', f'{missing}: no such file\n')
    expected = (2, '', f'{bench.place}: a directory: name the file in it\n')
    assert bench.command(command, str(bench.place)) == expected


# run


def test_run_runs_the_routes_that_are_asked_for(bench: Bench, unique: Unique) -> None:
    first, second = unique('first'), unique('second')
    routes = [to_kafka('/orders', first, name='a'), to_kafka('/orders', second, name='b')]
    file = bench.config(routes)
    with (
        bench.run(file, '--routes', 'a') as bridge,
        bench.publisher('/orders', '--count', '10') as publisher,
    ):
        publisher.wait_for('published')
        assert len(bench.records(first, 10)) == 10
        assert bridge.end() == 0
    assert f'bridge {bench.name} runs 1 route on' in bridge.output()
    assert ' b: ' not in bridge.output()
    assert second not in bench.admin().list_topics(timeout=patient(10)).topics


def test_run_becomes_the_process_that_other_tests_begin_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    became: list[str] = []
    monkeypatch.setattr(
        'ros2_kafka_bridge.process.child_process.become',
        lambda module, options: became.extend([f'ros2_kafka_bridge.{module}', *options]),
    )
    run(Path('bridge.yaml'))
    assert ['-P', '-m', *became] == [*START, '--', 'bridge.yaml']


def test_run_refuses_a_route_that_is_not_there(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders', name='a')])
    expected = '--routes: no route x, there are a\n--routes: no route y, there are a\n'
    assert bench.command('run', str(file), '--routes', 'a,y,x') == (2, '', expected)


@pytest.mark.parametrize('log_format', ['text', 'json'])
def test_no_secret_is_in_the_log_and_no_other_client_writes_to_it(
    bench: Bench, log_format: str
) -> None:
    bench.bootstrap_servers = f'127.0.0.1:{free_port()}'
    routes = [to_ros('orders', '/orders'), to_kafka('/latched', 'latched')]
    file = kafka_too(bench.config(routes, defaults={'drain_s': 0}), SASL)
    latched = ('--durability', 'transient_local', '--readers', '0', '--count', '1')
    with (
        bench.publisher('/latched', *latched) as publisher,
        bench.run(file, '--log-format', log_format) as bridge,
    ):
        publisher.wait_for('published')
        bridge.wait_for('Kafka is away')
        bridge.wait_for('topic latched cannot be read')
        bridge.end()
    assert SECRET not in bridge.output()
    if log_format == 'json':
        found = [json.loads(line) for line in logged(bridge)]
        assert {line.get('route') for line in found} == {None, 'to_ros', 'to_kafka'}
        assert all({'time', 'level', 'message'} <= line.keys() for line in found)
    else:
        written = r'\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|WARNING|ERROR) +\S.*'
        assert [line for line in logged(bridge) if not re.fullmatch(written, line)] == []


def logged(bridge: Process) -> list[str]:
    """The lines of the bridge itself."""
    # DDS writes to the same place, in its own way: shared memory that a killed process has left.
    return [line for line in lines(bridge.log) if '[RTPS_TRANSPORT_SHM Error]' not in line]


# Environment


def test_without_rclpy_one_sentence_says_what_to_install(bench: Bench) -> None:
    [sentence] = without('rclpy', bench)
    assert sentence.startswith("ROS 2 is not here (No module named 'rclpy')")
    assert sentence.endswith(how_to_get_ros())


def test_an_rclpy_of_another_python_is_not_said_to_be_missing(bench: Bench) -> None:
    [sentence] = without('rclpy._rclpy_pybind11', bench)
    assert sentence.startswith('ROS 2 is here, and ')
    assert "(No module named 'rclpy._rclpy_pybind11'): a sourced ROS 2 needs its own" in sentence


def without(module: str, bench: Bench) -> list[str]:
    """What a bridge says whose rclpy finds no such module."""
    file = bench.config([to_ros('orders', '/orders')])
    error = f'ModuleNotFoundError({f"No module named {module!r}"!r}, name={module!r})'
    (bench.place / 'rclpy.py').write_text(f'raise {error}')
    with bench.run(file, PYTHONPATH=str(bench.place)) as bridge:
        assert bridge.wait() == 2
    return lines(bridge.log)


def test_a_file_that_can_be_read_only_once_is_not_run(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    command = f'{sys.executable} -m ros2_kafka_bridge run <(cat {file})'
    done = finished(['bash', '-c', command])
    assert done.returncode == 2
    assert re.fullmatch(r'/dev/fd/\d+: can be read only once: .*\n', done.stderr)


def test_a_ros_that_cannot_start_is_one_sentence(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    with bench.run(file, ROS_SECURITY_ENABLE='true', ROS_SECURITY_STRATEGY='Enforce') as bridge:
        assert bridge.wait() == 2
    [sentence] = [line for line in lines(bridge.log) if not line.startswith('[')]
    assert sentence.startswith('ROS: ')


def test_a_dds_profile_that_cannot_be_read_is_one_sentence(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    with bench.run(file, FASTDDS_DEFAULT_PROFILES_FILE='/missing.xml') as bridge:
        assert bridge.wait() == 2
    [sentence] = lines(bridge.log)
    assert sentence.startswith('/missing.xml: the DDS profile cannot be read: ')
