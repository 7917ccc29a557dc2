"""ROS -> Kafka into several partitions by a key, while the bridge or the broker is killed.

The guarantees are those of docs: 2 at least once without duplicates, 3 order per partition, here
per key, 8 what SIGKILL can cost. One partition: tests/faults/test_ros_to_kafka_kills.py.
"""

import itertools
import json
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from confluent_kafka import Message
from support.bridges.numbers_to_kafka import LATCHED, published
from support.bridges.routes import totals
from support.formats.messages import cdr
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave
from support.ros.raw import publish

from rig.topics import records
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

HEADER = 'std_msgs/msg/Header'
PARTITIONS = 4
ROBOTS = tuple(f'robot-{number}' for number in range(9))
WINDOW = 300
CACHE = 300


def route(topic: str) -> dict[str, Any]:
    """A route that has what one robot says in one partition."""
    return {
        'name': 'to_kafka',
        'from': {'ros': '/robots', 'type': HEADER, 'max_samples': CACHE},
        'to': {'kafka': topic, 'key': '{message.frame_id}'},
        'format': 'json',
        'max_in_flight': WINDOW,
    }


def robot_of(seq: int) -> str:
    """Whose message a publisher's message of that number, from 1, is."""
    return ROBOTS[seq % len(ROBOTS)]


def said(bench: Bench, count: int, *options: str) -> Process:
    """Start a node that publishes what the robots say in turn; each says its number."""
    seqs = range(1, count + 1)
    messages = [cdr(HEADER, stamp=Time(sec=seq), frame_id=robot_of(seq)) for seq in seqs]
    return publish(bench, '/robots', messages, *options, message_type=HEADER)


def arrived(bench: Bench, topic: str) -> int:
    """How many records all partitions hold just now."""
    return sum(bench.end_offset(topic, partition) for partition in range(PARTITIONS))


def seqs(bench: Bench, topic: str) -> set[int]:
    """The numbers, at the publisher, of all that is there just now."""
    there = records(bench.bootstrap_servers, topic, PARTITIONS)
    return {int(headers(record)['ros.seq']) for record in there}


def by_key(all_of: Sequence[Message]) -> dict[str, list[int]]:
    """The numbers behind each key, in the order of its partition, which is one and the same.

    Each record says what was said: its number is that of the message at the publisher.
    """
    found, partitions = defaultdict(list), defaultdict(set)
    for record in all_of:
        key, value = (record.key() or b'').decode(), json.loads(record.value() or b'')
        seq = int(headers(record)['ros.seq'])
        assert value == {'stamp': {'sec': seq, 'nanosec': 0}, 'frame_id': robot_of(seq)}
        assert key == robot_of(seq)
        found[key].append(seq)
        partitions[key].add(record.partition())
    assert {len(one) for one in partitions.values()} == {1}, 'a key stays in its partition'
    assert set.union(*partitions.values()) == set(range(PARTITIONS)), 'all of them are used'
    return found


def each_once(count: int) -> dict[str, list[int]]:
    """What `by_key` finds where nothing is lost, repeated or out of order."""
    whole = defaultdict(list)
    for seq in range(1, count + 1):
        whole[robot_of(seq)].append(seq)
    return whole


def test_a_latched_publisher_repeats_nothing_over_partitions_and_kills_guarantees_2_3_8(
    bench: Bench, topic_name: str, leave: Leave
) -> None:
    """Each start reads the end of every partition, and skips what is there."""
    count = 4000
    config = bench.config([route(topic_name)], ros={'lease_s': 3})
    bench.create_topic(topic_name, partitions=PARTITIONS)
    with said(bench, count, *LATCHED, *leave.options) as publisher:
        for held in (1500, 3000):
            leave.up_to(held)
            with bench.bridge(config) as bridge:
                eventually(lambda: arrived(bench, topic_name) >= held - 1000, 60, bridge.output)  # noqa: B023 (called here)
                bridge.kill()
            assert not published(publisher)
        leave.up_to(count)
        with bench.drained(config) as bridge:
            found = by_key(bench.records(topic_name, count))
        assert totals(bridge, 'to_kafka')['skipped'] >= 2000, 'what the killed ones had sent'
    assert found == each_once(count)


@pytest.mark.kills_kafka
def test_a_killed_broker_loses_repeats_and_reorders_nothing_of_any_key_guarantees_2_3_4(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, leave: Leave
) -> None:
    bench, count = own_bench, 4000
    config = bench.config([route(topic_name)])
    bench.create_topic(topic_name, partitions=PARTITIONS)
    with bench.drained(config) as bridge, said(bench, count, *leave.options) as publisher:
        for held in (1000, 2000):
            leave.up_to(held)
            eventually(lambda: arrived(bench, topic_name) >= held - 700, 60, bridge.output)  # noqa: B023 (called here)
            bench.close()
            own_kafka.kill()
            leave.up_to(held + 500)
            bridge.wait_for('Kafka is away', count=held // 1000)
            assert not published(publisher)
            own_kafka.start()
            bridge.wait_for('Kafka is back', count=held // 1000)
        leave.up_to(count)
        found = by_key(bench.records(topic_name, count))
    assert totals(bridge, 'to_kafka')['confirmed'] == count
    assert found == each_once(count)


def test_sigkill_costs_a_volatile_publisher_what_was_in_flight_of_each_key_guarantees_3_8(
    bench: Bench, topic_name: str, leave: Leave
) -> None:
    """Nothing that was in Kafka before, nothing once the next bridge has its match."""
    before, held, count = 1000, 1000 + WINDOW + CACHE, 4000
    config = bench.config([route(topic_name)], ros={'lease_s': 3})
    bench.create_topic(topic_name, partitions=PARTITIONS)
    with said(bench, count, *leave.options) as publisher:
        with bench.bridge(config) as bridge:
            leave.up_to(before)
            eventually(lambda: arrived(bench, topic_name) == before, 60, bridge.output)
            leave.up_to(held)
            eventually(lambda: arrived(bench, topic_name) > before, 60, bridge.output)
            bridge.kill()
        assert not published(publisher)
        with bench.drained(config) as bridge:
            bridge.wait_for('subscribes to /robots')
            sent, reached = itertools.count(held + 1), arrived(bench, topic_name)

            def matched() -> bool:
                leave.up_to(next(sent))  # one more for each look: who is matched gets it
                return arrived(bench, topic_name) > reached

            eventually(matched, 60, bridge.output)
            leave.up_to(count)
            eventually(lambda: count in seqs(bench, topic_name), 60, bridge.output)
    found = by_key(bench.records(topic_name, arrived(bench, topic_name)))
    assert all(of_one == sorted(set(of_one)) for of_one in found.values())
    lost = set(range(1, count + 1)).difference(*found.values())
    assert lost.isdisjoint(range(1, before + 1)), 'what was in Kafka stays there'
    assert lost.isdisjoint(range(next(sent), count + 1)), 'what came after the match'
