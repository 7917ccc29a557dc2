"""The sink on a broker inside the process, and what librdkafka may report to it."""

import logging
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import pytest
from confluent_kafka import KafkaError
from support.patience import eventually

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka import producer, properties
from ros2_kafka_bridge.kafka.producer import KafkaSink
from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})

OFTEN: Final[dict[str, Any]] = {'statistics.interval.ms': 50}


@pytest.mark.parametrize(('given', 'confirmed'), [({}, 1), ({'linger.ms': 60_000}, 0)])
def test_a_hurried_record_lingers_only_where_the_user_says_so(
    given: dict[str, Any], confirmed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # So long that without being hurried no record would be delivered within this test.
    for module in (properties, producer):
        monkeypatch.setattr(module, 'LINGER_MS', 50_000)
    with EmbeddedBroker() as broker:
        config = {'bootstrap.servers': broker.bootstrap_servers, **given}
        sink: KafkaSink[str] = KafkaSink(
            properties.producer_properties(config, client_id='test'), 'orders', LOG
        )
        sink.open()
        assert sink.produce(Outgoing('orders', None, b'one', []), 'one')
        reports: list[str] = []
        deadline_s = time.monotonic() + (0.5 if given else 10)
        while not reports and time.monotonic() < deadline_s:
            sink.hurry()
            reports += sink.poll(0.01).confirmed
        assert len(reports) == confirmed
        sink.close()


def test_a_sink_that_sends_nothing_knows_whether_kafka_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with EmbeddedBroker() as broker:
        config = {**OFTEN, 'bootstrap.servers': broker.bootstrap_servers}
        sink: KafkaSink[str] = KafkaSink(
            properties.producer_properties(config, client_id='test'), 'orders', LOG
        )
        assert not sink.reached
        sink.open()
        eventually(lambda: not sink.poll(0.01).confirmed and sink.reached, 30)
        monkeypatch.setattr(producer, '_IDLE_BLIP_S', 0.0)
        sink._health.on_error(KafkaError(KafkaError._ALL_BROKERS_DOWN, '1/1 brokers are down'))
        assert 'Kafka is away' in sink.away
        eventually(lambda: not sink.poll(0.01).confirmed and not sink.away, 30)
        sink.close()


def test_a_sink_that_never_finds_kafka_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(producer, '_IDLE_BLIP_S', 0.5)
    config = {**OFTEN, 'bootstrap.servers': '127.0.0.1:9'}
    sink: KafkaSink[str] = KafkaSink(
        properties.producer_properties(config, client_id='test'), '', LOG
    )
    sink.open()
    eventually(lambda: not sink.poll(0.01).confirmed and 'Kafka is away' in sink.away, 30)
    assert not sink.reached
    sink.close()


class Report(NamedTuple):
    """What librdkafka tells of a record that it takes for delivered."""

    told_partition: int
    told_offset: int | None

    def partition(self) -> int:
        return self.told_partition

    def offset(self) -> int | None:
        return self.told_offset


class Client:
    """A producer that delivers nothing by itself."""

    def __init__(self, *_: Any, **__: Any) -> None:
        self.taken: list[Callable[[None, Report], None]] = []

    def produce(self, *_: Any, on_delivery: Callable[[None, Report], None], **__: Any) -> None:
        self.taken.append(on_delivery)

    def report(self, partition: int, offset: int | None) -> None:
        self.taken.pop(0)(None, Report(partition, offset))

    def poll(self, _: float) -> None:
        pass

    def __len__(self) -> int:
        return len(self.taken)


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> Client:
    made = Client()
    monkeypatch.setattr(producer, 'Producer', lambda *_, **__: made)
    return made


def opened(**more: Any) -> KafkaSink[int]:
    config = {'bootstrap.servers': 'nobody:9', **more}
    sink: KafkaSink[int] = KafkaSink(
        properties.producer_properties(config, client_id='test'), 'orders', LOG
    )
    sink.open()
    return sink


def offered(sink: KafkaSink[int], *numbers: int) -> list[int]:
    return [n for n in numbers if sink.produce(Outgoing('orders', None, b'%d' % n, []), n)]


def test_one_record_is_on_the_way_until_the_first_is_confirmed_guarantees_1_2_3(
    client: Client,
) -> None:
    sink = opened()
    assert offered(sink, 0, 1, 2) == [0]
    client.report(0, 0)
    assert sink.poll(0).confirmed == [0]
    assert offered(sink, 1, 2, 3) == [1, 2, 3]
    sink.open()
    client.taken.clear()
    assert offered(sink, 4, 5) == [4], 'another producer, whom no partition knows'


def test_a_record_that_is_said_to_be_there_where_nothing_was_confirmed_is_written_again(
    client: Client,
) -> None:
    sink = opened()
    offered(sink, 0)
    client.report(0, 0)
    sink.poll(0)
    offered(sink, 1, 2, 3, 4)
    client.report(1, None)  # partition 1 has refused it, and then taken the next one
    client.report(1, 0)
    client.report(1, None)  # an answer was lost: now the partition does know this producer
    client.report(0, None)
    reports = sink.poll(0)
    assert reports.confirmed == [2, 3, 4]
    [(number, error)] = reports.failed
    assert number == 1
    assert isinstance(error, TransportError)


def test_without_idempotence_reports_are_taken_as_they_are(client: Client) -> None:
    sink = opened(acks='0')
    assert offered(sink, 0, 1) == [0, 1]
    client.report(0, None)
    client.report(1, None)
    assert sink.poll(0).confirmed == [0, 1]
