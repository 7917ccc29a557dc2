"""What librdkafka's statistics tell."""

import json

import pytest

from ros2_kafka_bridge.kafka.statistics import read, with_statistics


def test_the_round_trip_is_that_of_the_slowest_broker_that_was_asked() -> None:
    def rtt(p50: int, p99: int, cnt: int) -> dict[str, object]:
        return {'nodeid': 1, 'rtt': {'p50': p50, 'p99': p99, 'cnt': cnt, 'avg': 1}}

    brokers = {'a': rtt(2000, 9000, 5), 'b': rtt(3000, 4000, 1), 'old': rtt(9, 10_000_000, 0)}
    assert read(json.dumps({'name': 'x', 'brokers': brokers})).round_trip_s == (0.003, 0.009)
    assert read(json.dumps({'brokers': {'a': rtt(0, 0, 0)}})).round_trip_s is None
    assert read('{}').round_trip_s is None


@pytest.mark.parametrize(
    ('sources', 'known'),
    [('', 0), ('logical internal', 0), ('learned logical', 1), ('configured', 1)],
)
def test_brokers_are_known_where_one_may_be_connected_to(sources: str, known: int) -> None:
    brokers = {f'b{n}': {'source': source} for n, source in enumerate(sources.split())}
    assert read(json.dumps({'brokers': brokers})).knows_brokers == bool(known)


def test_a_name_with_quotes_hides_nothing() -> None:
    told = '{ "name": "a"b#producer-1", "client_id": "a"b", "type": "producer", "brokers": %s}'
    up = read(told % '{"x": {"nodeid": 0, "source": "learned", "state": "UP"}}')
    assert (up.is_connected, up.knows_brokers) == (True, True)
    assert not read(told % '{}').knows_brokers
    assert read('{ "name": "a"b"}').knows_brokers, 'what cannot be read says nothing bad'


def test_statistics_come_often_enough_to_know_whether_a_client_lives() -> None:
    name = 'statistics.interval.ms'
    assert with_statistics({'a': 'b'}) == {'a': 'b', name: 4000}
    assert with_statistics({name: '500'})[name] == 500
    assert with_statistics({name: 600_000})[name] == 4000
    assert with_statistics({name: 0})[name] == 4000


@pytest.mark.parametrize(
    ('broker', 'is_connected'),
    [
        ({'nodeid': -1, 'source': 'configured', 'state': 'UP'}, False),
        ({'nodeid': 1, 'source': 'learned', 'state': 'TRY_CONNECT'}, False),
        ({'nodeid': 0, 'source': 'learned', 'state': 'UP'}, True),
        ({'nodeid': -1, 'source': 'logical', 'state': 'UP'}, True),
    ],
)
def test_what_answers_at_bootstrap_servers_is_no_broker_of_the_cluster(
    broker: dict[str, object], *, is_connected: bool
) -> None:
    """Where advertised.listeners is wrong, it answers and names one that does not."""
    assert read(json.dumps({'brokers': {'b': broker}})).is_connected == is_connected
