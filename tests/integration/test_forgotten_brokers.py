"""Clients of Kafka that know no broker: what librdkafka reports where it was told of none."""

import contextlib
import logging
import time
from collections.abc import Callable

import pytest
from support.kafka.source_stubs import NO_IDS, Nobody
from support.patience import patient

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.errors import Client
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.kafka.producer import KafkaSink
from ros2_kafka_bridge.kafka.properties import consumer_properties, producer_properties
from ros2_kafka_bridge.kafka.statistics import Statistics

LOG = logging.LoggerAdapter(logging.getLogger('test.forgotten'), {})
NO_BROKERS = {'statistics.interval.ms': 20}


def until(done: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + patient(30)
    while not done():
        assert time.monotonic() < deadline_s


def test_brokers_are_lost_only_where_a_client_knows_none_for_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now_s[0])
    health = ClientHealth('topic t', LOG, Client('READ'))

    def lost(*reports: int) -> bool:
        """Reports, 0.4 s apart, of so many brokers."""
        for brokers in reports:
            now_s[0] += 0.4
            health.on_statistics(
                Statistics(None, knows_brokers=bool(brokers), is_connected=bool(brokers))
            )
        return health.has_lost_brokers

    assert not lost(0, 0, 0, 1, 0, 0, 0)
    assert lost(0)
    health.on_new_client()
    assert not lost(0, 0, 0)
    health.on_open()
    assert not lost(0, 0, 0)
    assert lost(0)
    assert not lost(1)


def test_a_producer_without_brokers_is_given_up() -> None:
    sink: KafkaSink[int] = KafkaSink(producer_properties(NO_BROKERS, client_id='test'), 't', LOG)
    sink.open()
    with pytest.raises(RouteError, match=f'^topic t: {BROKERS_LOST}$'):
        until(lambda: bool(sink.poll(0.02).confirmed))
    sink.close()


def test_a_consumer_without_brokers_has_another_and_then_the_route_begins_anew(
    caplog: pytest.LogCaptureFixture,
) -> None:
    source = KafkaSource(
        consumer_properties(NO_BROKERS, client_id='test', group='test'),
        't',
        'earliest',
        NO_IDS,
        LOG,
    )
    source.open(Nobody())
    with (
        contextlib.closing(source),
        pytest.raises(RouteError, match=f'^topic t: {BROKERS_LOST}$'),
    ):
        until(lambda: bool(source.poll(10, 0.02)))
    assert caplog.text.count(BROKERS_LOST) == 1


def test_a_lock_whose_client_knows_no_brokers_has_another(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.kafka.lock.ensure_topic', lambda *_: None)
    monkeypatch.setattr(GroupLock, '_check_topic', lambda *_: None)
    with GroupLock(NO_BROKERS, 'bridge', 'route', LOG) as lock:
        lock.open()

        def joins_anew() -> bool:
            lock.poll(0.02)
            return 'joins the bridges of this route anew' in caplog.text

        until(joins_anew)
        assert not lock.held
    assert caplog.text.count(BROKERS_LOST) == 1
