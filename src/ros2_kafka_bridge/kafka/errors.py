"""One table that says for every Kafka error what is done about it."""

import logging
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from confluent_kafka import KafkaError

from ros2_kafka_bridge.errors import BridgeError, RecordError, RouteError, TransportError

_RECORD = """
    INVALID_MSG_SIZE INVALID_RECORD INVALID_TIMESTAMP MSG_SIZE_TOO_LARGE RECORD_LIST_TOO_LARGE
    _BAD_COMPRESSION _BAD_MSG _INVALID_DIFFERENT_RECORD _KEY_DESERIALIZATION _KEY_SERIALIZATION
    _VALUE_DESERIALIZATION _VALUE_SERIALIZATION
"""

_WAIT = """
    BROKER_NOT_AVAILABLE COORDINATOR_LOAD_IN_PROGRESS COORDINATOR_NOT_AVAILABLE
    ELIGIBLE_LEADERS_NOT_AVAILABLE FENCED_LEADER_EPOCH FETCH_SESSION_ID_NOT_FOUND
    FENCED_MEMBER_EPOCH ILLEGAL_GENERATION INVALID_FETCH_SESSION_EPOCH INVALID_MSG
    INCONSISTENT_TOPIC_ID KAFKA_STORAGE_ERROR LEADER_NOT_AVAILABLE LOG_DIR_NOT_FOUND
    MEMBER_ID_REQUIRED NETWORK_EXCEPTION NOT_CONTROLLER NOT_COORDINATOR NOT_ENOUGH_REPLICAS
    NOT_ENOUGH_REPLICAS_AFTER_APPEND NOT_LEADER_FOR_PARTITION NO_ERROR OFFSET_NOT_AVAILABLE
    PREFERRED_LEADER_NOT_AVAILABLE REASSIGNMENT_IN_PROGRESS REBALANCE_IN_PROGRESS
    REBOOTSTRAP_REQUIRED REPLICA_NOT_AVAILABLE REQUEST_TIMED_OUT STALE_BROKER_EPOCH
    STALE_CTRL_EPOCH STALE_MEMBER_EPOCH THROTTLING_QUOTA_EXCEEDED UNKNOWN_LEADER_EPOCH
    UNKNOWN_MEMBER_ID UNKNOWN_TOPIC_ID UNSTABLE_OFFSET_COMMIT _ALL_BROKERS_DOWN _ASSIGNMENT_LOST
    _DESTROY_BROKER _INTR _IN_PROGRESS _ISR_INSUFF _LOG_TRUNCATION _MAX_POLL_EXCEEDED
    _MSG_TIMED_OUT _NODE_UPDATE _NOOP _NO_OFFSET _OUTDATED _PARTIAL _PARTITION_EOF
    _PREV_IN_PROGRESS _PURGE_INFLIGHT _PURGE_QUEUE _QUEUE_FULL _RESOLVE _RETRY _TIMED_OUT
    _TIMED_OUT_QUEUE _TRANSPORT _UNDERFLOW _WAIT_CACHE _WAIT_COORD _ASSIGN_PARTITIONS
    _REVOKE_PARTITIONS
"""

_ROUTE = """
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

_CURES = {
    'TOPIC_AUTHORIZATION_FAILED': 'give this user the permission on the topic (ACL)',
    'GROUP_AUTHORIZATION_FAILED': 'give this user READ on the consumer group (ACL)',
    'CLUSTER_AUTHORIZATION_FAILED': 'give this user IDEMPOTENT_WRITE on the cluster (ACL)',
    'SASL_AUTHENTICATION_FAILED': 'check sasl.username and sasl.password',
    '_AUTHENTICATION': 'check the sasl.* properties of this bridge',
    '_SSL': 'check the ssl.* properties of this bridge',
    'UNKNOWN_TOPIC_OR_PART': 'create the topic',
    '_UNKNOWN_TOPIC': 'create the topic',
    '_UNKNOWN_PARTITION': 'create the topic',
}


def _by_code(names: str) -> dict[int, str]:
    return {getattr(KafkaError, n): n for n in names.split() if hasattr(KafkaError, n)}


_NAMES: Final = _by_code(_RECORD + _WAIT + _ROUTE)

ERROR_CLASSES: Final[Mapping[int, type[BridgeError]]] = MappingProxyType(
    dict.fromkeys(_by_code(_RECORD), RecordError)
    | dict.fromkeys(_by_code(_WAIT), TransportError)
    | dict.fromkeys(_by_code(_ROUTE), RouteError)
)
"""What each error code means: bad record, wait, or route failed."""


def translate(error: KafkaError, where: str) -> BridgeError:
    """Make the bridge's error of a Kafka error; `where` names topic, partition or client.

    A code that a newer librdkafka adds is a RouteError: the route says so and tries again.
    """
    if error.fatal():
        return RouteError(f'{where}: the Kafka client gave up: {error.str()}')
    name = _NAMES.get(error.code(), error.name())
    cure = f'; {_CURES[name]}' if name in _CURES else ''
    return ERROR_CLASSES.get(error.code(), RouteError)(f'{where}: {error.str()}{cure}')


class ClientHealth:
    """Keeps what a client says of itself in its error callback, for the route's own thread.

    Used by the thread that polls the client: librdkafka calls back from there.
    """

    def __init__(self, where: str, log: logging.LoggerAdapter[logging.Logger]) -> None:
        self._where = where
        self._log = log
        self._failure: BridgeError | None = None
        self.away = ''

    def on_error(self, error: KafkaError) -> None:
        """Take an error of the client (librdkafka's error callback)."""
        problem = translate(error, self._where)
        if isinstance(problem, RouteError):
            self._failure = problem
        elif isinstance(problem, TransportError) and not self.away:
            self.away = f'Kafka is away: {error.str()}'
            self._log.warning('%s; trying again until it is back', self.away)

    def on_contact(self) -> None:
        """Note that the broker has answered."""
        if self.away:
            self.away = ''
            self._log.info('Kafka is back')

    def raise_failure(self) -> None:
        """Raise what made the client useless, if anything did."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
