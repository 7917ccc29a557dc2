"""Who waits for records hears of a ring soon, though only Kafka ends the wait of a client."""

import logging
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from ros2_kafka_bridge.kafka.member import Member
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.threads.wakeup import Wakeup

if TYPE_CHECKING:
    from collections.abc import Callable

    from confluent_kafka import Consumer

    from ros2_kafka_bridge.kafka.client_health import ClientHealth
    from ros2_kafka_bridge.kafka.group_client import GroupClient
    from ros2_kafka_bridge.kafka.topic_watch import TopicWatch

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


class House:
    """A member whose client gets nothing, unless something happens in one of its polls."""

    def __init__(self) -> None:
        self.wakeup = Wakeup()
        self.health = SimpleNamespace(away='', has_failed=False, has_lost_brokers=False)
        self.watch = SimpleNamespace(is_asking=False)
        self.client = SimpleNamespace(is_shut_out=False)
        self.polls: list[float] = []
        self.happens: dict[int, Callable[[], object]] = {}  # in which poll, from 1 on
        self._member = Member(
            {},
            Offsets('orders', LOG),
            cast('TopicWatch', self.watch),
            cast('ClientHealth', self.health),
            LOG,
            self.wakeup,
        )
        self._member._client = cast('GroupClient', self.client)

    def poll(self, timeout_s: float) -> object:
        self.polls.append(timeout_s)
        happens = self.happens.get(len(self.polls))
        return happens and happens()

    def waits_s(self, timeout_s: float) -> float:
        """For how long it waits for the next record at most; none has come."""
        assert self._member._next(cast('Consumer', self), timeout_s) is None
        return sum(self.polls)

    def next(self, timeout_s: float) -> object:
        return self._member._next(cast('Consumer', self), timeout_s)


@pytest.mark.parametrize('timeout_s', [0.0, 0.01, 0.1, 0.2, 0.5, 5.0])
def test_a_wait_that_nobody_ends_lasts(timeout_s: float) -> None:
    house = House()
    assert house.waits_s(timeout_s) == pytest.approx(timeout_s)
    assert max(house.polls) <= 0.2, 'nobody else is heard in a poll'


def test_a_ring_ends_a_wait_within_a_piece_of_it() -> None:
    house = House()
    house.happens[3] = house.wakeup.ring
    assert house.waits_s(5) == pytest.approx(0.6)
    assert not house.wakeup.is_rung, 'the next wait lasts'
    house.polls.clear()
    house.happens.clear()
    assert house.waits_s(5) == pytest.approx(5)


def test_a_ring_from_before_ends_a_wait_too() -> None:
    house = House()
    house.wakeup.ring()
    assert house.waits_s(5) <= 0.2


@pytest.mark.parametrize(
    ('of', 'what', 'value'),
    [
        ('health', 'has_failed', True),
        ('health', 'has_lost_brokers', True),
        ('health', 'away', 'Kafka is away'),
        ('client', 'is_shut_out', True),
        ('watch', 'is_asking', True),
    ],
)
def test_what_cannot_wait_ends_a_wait(of: str, what: str, value: object) -> None:
    house = House()
    house.happens[2] = lambda: setattr(getattr(house, of), what, value)
    assert house.waits_s(5) == pytest.approx(0.4)


def test_a_record_ends_a_wait_and_no_ring_is_lost_by_it() -> None:
    house = House()

    def come() -> str:
        house.wakeup.ring()
        return 'record'

    house.happens[2] = come
    assert house.next(5) == 'record'
    assert house.wakeup.is_rung
