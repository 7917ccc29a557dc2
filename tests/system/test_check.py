"""`check` as a user meets it, of what is not in the gate."""

from collections.abc import Callable
from pathlib import Path

from support.bridges.routes import to_ros
from support.processes.harness import Bench

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

Unique = Callable[[str], str]


# Here since it was run again once beside two busy loops: `check --connect` had ended with 1. A
# Kafka that had just begun had no coordinator for groups within 5 s: `check` waits for 15 s now.
# What it shows of routes is kept in the gate by tests/unit/ros/test_matching.py.
def test_routes_of_one_file_count_for_each_other(bench: Bench, unique: Unique) -> None:
    orders, returned = unique('orders'), unique('returned')
    bench.create_topic(orders, returned)
    back = {'name': 'back', 'from': {'ros': '/orders'}, 'to': {'kafka': returned}}
    file = bench.config([to_ros(orders, '/orders', name='out'), {**back, 'format': 'text'}])
    status, out, _ = bench.command('check', str(file), '--connect')
    assert status == 0, out
    assert '  ok   1 subscriber of /orders matches, with route back of this file' in out
    assert '  ok   route out of this file publishes /orders' in out
    assert out.splitlines()[-1] == '2 routes would run'


def test_a_kafka_in_which_no_group_works_is_not_taken_for_a_missing_right(
    tmp_path: Path, ros_domain: int, topic_name: str
) -> None:
    """Its topic of offsets is to have three copies, as Kafka's own default is, on one broker."""
    with LocalKafka(properties={'offsets.topic.replication.factor': '3'}) as kafka:
        bench = Bench(tmp_path, kafka.bootstrap_servers, ros_domain)
        bench.create_topic(topic_name)
        file = bench.config([to_ros(topic_name, '/orders', min_subscribers=0)])
        status, out, _ = bench.command('check', str(file), '--connect')
    assert status == 1
    [bad] = [line for line in out.splitlines() if line.startswith('  BAD')]
    assert f'group {bench.group}: its offsets cannot be read' in bad
    assert (
        'where the topic __consumer_offsets is to have more copies than there are brokers' in bad
    )
    assert 'ACL' not in bad
