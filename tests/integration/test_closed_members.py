"""Members of a group that are closed while a rebalance waits for them.

Called back from inside of the close, it may wait for ever with Python's lock held: each thread of
the bridge would stand still (`kafka.draining`).
"""

import logging
from collections.abc import Callable
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import Consumer, ConsumerGroupState
from harness import Bench, eventually
from patience import patient

from ros2_kafka_bridge.kafka import commits, lock
from ros2_kafka_bridge.kafka.commits import Commits
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.kafka.partitions import Partitions
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
        asked = admin.describe_consumer_groups([group], request_timeout=patient(10))
        found = asked[group].result(patient(10))
        return found.state is ConsumerGroupState.STABLE and any(
            member.assignment.topic_partitions for member in found.members
        )

    eventually(is_assigned, 60)


@pytest.mark.parametrize('module', [lock, commits], ids=lambda module: module.__name__[-7:])
def test_a_member_is_told_of_its_rebalances_before_it_is_closed_and_not_in_the_close(
    bench: Bench, topic_name: str, monkeypatch: pytest.MonkeyPatch, module: ModuleType
) -> None:
    told: list[str] = []
    in_close: list[str] = []
    kafka = {'bootstrap.servers': bench.bootstrap_servers}
    made = watched(told, in_close)
    bench.create_topic(topic_name)
    if module is lock:
        monkeypatch.setattr(lock, 'Consumer', made)
        held = GroupLock(kafka, bench.name, 'to_ros', LOG)
        held.open()
        group, close = held.group, held.close
    else:
        group = f'{bench.name}.old'
        client = made(consumer_properties(kafka, client_id='test', group=group))
        client.subscribe([topic_name], on_assign=lambda *_: None)
        close = Commits(client, topic_name, Partitions(), MagicMock(), LOG).close_client
    wait_until_assigned(bench, group)
    assert told == []
    close()
    eventually(lambda: told != [], 10)
    assert in_close == []
