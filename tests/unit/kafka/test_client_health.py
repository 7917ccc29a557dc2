"""What a Kafka client says of itself is told once, with its cause."""

import logging
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka import client_health as under_test
from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.kafka.client_health import ClientHealth
from ros2_kafka_bridge.kafka.errors import Client
from ros2_kafka_bridge.kafka.statistics import Statistics
from ros2_kafka_bridge.kafka.tls import check_files

NOBODY = KafkaError(KafkaError._ALL_BROKERS_DOWN, '1/1 brokers are down')
NO_TOKEN = KafkaError(KafkaError._AUTHENTICATION, 'Failed to acquire SASL OAUTHBEARER token: 400')
REFUSED = KafkaError(
    KafkaError._AUTHENTICATION, 'SASL authentication error: Authentication failed'
)

REFUSED_BY_ONE = KafkaError(
    KafkaError._TRANSPORT,
    '127.0.0.1:27657/2: Connect to ipv4#127.0.0.1:27657 failed: Connection refused '
    '(after 0ms in state CONNECT, 1 identical error(s) suppressed)',
)
ONE_IS_UP = Statistics(None, knows_brokers=True, is_connected=True)
NONE_IS_UP = Statistics(None, knows_brokers=True, is_connected=False)


@pytest.fixture
def health() -> ClientHealth:
    log = logging.LoggerAdapter(logging.getLogger('health'), {})
    return ClientHealth('topic orders', log, Client('READ'))


@pytest.fixture
def clock_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now_s = [1000.0]
    monkeypatch.setattr(under_test, 'time', SimpleNamespace(monotonic=lambda: now_s[0]))
    return now_s


@pytest.fixture
def told(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO)
    return caplog


def test_an_outage_is_told_once_and_so_is_its_end(
    health: ClientHealth, told: pytest.LogCaptureFixture, clock_s: list[float]
) -> None:
    for _ in range(3):
        health.on_error(NOBODY)
        health.raise_failure()
        clock_s[0] += 1.5
    health.on_contact()
    health.on_contact()
    assert [line.split(';')[0] for line in told.messages] == [
        'Kafka is away: no broker answers',
        'Kafka is back',
    ]


def test_a_connection_that_is_made_anew_within_a_second_is_no_outage(
    health: ClientHealth, told: pytest.LogCaptureFixture, clock_s: list[float]
) -> None:
    health.on_error(NOBODY)
    assert health.away
    clock_s[0] += 0.9
    health.raise_failure()
    health.on_contact()
    assert not health.away
    assert told.messages == []


def test_the_cause_is_told_though_it_comes_after_that_nobody_answers(
    health: ClientHealth, told: pytest.LogCaptureFixture, clock_s: list[float]
) -> None:
    for error in (NOBODY, NOBODY, NO_TOKEN, NOBODY):
        health.on_error(error)
        health.raise_failure()
        clock_s[0] += 1.5
    assert len(told.messages) == 2
    assert 'sasl.oauthbearer.token.endpoint.url' in told.messages[1]
    assert 'OAUTHBEARER token' in health.away


def test_a_cause_that_comes_and_goes_is_told_once_a_minute(
    health: ClientHealth, told: pytest.LogCaptureFixture
) -> None:
    for _ in range(5):
        health.on_error(NO_TOKEN)
        health.raise_failure()
        health.on_contact()
    assert len(told.messages) == 2


def test_a_failure_is_raised_with_its_cure_and_that_nobody_answers_is_no_news(
    health: ClientHealth, told: pytest.LogCaptureFixture
) -> None:
    health.on_error(REFUSED)
    health.on_error(NOBODY)
    with pytest.raises(RouteError, match=r'check sasl\.username and sasl\.password$'):
        health.raise_failure()
    assert told.messages == []


def test_what_a_client_said_while_it_closed_is_not_held_against_the_next(
    health: ClientHealth,
) -> None:
    health.on_error(REFUSED)
    health.on_open()
    health.raise_failure()
    assert health.away == ''


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    there = tmp_path / 'ca.pem'
    there.touch()
    check_files(
        {'ssl.ca.location': str(there), 'https.ca.location': str(tmp_path)}, 'topic orders'
    )
    expected = f'topic orders: ssl.key.location: {tmp_path}/key: no such file'
    with pytest.raises(RouteError) as caught:
        check_files({'ssl.key.location': f'{tmp_path}/key'}, 'topic orders')
    assert str(caught.value) == expected


def test_a_certificate_that_is_half_written_fails_the_route_and_not_the_bridge(
    tmp_path: Path,
) -> None:
    file = tmp_path / 'ca.pem'
    file.write_text('-----BEGIN CERTIFICATE-----\nMIIB')
    properties = {
        'bootstrap.servers': '127.0.0.1:9',
        'security.protocol': 'SSL',
        'ssl.ca.location': str(file),
    }
    with pytest.raises(RouteError, match=r'the Kafka client: .*ssl'):
        Admin(properties, 'test')


def of_cluster(servers: str, *, reads: bool = True) -> ClientHealth:
    log = logging.LoggerAdapter(logging.getLogger('health'), {})
    client = Client('READ', {'bootstrap.servers': servers})
    return ClientHealth('topic orders', log, client, reads=reads)


def test_one_broker_of_several_that_does_not_answer_is_not_kafka_away(
    told: pytest.LogCaptureFixture, clock_s: list[float]
) -> None:
    health = of_cluster('first:9092')
    health.on_statistics(ONE_IS_UP)
    for _ in range(5):
        health.on_error(REFUSED_BY_ONE)
        health.on_statistics(ONE_IS_UP)
        health.raise_failure()
        clock_s[0] += 2
    assert health.away == ''
    [line] = told.messages
    assert line.startswith('a broker of the cluster does not answer: 127.0.0.1:27657/2: ')


def test_what_is_to_be_sent_may_wait_for_the_one_that_does_not_answer() -> None:
    health = of_cluster('first:9092', reads=False)
    health.on_statistics(ONE_IS_UP)
    health.on_error(REFUSED_BY_ONE)
    assert health.away


def test_kafka_is_away_where_the_next_report_shows_no_broker(clock_s: list[float]) -> None:
    health = of_cluster('first:9092')
    health.on_statistics(ONE_IS_UP)
    health.on_error(REFUSED_BY_ONE)
    assert health.away == ''
    clock_s[0] += 2
    health.on_statistics(NONE_IS_UP)
    assert health.away.startswith('Kafka is away: 127.0.0.1:27657/2: ')


def test_an_answer_of_bootstrap_servers_alone_does_not_bring_kafka_back(
    told: pytest.LogCaptureFixture, clock_s: list[float]
) -> None:
    """The broker names an address that does not answer: it was "back" 21 times in 42 s."""
    health = of_cluster('first:9092')
    health.on_error(REFUSED_BY_ONE)
    for _ in range(20):
        health.on_statistics(NONE_IS_UP)
        health.on_error(NOBODY)
        health.raise_failure()
        assert not health.ask(MagicMock(), 'orders', 0.5), 'list_topics answers'
        clock_s[0] += 2
    assert health.away
    assert not health.is_heard
    assert len(told.messages) == 1
    assert 'named 127.0.0.1:27657 as the address of a broker' in told.messages[0]
    assert 'identical' not in told.messages[0]
    health.on_statistics(ONE_IS_UP)
    assert health.ask(MagicMock(), 'orders', 0.5)
    assert told.messages[1:] == ['Kafka is back']


def test_the_address_of_bootstrap_servers_itself_is_no_matter_of_listeners() -> None:
    health = of_cluster('PLAINTEXT://127.0.0.1:27657')
    health.on_error(REFUSED_BY_ONE)
    assert 'advertised.listeners' not in health.away


def test_an_address_that_was_right_before_is_no_matter_of_listeners() -> None:
    """As where the broker behind a load balancer is started again."""
    health = of_cluster('first:9092')
    health.on_contact()
    health.on_error(REFUSED_BY_ONE)
    assert health.away
    assert 'advertised.listeners' not in health.away


def test_a_new_client_has_heard_nothing_yet() -> None:
    health = of_cluster('first:9092')
    assert (health.reached, health.is_heard) == (False, False)
    health.on_contact()
    assert (health.reached, health.is_heard) == (True, True)
    health.on_open()
    assert (health.reached, health.is_heard) == (True, False)
