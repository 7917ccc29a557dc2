"""What is said of a cluster where it does not answer: nothing of it is taken for an answer."""

import socket
from concurrent.futures import Future
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException, TopicPartition, Uuid
from confluent_kafka.admin import TopicDescription  # type: ignore[attr-defined]  # as in overview

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka import admin, overview
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, records
from ros2_kafka_bridge.kafka.partition import Committed
from ros2_kafka_bridge.kafka.topic_id import TopicId


def failed(code: int, text: str = '') -> 'Future[Any]':
    future: Future[Any] = Future()
    future.set_exception(KafkaException(KafkaError(code, text or None)))
    return future


def done(value: object) -> 'Future[Any]':
    future: Future[Any] = Future()
    future.set_result(value)
    return future


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An admin client, and a consumer."""
    client = MagicMock()
    monkeypatch.setattr(admin, 'AdminClient', lambda *_, **__: client)
    monkeypatch.setattr(overview, 'Consumer', lambda *_, **__: client)
    return client


def look(library: Any) -> Overview:
    del library
    return Overview({'bootstrap.servers': 'kafka:9092'})


@pytest.mark.parametrize(
    ('code', 'exists'),
    [
        (KafkaError.UNKNOWN_TOPIC_OR_PART, False),
        (KafkaError._TIMED_OUT, None),
        (KafkaError._TRANSPORT, None),
        (KafkaError.TOPIC_AUTHORIZATION_FAILED, None),
        (KafkaError.LEADER_NOT_AVAILABLE, None),
    ],
)
def test_only_the_word_of_a_broker_says_that_a_topic_is_not_there(
    library: Any, code: int, *, exists: bool | None
) -> None:
    library.describe_topics.return_value = {'orders': failed(code, 'as it said')}
    view = look(library).topic('orders')
    assert (view.exists, view.problem) == (exists, 'as it said')


@pytest.mark.parametrize(
    ('told', 'known'),
    [
        pytest.param(Uuid(1, 2), 'AAAAAAAAAAEAAAAAAAAAAg', id='of now'),
        pytest.param(Uuid(0, 0), '', id='before 2.8'),
    ],
)
def test_which_topic_it_is_comes_with_the_look_at_it(library: Any, told: Uuid, known: str) -> None:
    described = TopicDescription('orders', told, is_internal=False, partitions=[])
    library.describe_topics.return_value = {'orders': done(described)}
    assert look(library).topic('orders').topic_id == known
    assert library.describe_topics.call_count == 1
    assert not library.describe_cluster.called


def test_committed_offsets_say_which_topic_they_are_of(library: Any) -> None:
    of = TopicId('cluster', 'topic')
    library.committed.return_value = [
        TopicPartition('orders', 0, 5, of.metadata),
        TopicPartition('orders', 1, 7),
        TopicPartition('orders', 2, -1001),
    ]
    found = look(library).committed('group', 'orders', 3)
    assert found == {0: Committed(5, of), 1: Committed(7, None)}


def test_an_end_that_is_told_without_a_leader_is_none(library: Any) -> None:
    """The client answers with -1001, and no error, where it could not ask."""
    places = [TopicPartition('orders', number) for number in range(2)]
    answers = [MagicMock(offset=-1001), MagicMock(offset=50)]
    library.list_offsets.return_value = dict(zip(places, map(done, answers), strict=True))
    topic = KafkaTopic('orders', 2, '')
    ends = look(library).ends([topic])
    assert ends == {('orders', 1): 50}
    assert records(topic, {('orders', 0): 0, ('orders', 1): 0}, ends) is None


def test_committed_offsets_that_are_refused_are_not_none_at_all(library: Any) -> None:
    refused = MagicMock(partition=0, offset=-1001)
    refused.error = KafkaError(KafkaError.TOPIC_AUTHORIZATION_FAILED)
    library.committed.return_value = [refused]
    with pytest.raises(RouteError, match='its offsets cannot be read'):
        look(library).committed('group', 'orders', 1)


def test_a_broker_is_there_where_somebody_answers_at_its_own_address(library: Any) -> None:
    with (
        socket.create_server(('127.0.0.1', 0)) as there,
        socket.create_server(('127.0.0.1', 0)) as gone,
    ):
        ports = [there.getsockname()[1], gone.getsockname()[1]]
        gone.close()
        brokers = {
            number: MagicMock(id=number, host='127.0.0.1', port=port)
            for number, port in enumerate(ports, 1)
        }
        library.list_topics.return_value = MagicMock(brokers=brokers, cluster_id='c')
        greeting = look(library).greeting()
    assert str(greeting) == '1 broker of cluster c answers'
    [text] = greeting.unreached
    assert text.startswith(f'the cluster names 127.0.0.1:{ports[1]} as the address of broker 2')
    assert text.endswith('Connection refused')


def test_a_name_that_cannot_be_one_of_dns_is_told_as_not_reached(library: Any) -> None:
    broker = MagicMock(id=1, host='x..y', port=9092)
    library.list_topics.return_value = MagicMock(brokers={1: broker}, cluster_id='c')
    greeting = look(library).greeting()
    assert greeting.brokers == 0
    assert 'the cluster names x..y:9092 as the address of broker 1' in greeting.unreached[0]


@pytest.mark.parametrize('names_before', [False, True], ids=['first', 'later'])
def test_an_address_that_the_cluster_names_is_blamed_where_the_first_question_fails(
    monkeypatch: pytest.MonkeyPatch, *, names_before: bool
) -> None:
    """The client may cut its way to bootstrap.servers before it brings the answer."""
    told: dict[str, Any] = {}
    client = MagicMock()
    client.list_topics.return_value = MagicMock(brokers={}, topics={})
    monkeypatch.setattr(admin, 'AdminClient', lambda own, **_: told.update(own) or client)
    seen = Overview({'bootstrap.servers': 'kafka:9092'})
    if names_before:
        seen.greeting()
    for text in ('old:9092/bootstrap', 'wrong:9092/1'):
        refused = f'{text}: Connect to ipv4#10.0.0.1:9092 failed: Connection refused'
        told['error_cb'](KafkaError(KafkaError._TRANSPORT, refused))
    client.list_topics.side_effect = KafkaException(KafkaError(KafkaError._TRANSPORT))
    with pytest.raises(TransportError) as caught:
        seen.greeting()
    blamed = 'named wrong:9092 as the address of a broker: if that runs, mend its advertised'
    assert (blamed in str(caught.value)) is not names_before


def test_who_is_in_a_group_is_told_and_one_of_another_kind_is_refused(library: Any) -> None:
    members = [MagicMock(client_id='shop'), MagicMock(client_id='bridge-worker-1')]
    library.describe_consumer_groups.return_value = {
        'g': done(MagicMock(partition_assignor='range', members=members))
    }
    found = look(library).members('g')
    assert (found.strategy, sorted(found.clients)) == ('range', ['bridge-worker-1', 'shop'])
    library.describe_consumer_groups.return_value = {'g': failed(KafkaError._TIMED_OUT)}
    assert look(library).members('g').clients == frozenset(), 'nobody has told'
    library.describe_consumer_groups.return_value = {
        'g': failed(KafkaError._INVALID_ARG, 'GroupId g is not a consumer group (connect).')
    }
    with pytest.raises(RouteError, match='not a consumer group'):
        look(library).members('g')
