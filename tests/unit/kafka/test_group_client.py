"""One client of a group: what it says counts until its end, and how it leaves its group."""

import logging
import threading
from collections.abc import Callable
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka.client_health import ClientHealth
from ros2_kafka_bridge.kafka.errors import Client
from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.threads import unattended

LOG = logging.LoggerAdapter(logging.getLogger('group'), {})
CONNECTED = '{"brokers": {"x": {"nodeid": 1, "state": "UP"}}}'
FENCED = KafkaError(KafkaError._FATAL, 'Static consumer fenced by other consumer', fatal=True)
AWAY = KafkaError(KafkaError._ALL_BROKERS_DOWN)


class Told:
    """A client that has joined a group on a library that does nothing, and what it was told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.library = MagicMock()
        self.library.poll.return_value = None
        self.library.assignment.return_value = []
        self.callbacks: dict[str, Callable[..., None]] = {}

        def make(properties: dict[str, Any], **_: object) -> MagicMock:
            self.callbacks.update(
                {name: value for name, value in properties.items() if callable(value)}
            )
            return self.library

        monkeypatch.setattr(group_client, 'Consumer', make)
        monkeypatch.setattr(group_client, '_JOIN_S', 0.2)
        self.health = ClientHealth('topic t', LOG, Client('READ'))
        self.client = GroupClient({}, 't', self.health, LOG.logger)
        self.said: list[object] = []
        self.client.open(
            lambda report: self.said.append(report.is_connected),
            on_commit=lambda *_: self.said.append('committed'),
        )
        self.client.subscribe(*map(self._notes, ('assigned', 'revoked', 'lost')))
        self.callbacks |= self.library.subscribe.call_args.kwargs

    def _notes(self, what: str) -> Callable[[frozenset[int]], None]:
        return lambda numbers: self.said.append((what, sorted(numbers)))

    def say_all(self) -> None:
        """Let the library call back all that it was given."""
        for name in ('on_assign', 'on_revoke', 'on_lost'):
            self.callbacks[name](self.library, [TopicPartition('t', 2), TopicPartition('t', 0)])
        self.callbacks['on_commit'](None, [])
        self.callbacks['stats_cb'](CONNECTED)
        self.callbacks['error_cb'](AWAY)

    @property
    def order(self) -> list[str]:
        """What was asked of the library, but for its polls."""
        return [call[0] for call in self.library.mock_calls if call[0] in {'unsubscribe', 'close'}]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    return Told(monkeypatch)


def test_what_a_client_says_counts_until_its_end(told: Told) -> None:
    told.say_all()
    heard = [(what, [0, 2]) for what in ('assigned', 'revoked', 'lost')]
    assert told.said == [*heard, 'committed', True]
    assert told.health.away
    assert told.client.end(30.0, leaves=False)
    told.health.on_contact()
    told.say_all()
    assert told.said == [*heard, 'committed', True]
    assert not told.health.away, 'another speaks for itself'


def test_a_client_that_is_replaced_leaves_its_place_to_the_next_of_its_name(told: Told) -> None:
    told.say_all()
    assert told.client.end(30.0, leaves=False)
    assert told.order == ['close']
    assert told.client.end(30.0, leaves=True)
    assert told.order == ['close', 'unsubscribe', 'close']


def test_a_client_that_leaves_waits_until_it_has_joined(told: Told) -> None:
    """Kafka would take it for a member, and the next one would wait for it."""
    polls: list[str] = []

    def poll(_: float) -> None:
        polls.append('before' if not told.order else 'after')
        if len(polls) == 3:
            told.callbacks['on_assign'](told.library, [])

    told.library.poll.side_effect = poll
    assert told.client.end(30.0, leaves=True)
    assert polls.count('before') == 3
    assert told.order == ['unsubscribe', 'close']


@pytest.mark.parametrize('is_away', [True, False])
def test_a_client_that_is_not_let_in_leaves_all_the_same(told: Told, *, is_away: bool) -> None:
    polls: list[list[str]] = []
    told.library.poll.side_effect = lambda _: polls.append(told.order)
    if is_away:
        told.health.on_error(AWAY)
    assert told.client.end(30.0, leaves=True)
    assert told.order == ['unsubscribe', 'close']
    assert ([] in polls) is not is_away, 'who is away lets nobody in'


def test_a_client_that_fails_while_it_leaves_has_left(told: Told) -> None:
    """confluent-kafka raises a SystemError where a callback meets an error of the client."""
    told.library.poll.side_effect = [SystemError(), None, None]
    assert told.client.end(30.0, leaves=True)
    assert told.order == ['unsubscribe', 'close']


def test_a_process_without_threads_leaves_its_group_and_the_client_behind(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(unattended, 'ends_within', refuse)
    told.say_all()
    assert not told.client.end(30.0, leaves=True)
    assert told.order == ['unsubscribe']


def test_a_client_whose_name_was_taken_says_nothing_of_kafka(told: Told) -> None:
    told.client.on_error(FENCED)
    told.client.on_error(AWAY)
    assert told.client.is_shut_out
    assert not told.health.has_failed
    assert not told.health.away


def test_a_commit_is_waited_for_but_not_without_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    library, answers = MagicMock(), threading.Event()
    library.poll.return_value = None
    monkeypatch.setattr(group_client, 'Consumer', lambda *_, **__: library)
    client = GroupClient({}, 't', MagicMock(), LOG.logger)
    client.open()
    client.commit(5.0, [TopicPartition('t', 0, 5)])
    library.commit.assert_called_once_with(offsets=[TopicPartition('t', 0, 5)], asynchronous=False)
    refused = KafkaError(KafkaError.GROUP_AUTHORIZATION_FAILED, 'refused')
    library.commit.side_effect = KafkaException(refused)
    with pytest.raises(KafkaException, match='refused'):
        client.commit(5.0, [TopicPartition('t', 0, 5)])
    library.commit.side_effect = lambda **_: answers.wait(30)
    with pytest.raises(KafkaException, match=r'within 0\.05 s'):
        client.commit(0.05, [TopicPartition('t', 0, 5)])
    assert not client.end(0.05, leaves=False)
    library.close.assert_not_called()
    answers.set()
    assert client.end(30.0, leaves=False)
    assert library.close.call_count >= 1
