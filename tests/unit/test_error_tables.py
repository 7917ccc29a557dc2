"""Every foreign error is in one table, so that a route always knows what to do (guarantee 5)."""

from collections import Counter
from pathlib import Path

import pytest
from confluent_kafka import KafkaError
from rclpy import exceptions
from rclpy.impl.implementation_singleton import rclpy_implementation
from ruamel.yaml import YAML

from ros2_kafka_bridge.errors import (
    BridgeError,
    ConfigError,
    RecordError,
    RouteError,
    TransportError,
)
from ros2_kafka_bridge.kafka import errors as kafka
from ros2_kafka_bridge.kafka.cures import CURES
from ros2_kafka_bridge.ros import errors as ros

SEEN = YAML(typ='safe').load(Path(__file__).with_name('kafka_said.yaml'))

# What is in no table of the bridge, by a decision: whoever adds a code here has looked at it.
FAILS_THE_ROUTE = """
    CLUSTER_AUTHORIZATION_FAILED CONCURRENT_TRANSACTIONS DELEGATION_TOKEN_AUTHORIZATION_FAILED
    DELEGATION_TOKEN_AUTH_DISABLED DELEGATION_TOKEN_EXPIRED DELEGATION_TOKEN_NOT_FOUND
    DELEGATION_TOKEN_OWNER_MISMATCH DELEGATION_TOKEN_REQUEST_NOT_ALLOWED
    DUPLICATE_RESOURCE DUPLICATE_SEQUENCE_NUMBER DUPLICATE_VOTER ELECTION_NOT_NEEDED
    FEATURE_UPDATE_FAILED FENCED_INSTANCE_ID FENCED_STATE_EPOCH GROUP_AUTHORIZATION_FAILED
    GROUP_ID_NOT_FOUND GROUP_MAX_SIZE_REACHED GROUP_SUBSCRIBED_TO_TOPIC ILLEGAL_SASL_STATE
    INCONSISTENT_GROUP_PROTOCOL INCONSISTENT_VOTER_SET INVALID_COMMIT_OFFSET_SIZE INVALID_CONFIG
    INVALID_GROUP_ID INVALID_PARTITIONS INVALID_PRINCIPAL_TYPE INVALID_PRODUCER_EPOCH
    INVALID_PRODUCER_ID_MAPPING INVALID_RECORD_STATE INVALID_REGISTRATION
    INVALID_REGULAR_EXPRESSION INVALID_REPLICATION_FACTOR INVALID_REPLICA_ASSIGNMENT
    INVALID_REQUEST INVALID_REQUIRED_ACKS INVALID_SESSION_TIMEOUT INVALID_SHARE_SESSION_EPOCH
    INVALID_TRANSACTION_TIMEOUT INVALID_TXN_STATE INVALID_UPDATE_VERSION INVALID_VOTER_KEY
    LISTENER_NOT_FOUND MISMATCHED_ENDPOINT_TYPE NON_EMPTY_GROUP NO_REASSIGNMENT_IN_PROGRESS
    OFFSET_METADATA_TOO_LARGE OFFSET_OUT_OF_RANGE OPERATION_NOT_ATTEMPTED
    OUT_OF_ORDER_SEQUENCE_NUMBER POLICY_VIOLATION PRINCIPAL_DESERIALIZATION_FAILURE
    PRODUCER_FENCED RESOURCE_NOT_FOUND SASL_AUTHENTICATION_FAILED SECURITY_DISABLED
    SHARE_SESSION_LIMIT_REACHED SHARE_SESSION_NOT_FOUND STREAMS_INVALID_TOPOLOGY
    STREAMS_INVALID_TOPOLOGY_EPOCH STREAMS_TOPOLOGY_FENCED TELEMETRY_TOO_LARGE
    TOPIC_ALREADY_EXISTS TOPIC_AUTHORIZATION_FAILED TOPIC_DELETION_DISABLED TOPIC_EXCEPTION
    TRANSACTIONAL_ID_AUTHORIZATION_FAILED TRANSACTION_ABORTABLE TRANSACTION_COORDINATOR_FENCED
    UNACCEPTABLE_CREDENTIAL UNKNOWN UNKNOWN_CONTROLLER_ID UNKNOWN_PRODUCER_ID
    UNKNOWN_SUBSCRIPTION_ID UNKNOWN_TOPIC_OR_PART UNRELEASED_INSTANCE_ID UNSUPPORTED_ASSIGNOR
    UNSUPPORTED_COMPRESSION_TYPE UNSUPPORTED_ENDPOINT_TYPE UNSUPPORTED_FOR_MESSAGE_FORMAT
    UNSUPPORTED_SASL_MECHANISM UNSUPPORTED_VERSION VOTER_NOT_FOUND _APPLICATION _AUTHENTICATION
    _AUTO_OFFSET_RESET _CONFLICT _CRIT_SYS_RESOURCE _DESTROY _EXISTING_SUBSCRIPTION _FAIL _FATAL
    _FENCED _FS _GAPLESS_GUARANTEE _INCONSISTENT _INVALID_ARG _INVALID_TYPE _NOENT
    _NOT_CONFIGURED _NOT_IMPLEMENTED _READ_ONLY _SSL _STATE _UNKNOWN_BROKER _UNKNOWN_GROUP
    _UNKNOWN_PARTITION _UNKNOWN_PROTOCOL _UNKNOWN_TOPIC _UNSUPPORTED_FEATURE
"""


def kafka_codes() -> dict[str, int]:
    """Every error code that this librdkafka knows, by its name."""
    names = {name: getattr(KafkaError, name) for name in dir(KafkaError)}
    return {name: code for name, code in names.items() if isinstance(code, int)}


def rclpy_errors() -> set[str]:
    """Every exception class of rclpy."""
    return {
        name
        for module in (exceptions, rclpy_implementation)
        for name, kind in vars(module).items()
        if isinstance(kind, type) and issubclass(kind, Exception)
    }


def test_every_code_of_kafka_is_in_the_table_once() -> None:
    listed = Counter((kafka._RECORD + kafka._WAIT + FAILS_THE_ROUTE).split())
    assert {name for name, count in listed.items() if count > 1} == set()
    assert kafka_codes().keys() - listed.keys() == set()
    others = {code for name, code in kafka_codes().items() if name not in FAILS_THE_ROUTE.split()}
    assert kafka.ERROR_CLASSES.keys() == others


def test_a_code_that_stands_in_no_table_fails_the_route() -> None:
    codes = [kafka_codes()[name] for name in FAILS_THE_ROUTE.split() if name in kafka_codes()]
    kinds = {kafka.explain(KafkaError(code)).kind for code in codes}
    assert kinds == {RouteError}
    assert all(KafkaError(code).name() == name for name, code in kafka_codes().items())


@pytest.mark.parametrize(
    ('code', 'kind'),
    [
        (KafkaError.MSG_SIZE_TOO_LARGE, RecordError),
        (KafkaError._ALL_BROKERS_DOWN, TransportError),
        (KafkaError.NOT_ENOUGH_REPLICAS, TransportError),
        (KafkaError.TOPIC_AUTHORIZATION_FAILED, RouteError),
        (KafkaError.UNKNOWN_TOPIC_OR_PART, RouteError),
        (99_999, RouteError),  # of a newer librdkafka
    ],
)
def test_a_code_of_kafka_is_translated_with_its_place(code: int, kind: type[BridgeError]) -> None:
    found = kafka.translate(KafkaError(code), 'topic orders')
    assert type(found) is kind
    assert str(found).startswith('topic orders: ')


@pytest.mark.parametrize('seen', SEEN, ids=lambda seen: str(seen['cure'][:30] or 'none'))
def test_what_a_user_can_cure_is_said_with_the_cure(seen: dict[str, str]) -> None:
    error = KafkaError(kafka_codes()[seen['code']], seen['said'])
    found = kafka.translate(error, 'topic orders', kafka.Client('READ'))
    assert type(found).__name__ == seen['kind']
    _, _, told = str(found).partition('; ')
    assert told.startswith(seen['cure'])
    assert bool(told) == bool(seen['cure'])
    assert 'in state' not in str(found)
    assert str(found).count('unavailable') <= 1


@pytest.mark.parametrize(
    ('reason', 'cure'),
    [
        ('certificate has expired', 'renew the certificate of the broker'),
        (
            "IP address mismatch, certificate is not valid for '127.0.0.1'",
            'write the host in bootstrap.servers as the certificate of the broker names it',
        ),
        ('self-signed certificate in certificate chain', 'ssl.ca.location must name'),
        ('unable to get local issuer certificate', 'ssl.ca.location must name'),
    ],
)
def test_the_cure_of_distrust_follows_its_reason(reason: str, cure: str) -> None:
    said = 'ssl://b:9093/1: SSL handshake failed: error:0A: certificate verify failed: broker ...'
    found = kafka.explain(KafkaError(KafkaError._SSL, said), reason=reason)
    assert found.text == f'b:9093: certificate verify failed: {reason} (broker)'
    assert found.cure.startswith(cure)
    assert found.kind is RouteError


def test_every_cure_is_for_codes_that_there_are() -> None:
    named = {name for cure in CURES for name in cure.codes.split()}
    assert named <= kafka_codes().keys()


def test_a_fatal_error_of_the_client_fails_the_route() -> None:
    error = KafkaError(KafkaError._TRANSPORT, 'broken', True)  # noqa: FBT003 (its signature)
    assert type(kafka.translate(error, 'topic orders')) is RouteError


def test_every_exception_of_rclpy_is_in_the_table() -> None:
    assert rclpy_errors() == ros.ERROR_CLASSES.keys()


def test_an_exception_of_rclpy_is_translated_without_the_place_in_its_source() -> None:
    error = rclpy_implementation.RCLError('cannot, at /project/src/publisher.cpp:115')
    with (
        pytest.raises(RouteError, match=r'^publisher of /x: cannot$'),
        ros.translated('publisher of /x'),
    ):
        raise error
    name = exceptions.InvalidTopicNameException('1x', 'no digit', 0)
    with pytest.raises(ConfigError), ros.translated('publisher of 1x'):
        raise name


def test_a_bug_is_not_translated() -> None:
    with pytest.raises(TypeError, match='a bug'), ros.translated('publisher of /x'):
        raise TypeError('a bug')
