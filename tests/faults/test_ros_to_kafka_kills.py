"""ROS -> Kafka while the bridge or the broker is stopped, killed or away.

The guarantees are those of docs: 2 at least once without duplicates, 3 order, 4 full means wait,
6 counters balance, 7 stop is a drain, 8 what SIGKILL can cost.
"""

import itertools
import re
import signal
import time
from pathlib import Path

from harness import Bench, Process, eventually, to_kafka, totals, values, within
from numbers_to_kafka import LATCHED, how_many, last, published, seqs
from numbers_to_ros import numbered
from relay import node_behind_relay

from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port

READER_CACHE = 2000
WINDOW = 2000
RATE = 500


# The bridge ends


def test_sigterm_in_mid_stream_loses_and_doubles_nothing_of_a_history_guarantees_2_3_7(
    bench: Bench, topic_name: str
) -> None:
    bench.create_topic(topic_name)
    config = bench.config([to_kafka('/orders', topic_name)])
    options = (*LATCHED, '--count', '4000', '--rate', str(RATE))
    with bench.publisher('/orders', *options) as publisher:
        with bench.run(config) as bridge:
            eventually(lambda: last(bench, topic_name) >= 300, 60)
            assert not published(publisher)
            assert bridge.end() == 0
            assert totals(bridge, 'to_kafka')['confirmed'] < 4000
        with bench.run(config) as bridge:
            records = bench.records(topic_name, 4000)
            assert bridge.end() == 0
            assert totals(bridge, 'to_kafka').get('skipped', 0) > 0
    assert values(records) == numbered(4000)
    assert seqs(records) == list(range(1, 4001))


def test_sigkill_costs_a_volatile_publisher_no_more_than_is_said_guarantee_8(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)], ros={'lease_s': 8})
    bench.create_topic(topic_name)
    enough = bench.place / 'enough'
    options = ('--until', str(enough), '--rate', str(RATE))
    with bench.bridge(config) as bridge:
        bridge.wait_for('subscribes to /orders')
        with bench.publisher('/orders', *options) as publisher:
            eventually(lambda: last(bench, topic_name) >= 300, 60)
            killed_s = time.monotonic()
            bridge.kill()
            time.sleep(3.0)  # what it had sent, until the broker has it
            before = last(bench, topic_name)
            with bench.bridge(config) as again:
                again.wait_for('subscribes to /orders')
                eventually(lambda: last(bench, topic_name) > before, 60)
                back_s = time.monotonic()
                enough.touch()
                count = how_many(publisher)
                eventually(lambda: last(bench, topic_name) == count, 60)
                assert again.end() == 0
                records = bench.records(topic_name, bench.end_offset(topic_name))
    found = seqs(records)
    assert found == sorted(set(found))
    assert found[-1] == count
    gaps = [(a, b) for a, b in itertools.pairwise(found) if b != a + 1]
    assert len(gaps) == 1, 'what is lost shows as one gap in (gid, seq)'
    [(last_before, first_after)] = gaps
    assert last_before == before
    assert first_after - last_before - 1 <= READER_CACHE + WINDOW + (back_s - killed_s) * RATE


# The broker ends


def test_a_broker_that_is_away_holds_the_publisher_back_and_costs_nothing_guarantees_2_3_4(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str
) -> None:
    count = 30_000
    config = own_bench.config([to_kafka('/orders', topic_name)])
    own_bench.create_topic(topic_name)
    options = ('--count', str(count), '--rate', '2000')
    with own_bench.bridge(config) as bridge, own_bench.publisher('/orders', *options) as publisher:
        eventually(lambda: last(own_bench, topic_name) >= 1000, 60)
        own_kafka.stop()
        time.sleep(15)
        # Window, reader's cache and the publisher's own history are full; it waits since then.
        assert not published(publisher)
        status = re.findall(
            r'waiting \((.*?)\): (\d+) confirmed.* (\d+) in flight', bridge.output()
        )
        assert status, bridge.output()
        assert status[-1][0].startswith('Kafka is away')
        assert int(status[-1][2]) == WINDOW
        own_kafka.start()
        within(lambda: 'Kafka is back' in bridge.output(), 5, bridge.output)
        publisher.wait_for('published', timeout_s=60)
        records = own_bench.records(topic_name, count)
        assert bridge.end() == 0
    assert totals(bridge, 'to_kafka')['confirmed'] == count
    assert values(records) == numbered(count)
    assert seqs(records) == list(range(1, count + 1))


def test_drop_oldest_drops_while_the_broker_is_away_and_counts_it_guarantees_3_4_6(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str
) -> None:
    count = 20_000
    route = to_kafka('/orders', topic_name, when_full='drop_oldest')
    config = own_bench.config([route])
    own_bench.create_topic(topic_name)
    options = ('--count', str(count), '--rate', '4000')
    with own_bench.bridge(config) as bridge, own_bench.publisher('/orders', *options) as publisher:
        eventually(lambda: last(own_bench, topic_name) >= 500, 60)
        own_kafka.stop()
        # Nothing holds it back, though Kafka takes nothing.
        publisher.wait_for('published', timeout_s=30)
        own_kafka.start()
        eventually(lambda: last(own_bench, topic_name) == count, 60)
        assert bridge.end() == 0
        found = totals(bridge, 'to_kafka')
        records = own_bench.records(topic_name, found['confirmed'])
    assert found['taken'] == count
    assert found['dropped'] > 0
    assert found['confirmed'] + found['dropped'] == count
    arrived = seqs(records)
    assert len(arrived) == found['confirmed']
    assert arrived == sorted(set(arrived))
    newest = list(range(count - WINDOW + 1, count + 1))
    assert arrived[-WINDOW:] == newest, 'the oldest were dropped'


def test_connections_that_were_forgotten_on_the_way_cost_nothing_guarantees_2_3(
    tmp_path: Path, ros_domain: int, topic_name: str
) -> None:
    """As a firewall forgets them: neither side is told."""
    with node_behind_relay(tmp_path / 'node') as (_, relay):
        bench = Bench(tmp_path, relay.address, ros_domain)
        config = bench.config([to_kafka('/orders', topic_name)])
        bench.create_topic(topic_name)
        enough = tmp_path / 'enough'
        options = ('--rate', '100', '--until', str(enough))
        with bench.bridge(config) as bridge, bench.publisher('/orders', *options) as publisher:
            eventually(lambda: last(bench, topic_name) >= 100, 60)
            relay.forget()
            reached = last(bench, topic_name)
            eventually(lambda: last(bench, topic_name) > reached + 100, 120, bridge.output)
            enough.touch()
            count = how_many(publisher)
            assert bridge.end() == 0, bridge.output()
            assert totals(bridge, 'to_kafka')['confirmed'] == count
        records = bench.records(topic_name, bench.end_offset(topic_name))
    assert seqs(records) == list(range(1, count + 1))


def away(bench: Bench) -> Bench:
    """The same with a broker that does not listen."""
    bench.bootstrap_servers = f'127.0.0.1:{free_port()}'
    return bench


def test_a_broker_that_never_listened_is_named_in_one_line_guarantees_4_7(
    bench: Bench, topic_name: str
) -> None:
    config = away(bench).config([to_kafka('/orders', topic_name)], defaults={'drain_s': 1})
    with bench.bridge(config) as bridge, bench.publisher('/orders', '--count', '100') as publisher:
        publisher.wait_for('published')
        bridge.wait_for('starting (Kafka is away')
        assert stop(bridge, within_s=1 + 5) == 1, 'something was given up'
        assert bridge.output().count('trying again until it is back') == 1
    found = totals(bridge, 'to_kafka')
    assert found['taken'] == found['given up'] == 100


def test_what_was_produced_cannot_be_asked_of_a_broker_that_is_away_guarantees_7_8(
    bench: Bench, topic_name: str
) -> None:
    config = away(bench).config([to_kafka('/orders', topic_name)], defaults={'drain_s': 1})
    with bench.publisher('/orders', *LATCHED, '--count', '100') as publisher:
        publisher.wait_for('published')
        with bench.bridge(config) as bridge:
            bridge.wait_for(
                f'topic {topic_name} cannot be read, to skip what it holds from before'
            )
            assert stop(bridge, within_s=1 + 6) == 0, 'nothing was'
    assert totals(bridge, 'to_kafka')['taken'] == 0


def stop(bridge: Process, within_s: float) -> int:
    """Ctrl-C, while the broker is away: the end comes in time, without a traceback."""
    bridge.send(signal.SIGINT)
    within(lambda: not bridge.running, within_s, bridge.output)
    status = bridge.wait()
    assert 'Traceback' not in bridge.output()
    assert '%3|' not in bridge.output(), 'librdkafka speaks through the log only'
    return status


def test_a_second_signal_ends_at_once_guarantee_7(bench: Bench, topic_name: str) -> None:
    config = away(bench).config([to_kafka('/orders', topic_name)], defaults={'drain_s': 60})
    with bench.bridge(config) as bridge, bench.publisher('/orders', '--count', '100'):
        bridge.wait_for('Kafka is away')
        bridge.wait_for('subscribes to /orders')
        bridge.send(signal.SIGINT)
        bridge.wait_for('stopping: draining')
        bridge.send(signal.SIGINT)
        bridge.wait(timeout_s=20)
    assert 'Traceback' not in bridge.output()
