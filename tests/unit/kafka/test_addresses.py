"""Lists of brokers: what librdkafka makes no broker of, or another, is refused."""

import pytest

from ros2_kafka_bridge.kafka.addresses import broker_in, listed, servers_problem


@pytest.mark.parametrize(
    'servers',
    [
        'kafka:9092', 'kafka', ' a:1 , b:2 ', 'a:1,,b', ',a:1', 'a: 9092', 'a:1/', 'a:1/path',
        ':9092', 'PLAINTEXT://a:1', 'plaintext://a', 'PLAINTEXT://:1', '[::1]:9092', '[::1]',
        '::1', 'fe80::1', 'PLAINTEXT://::1',
    ],
)  # fmt: skip
def test_what_librdkafka_reads_as_it_was_meant_is_taken(servers: str) -> None:
    assert servers_problem(servers, 'plaintext') == ''


@pytest.mark.parametrize(
    ('servers', 'problem'),
    [
        ('http://host:9092', "'http://host:9092' begins with http://"),
        ('good:9092,https://host', "'https://host' begins with https://"),
        ('SSL://host:9093', "'SSL://host:9093' says SSL, and security.protocol is plaintext"),
        (' ', 'names no broker'),
        (' , ', 'names no broker'),
        ('PLAINTEXT://', 'names no host'),
        ('host:', 'no port'),
        ('host:0', 'no port'),
        ('host:abc', 'no port'),
        ('host:99999', 'no port'),
        ('host:-1', 'no port'),
        ('host:²', 'no port'),
        ('host:１', 'no port'),  # noqa: RUF001 (a digit of another script)
        ('host:9092abc', 'no port'),
        ('a;b', 'no host:port'),
        ('a:9092 b:9092', 'no host:port'),
        ('a:1:2', 'no host:port'),
        ('PLAINTEXT//host:1', 'no host:port'),
        ('host/:1', 'no host:port'),
        ('user@host:1', 'no host:port'),
        ('host :1', 'no host:port'),
        ('[::1', 'no host:port'),
    ],
)
def test_what_yields_no_broker_or_another_is_refused_and_named(servers: str, problem: str) -> None:
    assert problem in servers_problem(servers, 'plaintext')


def test_a_protocol_is_compared_only_where_it_is_known() -> None:
    assert servers_problem('SASL_SSL://host:9093') == ''
    assert servers_problem('sasl_ssl://host:9093', 'SASL_SSL') == ''


def test_addresses_are_listed_as_the_client_takes_them() -> None:
    assert listed('A:1, PLAINTEXT://b, [::1]:3,') == {'a:1', 'b:9092', '[::1]:3'}


@pytest.mark.parametrize(
    ('text', 'address', 'is_learned'),
    [
        ("nosuch.invalid:9092/1: Failed to resolve 'nosuch.invalid:9092'", 'nosuch.invalid', True),
        ('GroupCoordinator: 127.0.0.1:2765: Connect to ipv4#', '127.0.0.1:2765', True),
        ('ssl://Kafka:9093/0: SSL handshake failed', 'kafka:9093', True),
        ('127.0.0.1:28918/bootstrap: Connect to ipv4#', '127.0.0.1:28918', False),
    ],
)
def test_an_error_tells_which_broker_it_is_about(
    text: str, address: str, *, is_learned: bool
) -> None:
    broker = broker_in(text)
    assert broker is not None
    assert (broker.address.startswith(address), broker.is_learned) == (True, is_learned)


def test_an_error_of_all_brokers_is_about_none() -> None:
    assert broker_in('1/1 brokers are down') is None
    assert broker_in('Local: Broker transport failure') is None
