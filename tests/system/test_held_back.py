"""What Kafka does not give out to a bridge that it answers: a lag, and a reason on the page.

`tests/unit/kafka/test_held_back.py` has how that is found out.
"""

import contextlib
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from confluent_kafka import Producer
from confluent_kafka.admin import NewTopic  # type: ignore[attr-defined]  # not in __all__
from support.bridges.routes import lines, to_ros
from support.monitoring.scrapes import watched
from support.processes.harness import Bench, eventually

from rig.local_cluster import LocalCluster
from ros2_kafka_bridge.testing.kafka_jars import find_jars

RECORD_BYTES = 400_000


def test_an_open_transaction_is_said_and_what_is_behind_it_is_a_lag(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    """Also of a bridge that has begun behind it, and has read nothing yet."""
    topic = unique('orders')
    bench.create_topic(topic)
    bench.produce(topic, [b'before'] * 10)
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    hangs = Producer(servers | {'transactional.id': topic})
    hangs.init_transactions(30)
    with bench.subscriber('/orders', bench.place / 'arrived') as reader:
        reader.wait_for('ready')
        with watched(bench, [to_ros(topic, '/orders')]).process as first:
            eventually(lambda: bench.committed(bench.group, topic) == 10, 60, first.output)
        hangs.begin_transaction()
        for _ in range(100):
            hangs.produce(topic, b'open')
        hangs.flush(30)
        bench.produce(topic, [b'behind'] * 50)
        bridge = watched(bench, [to_ros(topic, '/orders')])
        with bridge.process as process:
            bridge.becomes('livez', 200)

            def route() -> dict[str, Any]:
                return bridge.route('to_ros')

            eventually(lambda: route()['lag'] == 150, 60, process.output)
            text = f'{topic}[0]: waits from offset 10 on for the end of a transaction, seen'
            eventually(lambda: route()['reason'].startswith(text), 60, process.output)
            assert route()['state'] == 'waiting'
            assert bridge.scrape().of('consumer_lag_records', route='to_ros') == 150
            assert bridge.scrape().of('kafka_up', route='to_ros') == 1
            hangs.abort_transaction(30)
            eventually(lambda: route()['lag'] == 0, 60, process.output)
            eventually(lambda: route()['state'] == 'running', 60, process.output)
            assert route()['taken'] == 50
            assert route()['errors'] == {}
            assert bench.committed(bench.group, topic) == bench.end_offset(topic)


def test_a_quota_that_lets_nothing_through_is_said_and_the_lag_is_not_known(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    topic = unique('large')
    bench.create_topic(topic)
    bench.produce(topic, [b'x' * RECORD_BYTES] * 50)
    limit(bench, 20_000)
    bridge = watched(bench, [to_ros(topic, '/large')])
    with bridge.process as process, bench.subscriber('/large', bench.place / 'arrived'):
        bridge.becomes('livez', 200)
        eventually(
            lambda: 'a quota of the broker' in bridge.route('to_ros')['reason'],
            60,
            process.output,
        )
        route = bridge.route('to_ros')
        assert (route['state'], route['lag'], route['taken']) == ('waiting', None, 0)
        assert 'consumer_lag_records{' not in bridge.get('metrics').text
        assert bridge.scrape().of('kafka_up', route='to_ros') == 1


def test_a_partition_whose_leader_is_away_is_said_while_the_others_are_read(
    tmp_path: Path, ros_domain: int
) -> None:
    """Kafka is not away: how far this partition goes is not known, and the rest comes later."""
    with (
        LocalCluster(3) as cluster,
        contextlib.closing(Bench(tmp_path, cluster.bootstrap_servers, ros_domain)) as bench,
    ):
        admin = bench.admin()
        admin.create_topics([NewTopic('orders', 3, 1)])['orders'].result(60)

        def leaders() -> dict[int, int]:
            found = admin.list_topics('orders', timeout=30).topics['orders'].partitions
            return {number: partition.leader for number, partition in found.items()}

        # A broker hears a moment later of what another one has created.
        eventually(lambda: sorted(leaders()) == [0, 1, 2], 30)
        bridge = watched(bench, [to_ros('orders', '/orders')])
        arrived = bench.place / 'arrived'
        with bridge.process as process, bench.subscriber('/orders', arrived) as reader:
            reader.wait_for('ready')
            bridge.becomes('livez', 200)

            def route() -> dict[str, Any]:
                return bridge.route('to_ros')

            def send(*partitions: int) -> None:
                for partition in partitions:
                    bench.produce('orders', [b'%d' % partition] * 5, partition=partition)

            send(0, 1, 2)
            eventually(
                lambda: (route()['ended']['confirmed'], route()['lag']) == (15, 0),
                60,
                process.output,
            )
            led = leaders()
            away = led[0]
            others = [number for number, leader in led.items() if leader != away]
            assert others, 'each partition has a leader of its own'
            cluster.kill(away)
            text = 'orders[0]: the broker that leads it does not answer, since '
            eventually(lambda: route()['reason'].startswith(text), 90, process.output)
            assert (route()['state'], route()['lag']) == ('waiting', None)
            send(*others)
            count = 15 + 5 * len(others)
            eventually(lambda: len(lines(arrived)) == count, 60, process.output)
            cluster.start(away)
            eventually(
                lambda: (route()['state'], route()['lag']) == ('running', 0), 90, process.output
            )
            send(0)
            eventually(lambda: len(lines(arrived)) == count + 5, 60, process.output)


def limit(bench: Bench, bytes_per_s: int) -> None:
    """Give the clients of a bench a quota, with Kafka's own tool."""
    jars = find_jars()
    assert jars is not None
    command = [
        'java', '-cp', f'{jars}/*', 'kafka.admin.ConfigCommand', '--alter',
        '--bootstrap-server', bench.bootstrap_servers,
        '--add-config', f'consumer_byte_rate={bytes_per_s}',
        '--entity-type', 'clients', '--entity-name', f'{bench.name}-worker-1',
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=60)
