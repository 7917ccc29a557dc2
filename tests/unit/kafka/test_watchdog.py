"""The look whether a Kafka client reads what its partitions hold."""

from types import SimpleNamespace
from typing import Any

import pytest
from confluent_kafka import OFFSET_END, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.watchdog import Watchdog


class Broker:
    """Answers for a client where partitions end, or not at all."""

    def __init__(self, ends: dict[int, int]) -> None:
        self.ends = ends
        self.asked: list[tuple[list[int], float]] = []
        self.answers = True

    def offsets_for_times(
        self, partitions: list[TopicPartition], timeout: float
    ) -> list[TopicPartition]:
        """The ends of partitions that are asked for."""
        assert all(asked.offset == OFFSET_END for asked in partitions)
        self.asked.append(([asked.partition for asked in partitions], timeout))
        if not self.answers:
            raise KafkaException(KafkaError(KafkaError._TIMED_OUT))
        return [TopicPartition('t', it.partition, self.ends[it.partition]) for it in partitions]


def look(watch: Watchdog, broker: Any, reached: dict[int, int]) -> None:
    watch._stuck_look_at_s = 0.0  # it is time again
    watch.look_whether_stuck(broker, reached)


def test_the_broker_is_not_asked_each_time_that_nothing_comes() -> None:
    broker, watch = Broker({0: 5}), Watchdog('t', fetch_s=0.5)
    for _ in range(10):
        watch.look_whether_stuck(broker, {0: 3})  # type: ignore[arg-type]
    assert len(broker.asked) == 1


def test_a_look_asks_once_for_all_partitions_and_outlasts_a_fetch() -> None:
    broker = Broker(dict.fromkeys(range(12), 5))
    look(Watchdog('t', fetch_s=2.0), broker, dict.fromkeys(range(12), 5))
    assert broker.asked == [(list(range(12)), 2.5)]


def test_a_client_that_reads_nothing_of_what_there_is_between_two_looks_is_stuck() -> None:
    broker, watch = Broker({0: 5, 1: 7}), Watchdog('t', fetch_s=0.5)
    look(watch, broker, {0: 5, 1: 3})
    with pytest.raises(RouteError, match='topic t: holds records that the Kafka client does not'):
        look(watch, broker, {0: 5, 1: 3})


def test_a_client_that_reads_on_or_has_read_all_is_not_stuck() -> None:
    broker, watch = Broker({0: 5, 1: 7}), Watchdog('t', fetch_s=0.5)
    for read in (3, 4, 7, 7):
        look(watch, broker, {0: 5, 1: read})


def test_a_broker_that_does_not_answer_makes_no_client_stuck() -> None:
    broker, watch = Broker({0: 5}), Watchdog('t', fetch_s=0.5)
    broker.answers = False
    look(watch, broker, {0: 3})
    look(watch, broker, {0: 3})
    broker.answers = True
    look(watch, broker, {0: 3})


def test_nothing_is_asked_where_nothing_is_read() -> None:
    broker = Broker({})
    look(Watchdog('t', fetch_s=0.5), broker, {})
    assert broker.asked == []


def test_a_client_that_kafka_does_not_let_into_its_group_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As where the coordinator of the group has failed: Kafka is there, and nothing is read."""
    now_s = 1000.0
    monkeypatch.setattr(
        'ros2_kafka_bridge.kafka.watchdog.time', SimpleNamespace(monotonic=lambda: now_s)
    )
    watch = Watchdog('t', fetch_s=0.5)
    watch.begin()
    assert watch.reason == ''
    now_s += 10
    assert watch.reason == '', 'nobody has asked whether Kafka is there'
    assert watch.joins_for_long
    watch.is_there = False
    assert 'Kafka does not answer' in watch.reason, 'a broker that stands still looks so, too'
    watch.is_there = True
    assert 'does not let this bridge into its group' in watch.reason
    assert watch.joins
    watch.on_assign()
    assert watch.reason == ''
    assert not watch.joins
    now_s += 3600
    assert watch.reason == '', 'a quiet topic is no reason'
    watch.on_lost()
    assert watch.reason == '', 'it may be back at once'
    now_s += 10
    assert watch.reason == '', 'it has answered before, and not since'
    watch.is_there = True
    assert 'does not let this bridge into its group' in watch.reason
    watch.look_whether_outside('Kafka is away')
    now_s += 5
    assert watch.reason == '', 'it has been there for a moment only'
    watch.begin()
    assert watch.reason == ''
