"""How the parts of the warehouse are put together."""

import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from support.processes.harness import eventually
from support.processes.terminal import finished

import ros2_kafka_warehouse
from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.faults import CODES
from ros2_kafka_warehouse.domain.site import DEFAULT_SITE, make_site, read_site
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import Line, OrderRequest
from ros2_kafka_warehouse.nodes import MODULES
from ros2_kafka_warehouse.page.failures import FAILURES
from ros2_kafka_warehouse.run import programs_of, write_site
from ros2_kafka_warehouse.run_options import Options, site_of
from ros2_kafka_warehouse.send import RequestError, read_requests
from ros2_kafka_warehouse.topics import BRIDGE, KAFKA, TOPICS

BRIDGE_FILE = Path(ros2_kafka_warehouse.__file__).parent / 'data' / 'bridge.yaml'


def test_the_bridge_joins_the_topics_that_belong_together() -> None:
    routes = YAML(typ='safe').load(BRIDGE_FILE)['routes']
    joined = {
        (r['from']['kafka'], r['to']['ros'], True)
        if 'kafka' in r['from']
        else (r['to']['kafka'], r['from']['ros'], False)
        for r in routes
    }
    assert joined == {(topic.name, topic.ros, topic.to_ros) for topic in KAFKA}


def test_the_bridge_drops_nothing_but_old_snapshots() -> None:
    routes = YAML(typ='safe').load(BRIDGE_FILE)['routes']
    snapshots = {topic.ros for topic in KAFKA if topic.compacted}
    assert {r['from']['ros'] for r in routes if r.get('when_full') == 'drop_oldest'} == snapshots
    latched = {topic.name for topic in TOPICS if topic.latched}
    assert snapshots <= latched


def test_every_module_that_a_topic_names_has_a_file_of_its_name() -> None:
    named = {name for topic in TOPICS for name in (*topic.publishers, *topic.subscribers)}
    assert named - {BRIDGE} == set(MODULES)
    assert all(find_spec(f'ros2_kafka_warehouse.nodes.{name}') for name in MODULES)


def test_the_command_line_starts_without_ros_kafka_or_numbers() -> None:
    code = 'import sys, ros2_kafka_warehouse.cli; print(*sys.modules)'
    loaded = subprocess.run([sys.executable, '-c', code], capture_output=True, check=True)
    heavy = {b'rclpy', b'confluent_kafka', b'numpy', b'scipy', b'starlette', b'rich'}
    assert not heavy & set(loaded.stdout.split())


def test_a_site_for_so_many_robots_reaches_the_modules_as_a_file(tmp_path: Path) -> None:
    site = site_of(Options(robots=7, step_s=0.1))
    assert len(site.robots) == 7
    assert read_site(write_site(site, tmp_path)) == site


def test_fewer_robots_of_a_site_of_ones_own(tmp_path: Path) -> None:
    own = write_site(make_site(5), tmp_path)
    assert len(site_of(Options(site=own, robots=3)).robots) == 3


def test_what_is_asked_of_the_page_and_of_the_robots_reaches_them(tmp_path: Path) -> None:
    options = Options(allow_hosts=('depot.example',), faults=('carrier-01:STALLED@5',))
    commands = {it.name: it.command for it in programs_of(options, tmp_path / 'site.yaml', 'k:1')}
    assert '--allow-host=depot.example' in commands['page']
    assert '--fail=carrier-01:STALLED@5' in commands['robots']


def test_a_failure_comes_at_the_step_that_was_asked_for(tmp_path: Path) -> None:
    trace = tmp_path / 'trace.jsonl'
    fault = ('--fail=carrier-02:MOTION_FAULT@7', f'--trace={trace}', '--steps=12')
    command = [sys.executable, '-m', 'ros2_kafka_warehouse', 'simulate', *fault]
    subprocess.run(command, check=True, capture_output=True)
    steps = trace.read_text().splitlines()
    assert next(number for number, line in enumerate(steps, 1) if 'motionFault' in line) == 7


def test_the_page_offers_the_failures_that_robots_know() -> None:
    assert FAILURES.keys() == set(CODES)


def test_a_command_that_has_waited_for_over_a_minute_is_old() -> None:
    command = OperatorCommand('c', 'pause', time_s=1000.0)
    assert not decode(encode(command), OperatorCommand).is_old(1060.0)
    assert decode(encode(command), OperatorCommand).is_old(1060.1)
    assert not OperatorCommand('c', 'pause').is_old(1e9)  # who does not say when means now


def test_a_command_that_kafka_does_not_take_is_said() -> None:
    command = ['command', 'pause', '--bootstrap-servers=127.0.0.1:1']
    done = finished([sys.executable, '-m', 'ros2_kafka_warehouse', *command])
    assert done.returncode == 2
    assert '127.0.0.1:1 has not taken all records' in done.stderr


def test_orders_are_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'orders.jsonl'
    file.write_text(
        '{"orderId": "A", "station": "s", "lines": [{"lineId": "1", "product": "p"}]}\n\n'
    )
    assert list(read_requests(file)) == [OrderRequest('A', 0, 's', (Line('1', 'p'),))]


def test_a_line_that_is_no_order_is_named(tmp_path: Path) -> None:
    file = tmp_path / 'orders.jsonl'
    file.write_text('{"orderId": "A"}\n{"orderId": 7}\n')
    with pytest.raises(RequestError, match=r'orders\.jsonl, line 2: .*orderId'):
        list(read_requests(file))


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['module', 'monitors'], 'no module monitors: there are execution_profiles'),
        (['send'], 'name a file of orders, or --random N'),
        (['send', 'nowhere.jsonl'], 'nowhere.jsonl: cannot be read'),
        (['command', 'explode'], 'no command explode: there are failRobot'),
        (['command', 'failRobot', '--robot=r'], 'failRobot needs --robot and --failure'),
        (['run', '--site=nowhere.yaml'], 'nowhere.yaml'),
        (['run', '--port=99999'], 'less than or equal to 65535'),
        (['run', '--logs=/proc/foo'], 'ros2-kafka-warehouse: /proc/foo: '),
        (['run', f'--site={DEFAULT_SITE}', '--robots=13'], 'site.yaml: has 12 robots, not 13'),
        (['run', '--profiles=nowhere.yaml'], 'nowhere.yaml: cannot be read'),
        (['run', '--host=no such host'], '--host no such host: '),
        (['run', '--step-s=nan'], 'Input should be less than'),
        (['simulate', '--orders-per-hour=inf', '--steps=5'], 'Input should be less than'),
        (['simulate', '--failures-per-hour=nan', '--steps=5'], 'Input should be less than'),
        (['simulate', '--robots=3', '--site=missing.yaml'], 'missing.yaml: cannot be read'),
        (['run', '--fail=carrier-1'], 'write a fault as ROBOT:CODE@STEP'),
        (['simulate', '--fail=nobody:STALLED@5'], 'no robot nobody'),
        (['simulate', '--steps=1', '--trace=nowhere/t.jsonl'], 'nowhere/t.jsonl: No such file'),
        (['command', 'failRobot', '--robot=r', '--failure=STALED'], 'did you mean STALLED?'),
        (
            ['command', 'repairRobot', '--robot=carrier-99', f'--site={DEFAULT_SITE}'],
            'no robot carrier-99',
        ),
        (['command', 'blockCell', '--cell', '900', '0', f'--site={DEFAULT_SITE}'], 'no cell 900'),
    ],
)
@pytest.mark.usefixtures('ros_domain')
def test_a_mistake_of_the_user_is_said_without_a_traceback(
    arguments: list[str], said: str
) -> None:
    done = finished([sys.executable, '-m', 'ros2_kafka_warehouse', *arguments])
    assert done.returncode == 2
    assert said in done.stderr
    assert 'Traceback' not in done.stderr


def test_a_domain_that_is_no_number_is_said() -> None:
    done = finished(
        [sys.executable, '-m', 'ros2_kafka_warehouse', 'run', '--port=0'],
        env={**os.environ, 'ROS_DOMAIN_ID': 'lab'},
    )
    assert done.returncode == 2
    assert "ROS_DOMAIN_ID is 'lab': a number is needed" in done.stderr


def test_the_type_of_a_robot_that_nobody_knows_is_said_by_the_simulation(tmp_path: Path) -> None:
    own = write_site(make_site(3), tmp_path)
    own.write_text(own.read_text().replace('type: hauler', 'type: hauller'))
    done = finished(
        [sys.executable, '-m', 'ros2_kafka_warehouse', 'simulate', f'--site={own}', '--steps=1']
    )
    assert done.returncode == 2
    assert f'{own}: robots.hauler-03.type: ' in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize('wait_s', [0.03, 0.1, 0.2])
def test_ctrl_c_in_the_middle_of_the_start_is_quiet(wait_s: float) -> None:
    with subprocess.Popen(
        [sys.executable, '-m', 'ros2_kafka_warehouse', 'simulate'],
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        # From its first line of Python on: before, Python itself says what it was about to do.
        eventually(lambda: 'site-packages' in Path(f'/proc/{process.pid}/maps').read_text(), 10)
        time.sleep(wait_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    assert 'Traceback' not in said
