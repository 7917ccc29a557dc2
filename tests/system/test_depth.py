"""`depth` on a real Kafka topic, on a live ROS topic, and with a reader that records itself."""

import json
import signal
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Producer
from support.bridges.numbers_to_kafka import how_many
from support.processes.harness import Bench, Process

from ros2_kafka_bridge.testing.local_kafka import free_port

EXAMPLE = Path(__file__).parents[2] / 'examples' / 'timed_orders.py'
# A moment ago: a broker deletes at once what is older than its retention.
SINCE_MS = int(time.time() * 1000) - 60_000

Unique = Callable[[str], str]


def produce(bench: Bench, topic: str, times_ms: Iterable[int], partition: int = 0) -> None:
    """Records of these times."""
    producer = Producer({'bootstrap.servers': bench.bootstrap_servers, 'linger.ms': 50})
    for time_ms in times_ms:
        producer.produce(topic, b'order', partition=partition, timestamp=SINCE_MS + time_ms)
        producer.poll(0)
    assert producer.flush(30) == 0


def depth(bench: Bench, *arguments: str) -> tuple[int, dict[str, Any], str]:
    """Status, answer and standard error."""
    status, out, err = bench.command('depth', *arguments, '--json', timeout_s=90)
    return status, json.loads(out or '{}'), err


def of_kafka(bench: Bench, topic: str) -> list[str]:
    return ['--kafka', topic, '--bootstrap-servers', bench.bootstrap_servers]


def test_the_records_of_a_topic_are_its_arrivals(bench: Bench, topic: str) -> None:
    # Ten in one millisecond, ten times a second: a burst of ten.
    produce(bench, topic, (n // 10 * 100 for n in range(3000)))
    status, found, err = depth(
        bench, *of_kafka(bench, topic), '--service', '1ms', '--loss', '0.01'
    )
    assert (status, err) == (0, '')
    assert found['arrivals'] == f'Kafka topic {topic}'
    assert found['load']['messages'] == 3000
    assert found['load']['seconds'] == pytest.approx(29.9)
    assert found['load']['peak'] == 8  # of ten one is served, and the tenth finds eight waiting
    assert found['recommended'] in {9, 10, 11}
    assert 'records of one millisecond are taken for a burst' in found['notes'][0]
    # It reads as nobody: no group was made, nothing is committed.
    admin = bench.admin()  # held: of one that is collected, the answer never comes
    groups = admin.list_consumer_groups(request_timeout=10).result().valid
    assert 'depth' not in {group.group_id for group in groups or []}


def test_partitions_are_one_stream_or_taken_alone(bench: Bench, topic_name: str) -> None:
    bench.create_topic(topic_name, partitions=2)
    produce(bench, topic_name, range(0, 4000, 2), partition=0)
    produce(bench, topic_name, range(1, 2001, 4), partition=1)
    service = ['--service', '0.1ms']
    _, both, _ = depth(bench, *of_kafka(bench, topic_name), *service)
    assert both['load']['messages'] == 2500
    assert '2 partitions are taken together' in ' '.join(both['notes'])
    _, one, _ = depth(bench, *of_kafka(bench, topic_name), *service, '--partition', '1')
    assert one['load']['messages'] == 500
    _, last, _ = depth(
        bench, *of_kafka(bench, topic_name), *service, '--partition', '0', '--last', '100'
    )
    assert last['load']['messages'] == 100
    assert last['load']['seconds'] == pytest.approx(0.198)
    # The last thousand records of each: only the time over which both were read counts.
    _, common, _ = depth(bench, *of_kafka(bench, topic_name), *service, '--last', '1000')
    assert common['load']['messages'] == 1000
    assert common['load']['rate'] == pytest.approx(500, rel=0.01)


def test_timestamps_out_of_order_are_sorted_and_said(bench: Bench, topic: str) -> None:
    produce(bench, topic, [30, 10, 20, 40])
    _, found, _ = depth(bench, *of_kafka(bench, topic), '--service', '1ms')
    assert found['load']['seconds'] == pytest.approx(0.03)
    assert 'timestamps were not in order, and are sorted' in found['notes']


def test_times_of_the_broker_are_told_from_those_of_the_producer(
    bench: Bench, topic_name: str
) -> None:
    bench.create_topic(topic_name, message_timestamp_type='LogAppendTime')
    for _ in range(20):  # a batch each, and a time each
        produce(bench, topic_name, range(5))
    _, found, _ = depth(bench, *of_kafka(bench, topic_name), '--service', '1ms')
    assert 'LogAppendTime' in ' '.join(found['notes'])


def test_the_brokers_may_come_from_a_configuration(bench: Bench, topic: str) -> None:
    produce(bench, topic, range(0, 2000, 2))
    route = {
        'name': 'orders',
        'from': {'kafka': topic},
        'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
        'format': 'text',
    }
    config = bench.config([route])
    status, found, err = depth(
        bench, '--kafka', topic, '--config', str(config), '--service', '0.1ms',
        '--loss', '0.01', '-X', 'client.id=asker',
    )  # fmt: skip
    assert (status, err) == (0, '')
    assert found['load']['messages'] == 1000


def test_a_topic_without_records_or_that_is_not_there_is_a_sentence(
    bench: Bench, topic: str, unique: Unique
) -> None:
    service = ['--service', '1ms']
    status, _, err = depth(bench, *of_kafka(bench, topic), *service)
    assert status == 2
    assert f'Kafka topic {topic}: 0 messages, of which no depth can be told' in err
    missing = unique('missing')
    status, _, err = depth(bench, *of_kafka(bench, missing), *service)
    assert status == 2
    assert missing in err
    assert 'Unknown topic' in err
    status, _, err = depth(bench, *of_kafka(bench, topic), *service, '--partition', '3')
    assert status == 2
    assert f'topic {topic} has no partition 3, only 0 to 0' in err


def test_a_broker_that_is_away_is_a_sentence(bench: Bench) -> None:
    servers = f'localhost:{free_port()}'
    status, _, err = depth(
        bench, '--kafka', 'orders', '--bootstrap-servers', servers, '--service', '1ms'
    )
    assert status == 2
    assert 'orders' in err
    assert 'Traceback' not in err


def test_a_live_topic_is_listened_to(bench: Bench) -> None:
    enough = bench.place / 'enough'
    with bench.publisher('/orders', '--until', str(enough), '--rate', '400') as publisher:
        status, found, err = depth(
            bench, '--ros', '/orders', '--seconds', '4', '--service', '0.2ms', '--loss', '0.1'
        )
        assert publisher.running
        enough.touch()
        published = how_many(publisher)
    assert (status, err) == (0, '')
    assert found['arrivals'] == 'ROS topic /orders'
    load = found['load']
    assert 1 < load['messages'] <= published
    assert load['rate'] == pytest.approx((load['messages'] - 1) / load['seconds'])


def test_what_was_published_before_the_listening_does_not_count(bench: Bench) -> None:
    latched = ['--durability', 'transient_local', '--readers', '0']
    with bench.publisher('/orders', '--count', '50', *latched) as publisher:
        publisher.wait_for('published')
        status, _, err = depth(bench, '--ros', '/orders', '--seconds', '1', '--service', '1ms')
    assert status == 2
    assert 'ROS topic /orders: 0 messages' in err


def test_a_live_topic_that_nobody_publishes_is_a_sentence(bench: Bench) -> None:
    status, _, err = depth(bench, '--ros', '/nobody', '--service', '1ms')
    assert status == 2
    assert 'nobody is seen to publish /nobody' in err
    assert 'is it the domain of the nodes' in err


def test_a_reader_that_records_itself_learns_its_depth(bench: Bench) -> None:
    file, log = bench.place / 'orders.times', bench.place / 'reader.log'
    command = [sys.executable, str(EXAMPLE), '--file', str(file), '--work', '0.004']
    with (
        Process([*command, '--depth', '500'], log, bench.environ) as reader,
        bench.publisher('/orders', '--count', '750', '--rate', '125') as publisher,
    ):
        reader.wait_for('ready')
        publisher.wait_for('published 750', timeout_s=60)
        reader.send(signal.SIGINT)
        assert reader.wait(60) == 0
        reader.wait_for(f'recorded {file}')
    status, found, err = depth(bench, '--recording', str(file), '--loss', '0.05')
    assert err == ''
    assert status in {0, 1}  # a busy machine may make the reader too slow
    load = found['load']
    assert 1 < load['messages'] <= 750
    assert load['utilisation'] > 0.99 * 0.004 * load['rate'], 'each takes 4 ms or more'
    traffic, service = str(file), str(file)
    _, parted, _ = depth(bench, '--arrivals', traffic, '--service-file', service, '--loss', '0.05')
    assert parted['predictions'] == found['predictions']
