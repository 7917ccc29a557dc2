"""Members of a group that are closed while a rebalance waits for them.

Called back from inside of the close, it may wait for ever with Python's lock held: each thread of
the bridge would stand still (`kafka.group_client`).
"""

import contextlib
import logging
from collections.abc import Callable
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import Consumer, ConsumerGroupState, KafkaException
from support.patience import patient
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.kafka.properties import consumer_properties

LOG = logging.LoggerAdapter(logging.getLogger('test.closed'), {})


def watched(told: list[str], in_close: list[str]) -> type[Consumer]:
    """A consumer that notes what it is told, and what of that from inside of its close."""

    class Watched(Consumer):
        _closes = False

        def subscribe(self, topics: list[str], *_: Any, **callbacks: Any) -> None:
            def noting(name: str, callback: Callable[..., None]) -> Callable[..., None]:
                def called(*said: Any) -> None:
                    (in_close if self._closes else told).append(name)
                    callback(*said)

                return called

            noted = {name: noting(name, callback) for name, callback in callbacks.items()}
            super().subscribe(topics, **noted)

        def close(self) -> None:
            self._closes = True
            super().close()

    return Watched


def wait_until_assigned(bench: Bench, group: str) -> None:
    """Wait until the only member of a group has its partitions, as far as the group knows."""
    admin = bench.admin()

    def is_assigned() -> bool:
        # A Kafka that has just begun may answer late: then it is asked once more.
        asked = admin.describe_consumer_groups([group], request_timeout=5)
        try:
            found = asked[group].result(patient(30))
        except KafkaException:
            return False
        return found.state is ConsumerGroupState.STABLE and any(
            member.assignment.topic_partitions for member in found.members
        )

    eventually(is_assigned, 60)


def test_a_lock_is_told_of_its_rebalances_before_it_is_closed_and_not_in_the_close(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    in_close: list[str] = []
    monkeypatch.setattr(group_client, 'Consumer', watched(told, in_close))
    with GroupLock({'bootstrap.servers': bench.bootstrap_servers}, bench.name, 'old', LOG) as held:
        held.open()
        wait_until_assigned(bench, held.group)
        assert told == []
    eventually(lambda: told != [], 10)
    assert in_close == []


def test_a_replaced_client_is_told_of_its_rebalances_before_it_is_closed_and_not_in_the_close(
    bench: Bench, topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    in_close: list[str] = []
    monkeypatch.setattr(group_client, 'Consumer', watched(told, in_close))
    kafka = {'bootstrap.servers': bench.bootstrap_servers}
    group = f'{bench.name}.old'
    properties = consumer_properties(kafka, client_id='test', group=group)
    client = GroupClient(properties, topic, MagicMock(), LOG.logger)
    client.open()
    # Freed with a rebalance waiting, it would stand still: it is closed whatever fails.
    with contextlib.ExitStack() as stack:
        stack.callback(client.end, 30.0, leaves=False)
        client.subscribe(*[lambda _: None] * 3)
        wait_until_assigned(bench, group)
        assert told == []
    assert told == ['on_assign']
    assert 'on_assign' not in in_close, 'only what it has is taken from it there'
