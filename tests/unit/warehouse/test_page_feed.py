"""Records that cannot be shown must not end the page."""

import logging
from typing import Any

import pytest

from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page.feed import Feed
from ros2_kafka_warehouse.page.view import View

SITE = Site('small', ('....',), {'packing-1': (3, 0)}, {}, {})


class Record:
    """As confluent_kafka gives one."""

    def __init__(self, topic: str, value: bytes) -> None:
        self._topic, self._value = topic, value

    def topic(self) -> str:
        return self._topic

    def value(self) -> bytes:
        return self._value

    def partition(self) -> int:
        return 2

    def offset(self) -> int:
        return 17

    def error(self) -> None:
        return None

    def timestamp(self) -> tuple[int, int]:
        return 1, 1_000_000


class Stumbling(View):
    """Cannot show orders."""

    taken = 0

    def take(self, topic: str, value: bytes | None, now_s: float, made_s: float) -> None:
        if topic == 'warehouse.orders':
            raise ValueError('year 0 is out of range')
        self.taken += 1
        super().take(topic, value, now_s, made_s)


def test_a_record_that_cannot_be_shown_is_left_out_and_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    view = Stumbling(SITE)
    feed = Feed('localhost:1', view)
    bad, good = Record('warehouse.orders', b'{}'), Record('warehouse.failures', b'{}')
    records: Any = [bad, good, bad, good]
    with caplog.at_level(logging.ERROR):
        assert feed._take(records) == 4
    assert view.taken == 2
    [said] = caplog.records
    assert 'warehouse.orders, partition 2, offset 17' in said.getMessage()
    view.tick(1000.0, kafka_away='', rate=0)
    assert b'"unreadable":4' in view.newer({})  # two of each
