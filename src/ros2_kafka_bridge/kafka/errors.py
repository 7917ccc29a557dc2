"""One table that says for every Kafka error what is done about it."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.errors import BridgeError, RecordError, RouteError, TransportError
from ros2_kafka_bridge.kafka.addresses import NamedBroker, broker_in, listed
from ros2_kafka_bridge.kafka.cures import CURES, Cure
from ros2_kafka_bridge.kafka.properties import is_secret
from ros2_kafka_bridge.kafka.tls import address_in, distrust
from ros2_kafka_bridge.kafka.tls_files import refused_file
from ros2_kafka_bridge.outside.masking import MASK, finding, login, masked_address

_SHORTEST_SECRET: Final = 4  # one letter would hide half of what is said

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


def _codes(names: str) -> list[int]:
    return [getattr(KafkaError, name) for name in names.split() if hasattr(KafkaError, name)]


ERROR_CLASSES: Final[Mapping[int, type[BridgeError]]] = MappingProxyType(
    dict.fromkeys(_codes(_RECORD), RecordError) | dict.fromkeys(_codes(_WAIT), TransportError)
)
"""What an error code means, bad record or wait; any other one: the route has failed."""


_NOBODY: Final = '_ALL_BROKERS_DOWN'
_UNREACHED: Final = frozenset({'_RESOLVE', '_TRANSPORT'})
_ADVERTISED: Final = (
    'Kafka answered at bootstrap.servers ({servers}) and named {address} as the address of a '
    'broker: if that runs, mend its advertised.listeners, or make that address known here'
)
_NO_CURE: Final = Cure('', '', '')
_DISTRUST: Final = 'certificate verify failed'
_STATE = re.compile(r' \(after \d+ms in state \w+(?:, \d+ identical error\(s\) suppressed)?\)')
_REPEATED = re.compile(r'(\{.*?\})\1+')


class Problem(NamedTuple):
    """An error in words, what to do about it, and what it means.

    Args:
        text: What has happened.
        cure: What to do about it; empty where nobody knows.
        kind: What the bridge does about it.
        names_cause: Whether it says why, and not only that nobody answers.
        is_of_one: Whether it is about the way to one broker: others may be there.
    """

    text: str
    cure: str
    kind: type[BridgeError]
    names_cause: bool
    is_of_one: bool = False

    @property
    def sentence(self) -> str:
        """Both in one."""
        return f'{self.text}; {self.cure}' if self.cure else self.text


class Client(NamedTuple):
    """What an error does not tell of the client that it comes from.

    Args:
        right: The operation on the topic that it needs.
        properties: Its librdkafka properties.
        is_reached: Whether it has been connected to a broker of the cluster: then the addresses
            that this gives are right.
    """

    right: str = 'READ and WRITE'
    properties: Mapping[str, Any] = MappingProxyType({})
    is_reached: bool = False


UNKNOWN_CLIENT: Final = Client()


def translate(error: KafkaError, where: str, client: Client = UNKNOWN_CLIENT) -> BridgeError:
    """Make the bridge's error of a Kafka error; `where` names topic, partition or client.

    A broker whose certificate was not trusted is asked for it again, to say why: that takes up
    to twenty seconds. A code that a newer librdkafka adds is a RouteError: the route says so and
    tries again.
    """
    problem = explain(error, client, _reason_of_distrust(error, client))
    return problem.kind(f'{where}: {problem.sentence}')


@contextmanager
def translated(where: str, client: Client = UNKNOWN_CLIENT) -> Iterator[None]:
    """Make the bridge's error of what Kafka's client raises: see `translate`."""
    try:
        yield
    except KafkaException as error:
        raise translate(error.args[0], where, client) from error


def is_missing_topic(error: KafkaError) -> bool:
    """Whether a broker says that a topic is not there, or hides it from this user."""
    return error.code() == KafkaError.UNKNOWN_TOPIC_OR_PART


def explain(error: KafkaError, client: Client = UNKNOWN_CLIENT, reason: str = '') -> Problem:
    """Say an error in words, with its cure; `reason` tells why a certificate is not trusted."""
    name = error.name()
    text = _words(error.str(), name, client, reason)
    found = next((cure for cure in CURES if _fits(cure, name, text)), _NO_CURE)
    broker = broker_in(error.str()) if name in _UNREACHED else None
    cure = _of_wrong_address(broker, client) or found.text.format(right=client.right)
    names_cause = bool(cure) and name != _NOBODY and not found.passes
    if error.fatal():
        return Problem(f'the Kafka client gave up: {text}', cure, RouteError, names_cause)
    kind = found.kind or ERROR_CLASSES.get(error.code(), RouteError)
    return Problem(text, cure, kind, names_cause, broker is not None)


def _fits(cure: Cure, name: str, text: str) -> bool:
    return name in cure.codes.split() and re.search(cure.words, text) is not None


def _of_wrong_address(broker: NamedBroker | None, client: Client) -> str:
    """What to do where a broker is not at the address that the cluster gives for it.

    Empty where that is an address of bootstrap.servers, or one that was right before.
    """
    servers = str(client.properties.get('bootstrap.servers', ''))
    if broker is None or not broker.is_learned or client.is_reached:
        return ''
    if not servers or broker.address in listed(servers):
        return ''
    return _ADVERTISED.format(servers=servers, address=broker.address)


def _words(text: str, name: str, client: Client, reason: str) -> str:
    if name == _NOBODY:
        return 'no broker answers'  # librdkafka counts also those that it no longer needs
    if _DISTRUST in text:
        address = address_in(text)
        who = f'{address.host}:{address.port}: ' if address else ''
        return f'{who}{_DISTRUST}' + (f': {reason} (broker)' if reason else '')
    if refused := refused_file(text, client.properties):
        return f'{refused.name}: {refused.problem}'
    text = _REPEATED.sub(r'\1', _STATE.sub('', text))
    text = _finding(client.properties).sub(MASK, text)  # whoever refuses them may repeat them
    url = str(client.properties.get('sasl.oauthbearer.token.endpoint.url', ''))
    shown = masked_address(url)
    text = text.replace(url, shown) if url else text
    return f'{text} ({shown})' if url and 'OAUTHBEARER token' in text else text


def _finding(properties: Mapping[str, Any]) -> re.Pattern[str]:
    secrets = [str(value) for name, value in properties.items() if is_secret(name)]
    long = [secret for secret in secrets if len(secret) >= _SHORTEST_SECRET]
    return finding(long, [login(properties, 'sasl.oauthbearer')])


def _reason_of_distrust(error: KafkaError, client: Client) -> str:
    address = address_in(error.str()) if _DISTRUST in error.str() else None
    return distrust(address, client.properties) if address and client.properties else ''
