"""ROS -> Kafka while the bridge or the broker is stopped, killed or away.

The guarantees are those of docs: 2 at least once without duplicates, 3 order, 4 full means wait,
6 counters balance, 7 stop is a drain, 8 what SIGKILL can cost.
"""

import itertools
import signal
from pathlib import Path

import pytest
from support.bridges.numbers_to_kafka import LATCHED, knock, last, seqs
from support.bridges.numbers_to_ros import numbered
from support.bridges.routes import to_kafka, totals, values
from support.bridges.window_limits import WINDOW, first_held_back
from support.kafka.relay import node_behind_relay
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave

from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port

RATE = 500


# The bridge ends


def test_sigterm_in_mid_stream_loses_and_doubles_nothing_of_a_history_guarantees_2_3_7(
    bench: Bench, topic: str
) -> None:
    count, leave = 4000, Leave(bench.place)
    config = bench.config([to_kafka('/orders', topic)])
    options = (*LATCHED, *leave.options, '--count', str(count), '--rate', str(RATE))
    with bench.publisher('/orders', *options):
        leave.up_to(300)
        with bench.run(config) as bridge:
            eventually(lambda: bench.reaches(topic, 300), 60, bridge.output)
            leave.set_off(count - 1000)
            assert bridge.end() == 0
        leave.up_to(count)
        with bench.run(config) as bridge:
            records = bench.records(topic, count)
            assert bridge.end() == 0
            assert totals(bridge, 'to_kafka').get('skipped', 0) > 0
    assert values(records) == numbered(count)
    assert seqs(records) == list(range(1, count + 1))


def test_sigkill_costs_a_volatile_publisher_no_more_than_is_said_guarantee_8(
    bench: Bench, topic: str
) -> None:
    alone, count, leave = 2000, 3000, Leave(bench.place)
    config = bench.config([to_kafka('/orders', topic)], ros={'lease_s': 3})
    options = (*leave.options, '--count', str(count), '--rate', str(RATE))
    with bench.bridge(config) as bridge:
        bridge.wait_for('subscribes to /orders')
        with bench.publisher('/orders', *options) as publisher:
            leave.up_to(300)
            eventually(lambda: bench.reaches(topic, 300), 60, bridge.output)
            leave.set_off(alone)
            bridge.kill()
            eventually(lambda: leave.out == alone, 60)
            with bench.drained(config) as again:
                again.wait_for('subscribes to /orders')
                knock(bench, topic, leave)
                back = leave.out
                leave.up_to(count)
                publisher.wait_for('published')
                eventually(lambda: last(bench, topic) == count, 60, again.output)
            records = bench.records(topic, bench.end_offset(topic))
    found = seqs(records)
    assert found == sorted(set(found))
    assert found[-1] == count
    gaps = [(a, b) for a, b in itertools.pairwise(found) if b != a + 1]
    assert len(gaps) == 1, 'what is lost shows as one gap in (gid, seq)'
    [(_, first_after)] = gaps
    assert alone < first_after <= back, 'all is there that was published once it was back'


@pytest.mark.kills_kafka
def test_sigkill_costs_a_publisher_that_is_held_back_its_history_too_guarantee_8(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    bench, count, leave = own_bench, 12_000, Leave(own_bench.place)
    config = bench.config([to_kafka('/orders', own_topic)], ros={'lease_s': 3})
    options = (*leave.options, '--count', str(count))
    with bench.bridge(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(1000)
        eventually(lambda: bench.reaches(own_topic, 1000), 60, bridge.output)
        bench.close()
        own_kafka.kill()
        leave.up_to(1000 + WINDOW)
        held = first_held_back(bridge)
        leave.up_to(held + 1)
        publisher.wait_for(f'held back from {held}\n')
        bridge.kill()
        own_kafka.start()
        # ROS forgets the bridge, and with it what was kept for it.
        eventually(lambda: leave.out == held + 1, 60, publisher.output)
        with bench.drained(config) as again:
            again.wait_for('subscribes to /orders')
            knock(bench, own_topic, leave)
            back = leave.out
            leave.up_to(count)
            eventually(lambda: last(bench, own_topic) == count, 60, again.output)
        records = bench.records(own_topic, bench.end_offset(own_topic))
    found = seqs(records)
    first_after = found[1000]
    assert held + 1 < first_after <= back
    assert found == [*range(1, 1001), *range(first_after, count + 1)]


# The broker ends


def test_drop_oldest_drops_while_the_broker_is_away_and_counts_it_guarantees_3_4_6(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    count = 20_000
    route = to_kafka('/orders', own_topic, when_full='drop_oldest')
    config = own_bench.config([route])
    leave = Leave(own_bench.place)
    options = (*leave.options, '--count', str(count), '--rate', '4000')
    with own_bench.bridge(config) as bridge, own_bench.publisher('/orders', *options) as publisher:
        leave.up_to(500)
        eventually(lambda: own_bench.reaches(own_topic, 500), 60, bridge.output)
        own_bench.close()
        own_kafka.stop()
        leave.up_to(count)
        # Nothing holds it back, though Kafka takes nothing.
        publisher.wait_for('published')
        own_kafka.start()
        eventually(lambda: last(own_bench, own_topic) == count, 60)
        assert bridge.end() == 0
        found = totals(bridge, 'to_kafka')
        records = own_bench.records(own_topic, found['confirmed'])
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
        count, leave = 1000, Leave(tmp_path)
        options = (*leave.options, '--rate', '200', '--count', str(count))
        with bench.bridge(config) as bridge, bench.publisher('/orders', *options):
            leave.up_to(100)
            eventually(lambda: last(bench, topic_name) == 100, 60, bridge.output)
            leave.set_off(count)
            relay.forget()
            eventually(lambda: last(bench, topic_name) == count, 120, bridge.output)
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
        assert stop(bridge) == 1, 'something was given up'
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
            assert stop(bridge) == 0, 'nothing was'
    assert totals(bridge, 'to_kafka')['taken'] == 0


def stop(bridge: Process) -> int:
    """Ctrl-C, while the broker is away: the end comes, without a traceback."""
    bridge.send(signal.SIGINT)
    status = bridge.wait()
    assert 'Traceback' not in bridge.output()
    assert '%3|' not in bridge.output(), 'librdkafka speaks through the log only'
    return status


def test_a_second_signal_ends_at_once_guarantee_7(bench: Bench, topic_name: str) -> None:
    config = away(bench).config([to_kafka('/orders', topic_name)], defaults={'drain_s': 3600})
    with bench.bridge(config) as bridge, bench.publisher('/orders', '--count', '100'):
        bridge.wait_for('Kafka is away')
        bridge.wait_for('subscribes to /orders')
        bridge.send(signal.SIGINT)
        bridge.wait_for('stopping: draining')
        bridge.send(signal.SIGINT)
        bridge.wait()
    assert 'Traceback' not in bridge.output()
