"""The command line as a user meets it: what it prints, and its exit status."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from harness import Bench, eventually, lines, to_kafka, to_ros, values

from ros2_kafka_bridge import __version__
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
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 0, done.stderr
    assert {'run', 'check'} <= set(done.stdout.split())


def test_the_version_is_told(bench: Bench) -> None:
    assert bench.command('--version') == (0, f'{__version__}\n', '')


def test_without_a_command_the_help_is_shown(bench: Bench) -> None:
    _, out, err = bench.command()
    assert 'Usage: ' in out + err


# check


def test_check_says_what_a_file_holds_and_masks_its_secrets(bench: Bench) -> None:
    routes = [to_ros('orders', '/orders'), to_kafka('/orders', 'orders.returned')]
    file = kafka_too(bench.config(routes), SASL)
    expected = [
        f'{file}: 2 routes of bridge test, all well written',
        f'  kafka bootstrap.servers: {bench.bootstrap_servers}',
        '  kafka security.protocol: SASL_PLAINTEXT',
        '  kafka sasl.mechanisms: PLAIN',
        '  kafka sasl.username: robot',
        '  kafka sasl.password: ***',
        '  to_ros: Kafka orders -> ROS /orders (std_msgs/msg/String), text',
        '  to_kafka: ROS /orders (std_msgs/msg/String) -> Kafka orders.returned, text',
    ]
    status, out, err = bench.command('check', str(file))
    assert (status, out.splitlines(), err) == (0, expected, '')


def test_check_names_what_a_weaker_setting_gives_up(bench: Bench) -> None:
    file = kafka_too(bench.config([to_ros('orders', '/orders')]), {'acks': '1'})
    status, out, _ = bench.command('check', str(file))
    assert status == 0
    assert '  note kafka.acks: 1 also turns idempotence off: guarantee 2 falls' in out


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


def test_a_mistake_beside_a_secret_does_not_show_it(bench: Bench) -> None:
    wrong = {**SASL, 'sasl.mechanisms': 'PLAINE', 'ssl.key.password': SECRET, 'ssl.ca.pem': 'x'}
    file = kafka_too(bench.config([to_ros('orders', '/orders')]), wrong)
    status, out, err = bench.command('check', str(file))
    assert status == 2
    assert 'kafka.' in err
    assert SECRET not in out + err


# check --connect


def test_check_connect_finds_all_well_at_a_real_broker_and_graph(
    bench: Bench, topic_name: str
) -> None:
    bench.create_topic(topic_name, partitions=3)
    bench.create_topic(f'{topic_name}.dead-letters')
    file = bench.config([to_ros(topic_name, '/orders')])
    with bench.subscriber('/orders', bench.place / 'received') as subscriber:
        subscriber.wait_for('ready')
        status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (0, '')
    assert re.search(r'  ok   1 brokers of cluster \S+ answer', out)
    assert re.search(r'  ok   rclpy of \S+, rmw_fastrtps_cpp, ROS_DOMAIN_ID', out)
    assert f'  ok   topic {topic_name} has 3 partitions' in out
    assert f'  ok   topic {topic_name}.dead-letters has 1 partitions' in out
    assert '  ok   group test.to_ros is new: start is earliest, all that the topic holds' in out
    assert '  ok   1 subscribers of /orders match' in out
    assert 'if one is, set max_rate' in out
    assert 'BAD' not in out
    assert bench.committed('test.to_ros', topic_name) < 0, 'nothing is changed'


def test_check_connect_names_each_thing_that_does_not_fit(bench: Bench, unique: Unique) -> None:
    there, missing = unique('there'), unique('missing')
    bench.create_topic(there)
    routes = [
        to_ros(there, '/latched', name='latched'),
        to_kafka('/sensor', there, name='sensor'),
        to_kafka('/nobody', missing, name='nobody'),
    ]
    file = bench.config(routes)
    with (
        bench.subscriber(
            '/latched', bench.place / 'received', '--durability', 'transient_local'
        ) as subscriber,
        bench.publisher(
            '/sensor', '--count', '0', '--reliability', 'best_effort', '--readers', '0'
        ),
    ):
        subscriber.wait_for('ready')
        status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (1, '')
    reason = 'durability: volatile is offered, transient_local is asked for'
    assert re.search(rf'  BAD  /subscriber_\d+ does not match: {reason}; set it in to\.qos', out)
    assert '  note 0 of 1 subscribers of /latched: the route waits for them' in out
    offer = r'/publisher_\d+ publishes best_effort, volatile'
    assert re.search(rf'  note {offer}: what the network loses is lost before the bridge', out)
    assert '  note nobody publishes /nobody' in out
    assert f'  note topic {missing} is not there: the route fails unless the broker creates' in out
    assert f'dead-letter topic {there}.dead-letters is not there: it is created at the' in out
    found = bench.admin().list_topics(timeout=10).topics
    assert missing not in found, 'nothing is changed'


def test_check_connect_without_a_broker_says_so_and_still_looks_at_ros(bench: Bench) -> None:
    bench.bootstrap_servers = f'127.0.0.1:{free_port()}'
    file = kafka_too(bench.config([to_ros('orders', '/orders')]), SASL)
    status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (1, '')
    asked = f'is bootstrap.servers ({bench.bootstrap_servers}) right, does the broker run?'
    assert re.search(rf'  BAD  the broker does not answer.*{re.escape(asked)}', out)
    assert '  note 0 of 1 subscribers of /orders: the route waits for them' in out
    assert SECRET not in out


# run


def test_run_runs_the_routes_that_are_asked_for(bench: Bench, unique: Unique) -> None:
    first, second = unique('first'), unique('second')
    routes = [to_kafka('/orders', first, name='a'), to_kafka('/orders', second, name='b')]
    file = bench.config(routes)
    with (
        bench.bridge(file, '--routes', 'a') as bridge,
        bench.publisher('/orders', '--count', '10') as publisher,
    ):
        publisher.wait_for('published')
        assert len(bench.records(first, 10)) == 10
        assert bridge.end() == 0
    assert 'bridge test runs 1 routes' in bridge.output()
    assert ' b: ' not in bridge.output()
    assert second not in bench.admin().list_topics(timeout=10).topics


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
        bench.bridge(file, '--log-format', log_format) as bridge,
    ):
        publisher.wait_for('published')
        bridge.wait_for('Kafka is away')
        bridge.wait_for('topic latched cannot be read')
        bridge.end()
    assert SECRET not in bridge.output()
    if log_format == 'json':
        found = [json.loads(line) for line in lines(bridge.log)]
        assert {line.get('route') for line in found} == {None, 'to_ros', 'to_kafka'}
        assert all({'time', 'level', 'message'} <= line.keys() for line in found)
    else:
        written = r'\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|WARNING|ERROR) +\S.*'
        assert [line for line in lines(bridge.log) if not re.fullmatch(written, line)] == []


def test_a_status_line_of_each_route_comes_every_ten_seconds(
    bench: Bench, topic_name: str
) -> None:
    file = bench.config([to_kafka('/orders', topic_name)])
    with (
        bench.bridge(file, '--log-format', 'json') as bridge,
        bench.publisher('/orders', '--count', '10'),
    ):
        bridge.wait_for('running: 10 confirmed, ', timeout_s=40)
        assert bridge.end() == 0
    *_, status = [line for line in map(json.loads, lines(bridge.log)) if '/s, ' in line['message']]
    assert (status['level'], status['route']) == ('info', 'to_kafka')
    written = r'running: 10 confirmed, [01]/s, 0 in flight, 0 dead-lettered'
    assert re.fullmatch(written, status['message'])


# Environment


def test_without_rclpy_one_sentence_says_what_to_install(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    program = (
        'import sys; sys.modules["rclpy"] = None; sys.argv = ["x", "run", sys.argv[1]]\n'
        'from ros2_kafka_bridge.cli import main; main()'
    )
    done = subprocess.run(
        [sys.executable, '-c', program, str(file)],
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    [sentence] = done.stderr.splitlines()
    assert sentence.startswith('ROS 2 is not here (')
    assert sentence.endswith('install the wheels with: pip install "ros2-kafka-bridge[ros]"')


def test_a_ros_that_cannot_start_is_one_sentence(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    with bench.bridge(file, ROS_SECURITY_ENABLE='true', ROS_SECURITY_STRATEGY='Enforce') as bridge:
        assert bridge.wait() == 2
    [sentence] = [line for line in lines(bridge.log) if not line.startswith('[')]
    assert sentence.startswith('ROS: ')


PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com">
  <participant profile_name="robot" is_default_profile="true">
    <rtps>
      <name>robot 7</name>
      <builtin>
        <discovery_config>
          <leaseDuration><sec>2</sec></leaseDuration>
          <leaseAnnouncement><sec>0</sec><nanosec>500000000</nanosec></leaseAnnouncement>
        </discovery_config>
      </builtin>
    </rtps>
  </participant>
  <data_reader profile_name="/orders">
    <historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>
  </data_reader>
</profiles>
"""


def test_the_users_own_dds_profile_counts(bench: Bench, topic_name: str) -> None:
    profile = bench.place / 'profile.xml'
    profile.write_text(PROFILE)
    file = bench.config([to_kafka('/orders', topic_name)])
    with bench.bridge(file, FASTDDS_DEFAULT_PROFILES_FILE=str(profile)) as bridge:
        with bench.publisher('/orders', '--count', '3000') as publisher:
            publisher.wait_for('published')
            received = values(bench.records(topic_name, 3000))
            assert received == [b'%d' % number for number in range(3000)]
        with bench.publisher('/orders', '--count', '60000') as publisher:
            eventually(lambda: len(bench.records(topic_name, 4000)) >= 4000, 20)
            bridge.kill()
            # Their lease, not the default of 20 s, says when the reader is given up.
            publisher.wait_for('published', timeout_s=12)
    assert 'does not bound' not in bridge.output()
    assert 'XMLPARSER' not in bridge.output()


def test_a_dds_profile_that_cannot_be_read_is_one_sentence(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    with bench.bridge(file, FASTDDS_DEFAULT_PROFILES_FILE='/missing.xml') as bridge:
        assert bridge.wait() == 2
    [sentence] = lines(bridge.log)
    assert sentence.startswith('/missing.xml: the DDS profile cannot be read: ')
