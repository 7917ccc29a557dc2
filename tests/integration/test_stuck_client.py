"""A Kafka client that is given up, on a real Kafka: what it did before stands in the log."""

import contextlib
import logging
from collections.abc import Callable

import pytest
from support.kafka.source_stubs import Nobody
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.properties import consumer_properties
from ros2_kafka_bridge.kafka.topic_id import TopicIds
from ros2_kafka_bridge.kafka.watchdog import Watchdog

LOG = logging.LoggerAdapter(logging.getLogger('test.stuck'), {})


def is_fetching(source: KafkaSource) -> bool:
    return '"fetch_state":"active"' in source._member.client.recorder._statistics.replace(' ', '')


def give_up(*_: object) -> None:
    raise RouteError('topic t: holds records that the Kafka client does not read')


def test_a_client_that_is_given_up_says_how_it_was_assigned_and_what_it_made_of_its_partitions(
    bench: Bench,
    topic: str,
    unique: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench.produce(topic, [b'first'])
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    properties = consumer_properties(servers, client_id='test', group=unique('group'))
    source = KafkaSource(properties, topic, 'earliest', TopicIds(servers), LOG)
    source.open(Nobody())
    caplog.set_level(logging.INFO, 'test.stuck')
    with contextlib.closing(source):
        eventually(lambda: bool(source.poll(10, 0.1)), 30)
        eventually(lambda: not source.poll(10, 0.1) and is_fetching(source), 30)
        assert 'the Kafka client' not in caplog.text
        monkeypatch.setattr(Watchdog, 'look_whether_stuck', give_up)
        with pytest.raises(RouteError):
            source.poll(10, 0.1)
    told = [record.getMessage() for record in caplog.records]
    assert any('s ago: ' in line and f'{topic} [0]' in line for line in told), told
    reported = [line for line in told if line.startswith(f'the Kafka client reported: {topic}[0]')]
    assert len(reported) == 1
    assert 'fetch_state active' in reported[0]
