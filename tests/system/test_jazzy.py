"""The bridge on the wheels of ROS 2 Jazzy; the nodes around it are on Kilted."""

import os
from pathlib import Path

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.processes.harness import Bench, eventually, headers
from support.processes.terminal import finished

JAZZY = Path(__file__).parents[2] / '.venv-jazzy' / 'bin' / 'python'
COUNT = 5000
LOOK = """\
from ros2_kafka_bridge.ros import installation
from ros2_kafka_bridge.ros.rclpy_api import NeededBy, lacking
print(installation.rclpy_version()[0], [lacking(part) for part in NeededBy])
"""


@pytest.fixture
def jazzy() -> Path:
    assert JAZZY.exists(), 'make test makes .venv-jazzy'
    return JAZZY


def test_jazzy_has_all_that_the_bridge_uses_of_rclpy(jazzy: Path) -> None:
    # The wheels of ROS 2 have set these to their own libraries.
    own = {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '', 'LD_LIBRARY_PATH': ''}
    done = finished([jazzy, '-c', LOOK], env=os.environ | own)
    assert (done.stdout, done.stderr) == ('7 [[], []]\n', '')


def test_orders_through_both_directions_on_jazzy_arrive_once_and_in_order(
    bench: Bench, jazzy: Path, topic: str
) -> None:
    sent = [f'order {number}'.encode() for number in range(COUNT)]
    returned = f'{topic}.returned'
    routes = [to_ros(topic, '/orders'), to_kafka('/orders', returned)]
    with bench.drained(bench.config(routes), python=jazzy) as bridge:
        bench.produce(topic, list(sent))
        records = bench.records(returned, COUNT)
    assert values(records) == sent
    told = headers(records[0])
    assert told['ros.type'] == 'std_msgs/msg/String'
    assert told['ros.type_hash'].startswith('RIHS01_')
    assert 'ros.gid' not in told
    [warning] = [line for line in bridge.output().splitlines() if 'WARNING' in line]
    assert 'ros.gid' in warning
    assert 'guarantee' in warning


def test_a_jazzy_bridge_waits_for_a_slow_subscriber_and_loses_nothing(
    bench: Bench, jazzy: Path, topic_name: str, tmp_path: Path
) -> None:
    sent = [str(number).encode() for number in range(3000)]
    file = tmp_path / 'received'
    bench.produce(topic_name, list(sent))
    with (
        bench.subscriber('/orders', file, '--work', '0.001', samples=10),
        bench.drained(bench.config([to_ros(topic_name, '/orders')]), python=jazzy) as bridge,
    ):
        eventually(lambda: len(lines(file)) >= len(sent), 60, bridge.output)
    assert lines(file) == [value.decode() for value in sent]
