"""What a command says of a cluster that it gets no answer from, or one that it does not like."""

import pytest
from confluent_kafka import KafkaError

from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError
from ros2_kafka_bridge.kafka.cause import ClientErrors

NO_METADATA = KafkaError(KafkaError._TRANSPORT, 'Failed to get metadata')


@pytest.mark.parametrize(
    ('code', 'said', 'kind', 'begins'),
    [
        (
            KafkaError._AUTHENTICATION,
            'SASL authentication error: Authentication failed: Invalid username or password',
            RouteError,
            'Kafka refuses the login: SASL',
        ),
        (
            KafkaError._AUTHENTICATION,
            "SASL PLAIN mechanism handshake failed: Broker: Unsupported SASL mechanism: broker's",
            RouteError,
            'Kafka refuses the login: SASL',
        ),
        (
            KafkaError._AUTHENTICATION,
            'Failed to acquire SASL OAUTHBEARER token: {}',
            TransportError,
            'no login to Kafka: Failed to acquire',
        ),
        (
            KafkaError._AUTHENTICATION,
            'SASL PLAIN handshake failed: Broker: Request not valid in current SASL state',
            TransportError,
            'no login to Kafka: SASL',
        ),
        (
            KafkaError._SSL,
            'SSL handshake failed: error:0A000086:SSL routines::certificate verify failed',
            RouteError,
            'no connection to Kafka: certificate verify failed',
        ),
        (
            KafkaError._TRANSPORT,
            'Receive failed: error:0A000412:SSL routines::ssl/tls alert bad certificate',
            RouteError,
            'no connection to Kafka: Receive failed',
        ),
        (
            KafkaError._TRANSPORT,
            'Disconnected: SSL connection closed by peer: connecting to a PLAINTEXT listener?',
            TransportError,
            'no connection to Kafka: Disconnected',
        ),
        (
            KafkaError._ALL_BROKERS_DOWN,
            '1/1 brokers are down',
            TransportError,
            'the broker does not answer: no broker answers; does it run',
        ),
    ],
)
def test_a_cluster_that_answers_otherwise_is_not_said_to_be_silent(
    code: int, said: str, kind: type[BridgeError], begins: str
) -> None:
    cause = ClientErrors({})
    cause.note(KafkaError(code, said))
    error = cause.translated(NO_METADATA)
    assert type(error) is kind
    assert str(error).startswith(begins)
    assert str(cause.translated(NO_METADATA, 'topic a')).startswith('topic a: ')


def test_what_a_broker_refuses_needs_no_other_cause() -> None:
    cause = ClientErrors({})
    cause.note(KafkaError(KafkaError._ALL_BROKERS_DOWN, '1/2 brokers are down'))
    refused = KafkaError(KafkaError.CLUSTER_AUTHORIZATION_FAILED)
    assert str(cause.translated(refused)).startswith('Kafka refuses: ')
