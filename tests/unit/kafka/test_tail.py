"""The end of a topic that takes longer to read than there is time."""

import time
from collections.abc import Callable
from typing import Any

import pytest
from confluent_kafka import Message, TopicPartition

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka import ranges
from ros2_kafka_bridge.kafka.tail import KafkaTail


class Broker:
    """A broker that hands out one record of a partition of 1,000 at a time, and then is silent."""

    def __init__(self, answers: int) -> None:
        self.clock_s = 0.0
        self._left = answers
        self._next = 0

    def list_topics(self, topic: str, timeout: float) -> Any:
        del timeout
        return type(
            'Topics',
            (),
            {'topics': {topic: type('Topic', (), {'partitions': [0], 'error': None})}},
        )

    def get_watermark_offsets(self, *_: Any, **__: Any) -> tuple[int, int]:
        return 0, 1000

    def assign(self, places: list[TopicPartition]) -> None:
        self._next = places[0].offset

    def pause(self, *_: Any) -> None:
        pass

    close = pause

    def consume(self, *_: Any) -> list[Message]:
        self.clock_s += 1.0
        if not self._left:
            return []
        self._left -= 1
        self._next += 1
        return [Message(topic='orders', partition=0, offset=self._next - 1, value=b'')]


@pytest.fixture
def tail_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], KafkaTail]:
    """Makes the tail of such a broker, in whose time a second passes with each answer."""

    def make(answers: int) -> KafkaTail:
        broker = Broker(answers)
        monkeypatch.setattr(ranges, 'Consumer', lambda *_, **__: broker)
        monkeypatch.setattr(time, 'monotonic', lambda: broker.clock_s)
        return KafkaTail({}, 'orders')

    return make


def test_what_is_read_too_slowly_is_cut_and_no_further_reading_is_promised(
    tail_of: Callable[[int], KafkaTail],
) -> None:
    noted: list[int | None] = []
    tail = tail_of(1000)
    tail.read(1000, 60.0, lambda record: noted.append(record.offset()))
    assert tail.is_cut
    assert not tail.complete, 'what was not read may be there'
    assert noted == list(range(tail.records))
    assert 59 <= tail.records <= 62


@pytest.mark.parametrize('answers', [0, 20])
def test_a_broker_that_has_fallen_silent_is_away(
    answers: int, tail_of: Callable[[int], KafkaTail]
) -> None:
    tail = tail_of(answers)
    with pytest.raises(TransportError, match='its end cannot be read in time'):
        tail.read(1000, 60.0, lambda _: None)
    assert tail.partitions == 0, 'it is read anew'


def test_what_is_read_in_time_is_not_cut(tail_of: Callable[[int], KafkaTail]) -> None:
    tail = tail_of(1000)
    tail.read(30, 60.0, lambda _: None)
    assert (tail.records, tail.is_cut, tail.complete) == (30, False, False)
