"""The broker inside the process: other clients find it and keep their records in it."""

import pytest
from confluent_kafka import Consumer, Producer, TopicPartition

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka import topics
from ros2_kafka_bridge.kafka.topics import ensure_topic
from ros2_kafka_bridge.testing import embedded_broker
from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker


def test_another_client_reads_back_what_a_client_wrote() -> None:
    with EmbeddedBroker() as broker:
        produce(broker.bootstrap_servers, [b'first', b'second'])
        assert consume(broker.bootstrap_servers, 2) == [b'first', b'second']


def test_there_are_as_many_brokers_as_asked_for() -> None:
    with EmbeddedBroker(brokers=3) as broker:
        assert len(broker.bootstrap_servers.split(',')) == 3


def test_two_of_them_know_nothing_of_each_other() -> None:
    with EmbeddedBroker() as one, EmbeddedBroker() as other:
        produce(one.bootstrap_servers, [b'one'])
        produce(other.bootstrap_servers, [b'other'])
        assert consume(one.bootstrap_servers, 1) == [b'one']


def test_it_listens_on_this_machine_alone() -> None:
    with EmbeddedBroker() as broker:
        assert broker.bootstrap_servers.startswith('127.0.0.1:')


def test_a_topic_that_is_there_is_not_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    # This broker cannot make topics by request, as a user may not be allowed to.
    with EmbeddedBroker() as broker:
        produce(broker.bootstrap_servers, [b'first'])
        ensure_topic({'bootstrap.servers': broker.bootstrap_servers}, 'orders')
        monkeypatch.setattr(topics, '_REQUEST_S', 0.5)
        with pytest.raises(TransportError):
            ensure_topic({'bootstrap.servers': broker.bootstrap_servers}, 'others')


def test_one_that_does_not_come_up_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(embedded_broker, 'ANSWER_S', 0.0)
    with pytest.raises(TransportError, match='the embedded broker does not answer: '):
        EmbeddedBroker().__enter__()


def produce(bootstrap_servers: str, values: list[bytes]) -> None:
    with Producer({'bootstrap.servers': bootstrap_servers}) as producer:
        for value in values:
            producer.produce('orders', value, partition=0)
        assert producer.flush(10) == 0


def consume(bootstrap_servers: str, count: int) -> list[bytes | None]:
    with Consumer({'bootstrap.servers': bootstrap_servers, 'group.id': 'test'}) as consumer:
        consumer.assign([TopicPartition('orders', 0, 0)])
        return [message.value() for message in consumer.consume(count, 10)]
