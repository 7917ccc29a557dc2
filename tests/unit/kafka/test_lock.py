"""The lock of an exclusive route, where its client or a broker fails."""

import logging
import time
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka import lock as under_test
from ros2_kafka_bridge.kafka.lock import GroupLock

LOG = logging.LoggerAdapter(logging.getLogger('lock'), {})
KAFKA = {'bootstrap.servers': 'kafka-1:9092'}
CONNECTED = '{"brokers": {"x": {"nodeid": 1, "state": "UP"}}}'
APART = '{"brokers": {"x": {"nodeid": 1, "state": "INIT"}}}'
UNREACHED = KafkaError(
    KafkaError._TRANSPORT, 'kafka-2:9092/2: Connect to ipv4#10.0.0.2:9092 failed: refused'
)


class Library:
    """What the library makes: clients that hear nothing, each with its callbacks."""

    def __init__(self) -> None:
        self.clients: list[MagicMock] = []
        self.properties: dict[str, object] = {}
        self.subscribing: Exception | None = None

    def make(self, properties: dict[str, object], **_: object) -> MagicMock:
        client = MagicMock()
        client.poll.return_value = None
        client.assignment.return_value = []
        client.list_topics.return_value.topics = {'b.lock': MagicMock(error=None, partitions=[0])}
        client.subscribe.side_effect = self.subscribing
        self.clients.append(client)
        self.properties = properties
        return client

    def say(self, callback: str, what: object) -> None:
        """Call the newest client back."""
        told = self.properties[callback]
        assert callable(told)
        told(what)


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    library = Library()
    monkeypatch.setattr(group_client, 'Consumer', library.make)
    monkeypatch.setattr(under_test, 'ensure_topic', lambda *_: None)
    return library


@pytest.fixture
def lock(library: Library) -> GroupLock:
    """One that has joined, and stands by."""
    opened = GroupLock(KAFKA, 'b', 'r', LOG)
    opened.open()
    library.clients[-1].subscribe.call_args.kwargs['on_assign'](library.clients[-1], [])
    return opened


def test_a_broker_that_is_away_alone_is_not_kafka(
    lock: GroupLock,
    library: Library,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Who stands by would tell in turns that Kafka is away, and that it is back."""
    now_s = [1000.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now_s[0])
    for _ in range(3):
        library.say('stats_cb', CONNECTED)
        library.say('error_cb', UNREACHED)
        now_s[0] += 1.9
        lock.check()
        assert lock.away == ''
    assert 'Kafka is' not in caplog.text


def test_a_lock_says_that_kafka_is_away_until_a_report_tells_of_a_broker(
    lock: GroupLock, library: Library
) -> None:
    library.say('stats_cb', APART)
    library.say('error_cb', UNREACHED)
    assert lock.away.startswith('Kafka is away')
    library.say('stats_cb', APART)
    assert lock.away
    library.say('stats_cb', CONNECTED)
    assert lock.away == ''


def test_a_client_that_cannot_join_is_closed_and_the_one_before_it_stays(
    lock: GroupLock, library: Library
) -> None:
    library.subscribing = KafkaException(KafkaError(KafkaError._INVALID_ARG))
    library.clients[0].poll.side_effect = KafkaException(KafkaError(KafkaError._FATAL, fatal=True))
    lock.poll(0.0)
    first, second = library.clients
    deadline_s = time.monotonic() + 10
    while not second.close.called and time.monotonic() < deadline_s:
        time.sleep(0.01)
    second.close.assert_called_once_with()
    first.close.assert_not_called()
    assert lock.joined


def test_a_client_whose_name_was_taken_twice_leaves_it_for_another(
    lock: GroupLock, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next one of the same name has its place at once, and must not lose it again."""
    monkeypatch.setattr(under_test, '_NEW_CLIENT_EVERY_S', 0.0)
    names = [library.properties['group.instance.id']]
    for _ in range(2):
        told = MagicMock()
        told.error.return_value = KafkaError(KafkaError._FATAL, 'of any kind', fatal=True)
        library.clients[-1].poll.side_effect = [told, *[None] * 10]
        lock.poll(0.0)
        names.append(library.properties['group.instance.id'])
    first, second, _ = library.clients
    deadline_s = time.monotonic() + 10
    while not (first.close.called and second.close.called) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert (first.unsubscribe.called, second.unsubscribe.called) == (False, True)
    assert names[0] == names[1] != names[2]
    assert lock._health.away == ''
    lock.check()
