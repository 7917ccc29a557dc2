"""The ways to be a member of a consumer group that a user can choose from, on a real Kafka."""

import contextlib
import logging
from collections.abc import Callable, Mapping

import pytest
from support.kafka.source_stubs import Nobody
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.kafka.properties import Membership, consumer_properties
from ros2_kafka_bridge.kafka.topic_id import TopicIds

LOG = logging.LoggerAdapter(logging.getLogger('test.membership'), {})
PARTITIONS = 4
KIP_848 = {'group.protocol': 'consumer'}
WAYS = [
    pytest.param('static', {}, id='static'),
    pytest.param('dynamic', {}, id='dynamic'),
    pytest.param('static', KIP_848, id='decided by the broker'),
]


@pytest.mark.parametrize(('membership', 'own'), WAYS)
def test_a_bridge_that_stops_leaves_its_partitions_to_the_other_one_long_before_its_session_ends(
    bench: Bench,
    topic_name: str,
    unique: Callable[[str], str],
    membership: Membership,
    own: Mapping[str, str],
) -> None:
    """A broker that decides waits 45 s for a member with a name, also where that has left."""
    bench.create_topic(topic_name, partitions=PARTITIONS)
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    session = {} if own else {'session.timeout.ms': 45_000}
    properties = consumer_properties(
        {**servers, **own, **session}, client_id='test', group=unique('group')
    )
    first, second = (
        KafkaSource(properties, topic_name, 'earliest', TopicIds(servers), LOG, membership)
        for _ in range(2)
    )

    def has(source: KafkaSource, count: int) -> bool:
        for open_one in opened:
            open_one.poll(10, 0.05)
        return len(source._offsets) == count

    opened = [first]
    first.open(Nobody())
    with contextlib.closing(second):
        with contextlib.closing(first):
            eventually(lambda: has(first, PARTITIONS), 30)
            second.open(Nobody())
            opened.append(second)
            eventually(lambda: has(second, PARTITIONS // 2) and has(first, PARTITIONS // 2), 30)
        opened.remove(first)
        eventually(lambda: has(second, PARTITIONS), 20)


@pytest.mark.parametrize(('membership', 'own'), WAYS)
def test_an_exclusive_route_is_run_by_one_and_goes_to_the_other_one_when_that_stops(
    bench: Bench, unique: Callable[[str], str], membership: Membership, own: Mapping[str, str]
) -> None:
    """Its own group has members that agree among themselves in any case."""
    kafka = {'bootstrap.servers': bench.bootstrap_servers, **own}
    name = unique('pair')
    with contextlib.ExitStack() as stack:
        first, second = (
            stack.enter_context(GroupLock(kafka, name, 'orders', LOG, membership))
            for _ in range(2)
        )

        def holds(lock: GroupLock) -> bool:
            for each in (first, second):
                each.poll(0.05)
            return lock.held

        first.open()
        eventually(lambda: holds(first), 60)
        second.open()
        eventually(lambda: holds(first) and second.joined, 60)
        assert first.held
        assert not second.held
        first.close()
        eventually(lambda: holds(second), 60)
