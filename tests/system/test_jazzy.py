"""The bridge on the wheels of ROS 2 Jazzy; the nodes around it are on Kilted."""

from pathlib import Path

import pytest
from harness import Bench, eventually, headers, lines, to_kafka, to_ros, values

JAZZY = Path(__file__).parents[2] / '.venv-jazzy' / 'bin' / 'python'
COUNT = 5000


@pytest.fixture
def jazzy() -> Path:
    assert JAZZY.exists(), 'make test makes .venv-jazzy'
    return JAZZY


def test_orders_through_both_directions_on_jazzy_arrive_once_and_in_order(
    bench: Bench, jazzy: Path, topic_name: str
) -> None:
    sent = [f'order {number}'.encode() for number in range(COUNT)]
    returned = f'{topic_name}.returned'
    routes = [to_ros(topic_name, '/orders'), to_kafka('/orders', returned)]
    bench.create_topic(topic_name)
    with bench.bridge(bench.config(routes), python=jazzy) as bridge:
        bench.produce(topic_name, list(sent))
        records = bench.records(returned, COUNT)
        assert bridge.end() == 0
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
        bench.bridge(bench.config([to_ros(topic_name, '/orders')]), python=jazzy) as bridge,
    ):
        eventually(lambda: len(lines(file)) >= len(sent), 60, bridge.output)
        assert bridge.end() == 0
    assert lines(file) == [value.decode() for value in sent]
