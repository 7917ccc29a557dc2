"""What an exclusive route needs of a closed cluster, and what it says where that is missing."""

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.kafka.secured import PASSWORD, USER, SecuredKafka, group_right, running, topic_right
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.lock import GroupLock

LOG = logging.LoggerAdapter(logging.getLogger('test.exclusive'), {})


@pytest.fixture
def secured(tmp_path: Path) -> Iterator[SecuredKafka]:
    with running(tmp_path) as kafka:
        yield kafka


def test_a_lock_needs_read_on_its_topic_and_group_and_a_topic_that_somebody_makes(
    secured: SecuredKafka, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, secured.node.bootstrap_servers, 0)  # past all permissions
    kafka = {**secured.properties('SCRAM', tmp_path), 'sasl.password': PASSWORD}

    def make() -> GroupLock:
        return GroupLock(kafka, 'pair', 'orders', LOG)

    with make() as refused, pytest.raises(RouteError, match='give this user READ on the topic'):
        refused.open()
    secured.allow(USER, [topic_right('pair.lock', 'READ')])
    command = 'kafka-topics.sh .* --create --topic pair.lock --partitions 1'
    with make() as missing, pytest.raises(RouteError, match=f'is not there, .*: {command}'):
        missing.open()
    bench.create_topic('pair.lock')
    with make() as refused, pytest.raises(RouteError, match='READ on the consumer group'):
        listen(refused)
    secured.allow(USER, [group_right('pair.orders.lock')])
    with make() as first, make() as second:
        listen(first)
        second.open()
        eventually(lambda: hears(first) and hears(second) and first.has_standby(), 60)
        assert (first.held, second.held) == (True, False)


def listen(lock: GroupLock) -> None:
    """Listen until the group has told who holds it."""
    lock.open()
    eventually(lambda: hears(lock), 60)


def hears(lock: GroupLock) -> bool:
    """Listen for a moment; tells whether the group has told who holds it."""
    lock.poll(0.05)
    lock.check()
    return lock.joined
