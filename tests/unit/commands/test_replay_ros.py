"""Dead letters on their way straight to ROS, with readers in memory."""

from typing import Any

import pytest
from support.bridges.made_letters import Readers, to_readers

from ros2_kafka_bridge.commands.dead_letters import replay_ros
from ros2_kafka_bridge.commands.dead_letters.replay_ros import LetterChannel
from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.route import obstacle
from ros2_kafka_bridge.threads.stop import Stop

pytestmark = pytest.mark.usefixtures('no_settle_time')

ROUTE: dict[str, Any] = {
    'name': 'orders',
    'from': {'kafka': 'orders'},
    'to': {'ros': '/orders', 'type': 'std_msgs/msg/String', 'qos': {'reliability': 'best_effort'}},
    'format': 'text',
    'min_subscribers': 0,
    'when_full': 'drop_oldest',
    'max_age_s': 1,
}


def channel(readers: Readers, stop: Stop | None = None) -> LetterChannel:
    return LetterChannel(validated(KafkaToRosRoute, ROUTE), to_readers(readers), stop or Stop())


def letters(*values: bytes) -> list[Outgoing]:
    return [Outgoing('orders', b'key', value, [('ros.seq', b'1')]) for value in values]


def is_not_delivered(to: LetterChannel, why: str) -> None:
    with pytest.raises(TransportError, match=why):
        to.deliver(letters(b'1'))
    assert to.delivered == 0


def test_batches_are_published_and_waited_for_one_after_the_other() -> None:
    readers = Readers()
    to = channel(readers)
    to.deliver(letters(b'1', b'2'))
    assert to.delivered == 2
    to.deliver(letters(b'3'))
    assert to.delivered == 1
    assert readers.published == [b'1', b'2', b'3']


def test_when_a_reader_goes_the_batch_is_published_again() -> None:
    readers = Readers()
    readers.happen_at(3, readers.lose_reader)
    to = channel(readers)
    to.deliver(letters(b'1'))
    to.deliver(letters(b'2', b'3'))
    to.deliver(letters(b'4'))
    assert readers.published == [b'1', b'2', b'3', b'2', b'3', b'4']


def test_a_stop_ends_the_waiting_for_subscribers() -> None:
    stop, readers = Stop(), Readers(matched=0)
    stop.ask()
    to = channel(readers, stop)
    to.deliver(letters(b'1'))
    assert (readers.published, to.delivered) == ([], 0)


def test_a_stop_in_the_middle_publishes_no_more_and_waits_for_what_is_published() -> None:
    stop, readers = Stop(), Readers(room=2, acknowledging=False)

    def ask() -> None:
        stop.ask()
        readers.acknowledging = True

    readers.happen_at(2, ask)
    to = channel(readers, stop)
    to.deliver(letters(b'1', b'2', b'3'))
    assert readers.published == [b'1', b'2']
    assert to.delivered == 2


def test_a_reader_that_does_not_acknowledge_in_time_after_a_stop_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(replay_ros, '_PATIENCE_S', 0.1)
    stop, readers = Stop(), Readers(acknowledging=False)
    readers.happen_at(1, stop.ask)
    to = channel(readers, stop)
    is_not_delivered(to, 'stopped while waiting')


def test_a_second_stop_waits_for_nothing() -> None:
    stop, readers = Stop(), Readers(acknowledging=False)

    def ask_twice() -> None:
        stop.ask()
        stop.ask()

    readers.happen_at(1, ask_twice)
    to = channel(readers, stop)
    is_not_delivered(to, 'stopped while waiting')


@pytest.mark.parametrize(
    ('there', 'words'),
    [(0, '0 of 1 subscriber of /orders there after'), (1, 'does not take: not acknowledged')],
)
def test_subscribers_that_are_too_few_or_do_not_acknowledge_are_said_after_a_while(
    there: int, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay_ros, '_PATIENCE_S', 0.1)
    to = channel(Readers(matched=there, acknowledging=False))
    is_not_delivered(to, words)


def test_a_subscriber_that_would_misread_the_letters_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(obstacle, 'SAID_AFTER_S', 0.0)  # a wait is told by the first step
    monkeypatch.setattr(replay_ros, '_PATIENCE_S', 1.5)
    to = channel(Readers(misread='/old would misread it'))
    is_not_delivered(to, r'^/orders: /old would misread it$')


def test_guarantee_6c_letters_that_no_reliable_reader_takes_are_not_delivered() -> None:
    readers = Readers(tells=False)
    to = channel(readers)
    with pytest.raises(TransportError, match='/orders has no reliable subscriber'):
        to.deliver(letters(b'1', b'2'))
    assert to.delivered == 0
    readers.tells = True
    to.deliver(letters(b'1', b'2'))
    assert to.delivered == 2
