"""What the warehouse reads of Kafka: all that is there, then what comes, and nothing is lost."""

import logging
import time
from collections.abc import Iterator

import pytest

from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker
from ros2_kafka_warehouse.kafka import Memory, Sender, ask_for_topics, newest

LOG = logging.getLogger('test')
TOPICS = ('events', 'states')


@pytest.fixture
def servers() -> Iterator[str]:
    """A broker that has 20 records of each topic."""
    with EmbeddedBroker() as broker:
        send(broker.bootstrap_servers, range(20))
        yield broker.bootstrap_servers


def send(servers: str, numbers: range) -> None:
    with Sender(servers) as sender:
        for number in numbers:
            for topic in TOPICS:
                sender.send(topic, 'key', f'{topic} {number}')


def values(numbers: range) -> list[str]:
    return sorted(f'{topic} {number}' for topic in TOPICS for number in numbers)


def test_what_comes_during_the_replay_comes_behind_it(servers: str) -> None:
    with Memory(servers, TOPICS, LOG) as memory:
        replayed: list[str] = []
        for record in memory.replay():
            if not replayed:
                send(servers, range(20, 40))
            replayed.append((record.value() or b'').decode())
        assert sorted(replayed) == values(range(20))
        behind: list[str] = []
        deadline_s = time.monotonic() + 20
        while len(behind) < 40 and time.monotonic() < deadline_s:
            came = memory.poll(0.5)
            behind += [] if came is None else [(came.value() or b'').decode()]
        assert sorted(behind) == values(range(20, 40))


def test_one_topic_is_followed_behind_the_replay_of_all(servers: str) -> None:
    ends: list[bool] = []
    with Memory(servers, TOPICS, LOG, stopped=lambda: bool(ends)) as memory:
        assert len(list(memory.replay())) == 40
        send(servers, range(20, 23))
        for number, record in zip(range(20, 23), memory.follow('states'), strict=False):
            assert record.value() == b'states %d' % number
        ends.append(True)
        assert not list(memory.follow('states')), 'it ends where it is stopped'


def test_the_newest_record_is_found(servers: str) -> None:
    assert newest(servers, 'states', LOG, lambda: False) == b'states 19'
    ask_for_topics(servers)
    assert newest(servers, 'warehouse.orders', LOG, lambda: False) is None
    assert newest('127.0.0.1:1', 'states', LOG, lambda: True) is None, 'it is stopped'
