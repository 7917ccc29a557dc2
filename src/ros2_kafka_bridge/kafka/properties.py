"""librdkafka's properties: whose they are, and which the bridge keeps for itself."""

from __future__ import annotations

import re
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from ros2_kafka_bridge.outside.files import file_problem, holds_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

PropertyValue = str | int | float | bool
Membership = Literal['static', 'dynamic']
"""Whether a member of a group has a name that it keeps through an outage (KIP-345), or none."""

_MEMBER_NAME: Final = 'group.instance.id'

LINGER_MS = 3.0
"""How long a record waits for others, where the user does not say and records come often.

One that comes alone is sent at once. Less makes many small requests, for which all have to wait.
"""

_CONNECTION: dict[str, PropertyValue] = {
    'reconnect.backoff.max.ms': 1000,
    # A network that comes back after 30 s of silence would be of no use for another 23 s: until
    # then TCP sends again what was lost, or connects, at intervals that double. Giving up early
    # and beginning anew finds it within 4 s.
    'socket.timeout.ms': 10000,
    'socket.connection.setup.timeout.ms': 10000,
}


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


CONSUMER_ONLY = _words(
    """
    auto.commit.enable auto.commit.interval.ms auto.offset.reset check.crcs
    consume.callback.max.messages consume_cb coordinator.query.interval.ms enable.auto.commit
    enable.auto.offset.store enable.partition.eof fetch.error.backoff.ms fetch.max.bytes
    fetch.message.max.bytes fetch.min.bytes fetch.queue.backoff.ms fetch.wait.max.ms group.id
    group.instance.id group.protocol group.protocol.type group.remote.assignor
    heartbeat.interval.ms isolation.level max.partition.fetch.bytes max.poll.interval.ms
    max.poll.records offset.store.method offset.store.path offset.store.sync.interval.ms
    offset_commit_cb on_commit partition.assignment.strategy queued.max.messages.kbytes
    queued.min.messages rebalance_cb session.timeout.ms share.acknowledgement.mode
    """
)
_PREFETCH = 'queued.max.messages.kbytes'
_PREFETCH_KBYTES = 8192

PRODUCER_ONLY = _words(
    """
    acks batch.num.messages batch.size compression.codec compression.level compression.type
    delivery.report.only.error delivery.timeout.ms dr_cb dr_msg_cb enable.gapless.guarantee
    enable.idempotence linger.ms message.send.max.retries message.timeout.ms msg_order_cmp
    on_delivery partitioner partitioner_cb produce.offset.report
    queue.buffering.backpressure.threshold queue.buffering.max.kbytes
    queue.buffering.max.messages queue.buffering.max.ms queuing.strategy request.required.acks
    request.timeout.ms retries sticky.partitioning.linger.ms transaction.timeout.ms
    transactional.id
    """
)
_COMMON = _words(
    """
    allow.auto.create.topics bootstrap.servers broker.address.family broker.address.ttl
    client.dns.lookup client.id client.rack connections.max.idle.ms debug enable.metrics.push
    enable.ssl.certificate.verification https.ca.location https.ca.pem log.connection.close
    log_level max.in.flight max.in.flight.requests.per.connection message.copy.max.bytes
    message.max.bytes metadata.broker.list metadata.max.age.ms metadata.recovery.strategy
    metadata.recovery.rebootstrap.trigger.ms receive.message.max.bytes
    reconnect.backoff.max.ms reconnect.backoff.ms retry.backoff.max.ms retry.backoff.ms
    sasl.kerberos.keytab sasl.kerberos.kinit.cmd sasl.kerberos.min.time.before.relogin
    sasl.kerberos.principal sasl.kerberos.service.name sasl.mechanism sasl.mechanisms
    sasl.oauthbearer.assertion.algorithm sasl.oauthbearer.assertion.file
    sasl.oauthbearer.assertion.jwt.template.file
    sasl.oauthbearer.assertion.private.key.file
    sasl.oauthbearer.assertion.private.key.passphrase
    sasl.oauthbearer.assertion.private.key.pem sasl.oauthbearer.client.id
    sasl.oauthbearer.client.secret sasl.oauthbearer.config sasl.oauthbearer.extensions
    sasl.oauthbearer.grant.type sasl.oauthbearer.metadata.authentication.type
    sasl.oauthbearer.method sasl.oauthbearer.scope sasl.oauthbearer.token.endpoint.url
    sasl.password sasl.username security.protocol socket.connection.setup.timeout.ms
    socket.keepalive.enable socket.nagle.disable socket.receive.buffer.bytes
    socket.send.buffer.bytes socket.timeout.ms ssl.ca.location ssl.ca.pem
    ssl.certificate.location ssl.certificate.pem ssl.cipher.suites ssl.crl.location
    ssl.curves.list ssl.endpoint.identification.algorithm ssl.engine.id ssl.engine.location
    ssl.key.location ssl.key.password ssl.key.pem ssl.keystore.location ssl.keystore.password
    ssl.providers ssl.sigalgs.list statistics.interval.ms topic.metadata.refresh.interval.ms
    """
)
KNOWN = CONSUMER_ONLY | PRODUCER_ONLY | _COMMON
"""Names that somebody may have meant."""

_TOPIC_LEVEL = _words(
    """
    acks auto.commit.enable auto.commit.interval.ms auto.offset.reset compression.codec
    compression.level compression.type consume.callback.max.messages delivery.timeout.ms
    enable.auto.commit message.timeout.ms offset.store.method offset.store.path
    offset.store.sync.interval.ms partitioner produce.offset.report queuing.strategy
    request.required.acks request.timeout.ms
    """
)
_ALIASES = {
    'auto.commit.enable': 'enable.auto.commit',
    'compression.codec': 'compression.type',
    'delivery.timeout.ms': 'message.timeout.ms',
    'fetch.message.max.bytes': 'max.partition.fetch.bytes',
    'max.in.flight.requests.per.connection': 'max.in.flight',
    'message.send.max.retries': 'retries',
    'metadata.broker.list': 'bootstrap.servers',
    'queue.buffering.max.ms': 'linger.ms',
    'request.required.acks': 'acks',
    'sasl.mechanism': 'sasl.mechanisms',
}
_FUNCTIONS = _words(
    """
    background_event_cb closesocket_cb connect_cb consume_cb default_topic_conf dr_cb dr_msg_cb
    error_cb interceptors log_cb logger msg_order_cmp oauth_cb oauthbearer_token_refresh_cb
    offset_commit_cb on_commit on_delivery opaque open_cb partitioner_cb rebalance_cb resolve_cb
    socket_cb ssl.certificate.verify_cb ssl_ca ssl_certificate ssl_engine_callback_data ssl_key
    stats_cb throttle_cb default.topic.config
    """
)
_REFUSED = {
    'group.id': "use 'group' in 'from' of a route: every route has a group of its own",
    'auto.offset.reset': "use 'start' in 'from' of a route: the bridge resolves it once itself",
    'enable.auto.commit': 'the bridge commits an offset itself, once its message is confirmed',
    'enable.auto.offset.store': 'the bridge stores an offset itself, once it is confirmed',
    'transactional.id': 'the bridge writes no transactions: ROS cannot take part in one',
    'delivery.report.only.error': 'the bridge needs the report of every record to confirm it',
    'group.instance.id': 'each client makes one of its own, or has none: see membership',
    'partition.assignment.strategy': 'the bridge needs cooperative-sticky',
    'enable.partition.eof': 'the end of a partition is no record that a route could move',
    'enabled_events': 'the bridge reads no event queue',
    'log.queue': 'the bridge reads no log queue: the log would be lost',
    'offset.store.method': 'offsets are kept by the consumer group in Kafka',
    'plugin.library.paths': 'the bridge loads no code of others into its clients: leave it out',
    'topic.blacklist': 'a route names its topic itself, and reads or writes no other',
    'internal.termination.signal': 'the signal would end the bridge, not a client: leave it out',
    'test.mock.num.brokers': 'the bridge would talk to brokers of its own: name real ones',
    'test.mock.broker.rtt': 'it is for brokers of a test inside the client: leave it out',
}
# librdkafka reads a name up to its first NUL: so it would be another one than was looked at.
_NAME = re.compile(r'[A-Za-z0-9._-]+')
_SECRET = re.compile(r'password|passphrase|secret|token|private\.key\.pem$|^basic\.auth\.')
_SECRET_NAMES = _words(
    """
    ssl.key.pem sasl.oauthbearer.config sasl.oauthbearer.extensions sasl.jaas.config
    sasl.kerberos.kinit.cmd
    """
)
_NO_SECRET = re.compile(r'token\.endpoint\.url$|\.location$|\.file$')

TOKEN_SOURCE: Final = 'sasl.oauthbearer.metadata.authentication.type'  # noqa: S105 (a name)
AWS: Final = 'aws_iam'
"""The one of these sources for which confluent-kafka loads code; it knows no other spelling."""

_CODE: Final = {
    'ssl.engine.location': '{value}: code of others, loaded',
    'ssl.providers': '{value}: code of others, loaded',
    'sasl.kerberos.kinit.cmd': 'a command of the shell, run',
    TOKEN_SOURCE: '{value}: boto3 is loaded, and asks AWS,',
}
_THEN: Final = 'where the bridge connects to Kafka (run, check --connect), never by a plain check'

_FOLDERS_TOO: Final = frozenset({'ssl.ca.location', 'https.ca.location'})
_FILES: Final = _FOLDERS_TOO | _words(
    """
    ssl.certificate.location ssl.key.location ssl.crl.location ssl.keystore.location
    sasl.oauthbearer.assertion.file sasl.oauthbearer.assertion.jwt.template.file
    sasl.oauthbearer.assertion.private.key.file
    """
)
_FILE_LIMIT_BYTES: Final = 16 * 1024 * 1024
_SHOWN_PATH_CHARS: Final = 255


def canonical(name: str) -> str:
    """The one spelling of a property that librdkafka knows by several."""
    name = name.removeprefix('topic.') if name.removeprefix('topic.') in _TOPIC_LEVEL else name
    return _ALIASES.get(name, name)


def is_secret(name: str) -> bool:
    """True for a property whose value must never be printed."""
    if _NO_SECRET.search(name):
        return False
    return name in _SECRET_NAMES or _SECRET.search(name.lower()) is not None


def refusal(name: str) -> str | None:
    """Why the bridge does not take this property from its users, None where it does."""
    if not _NAME.fullmatch(name):
        return 'no property has such a name'
    if canonical(name) in _FUNCTIONS:
        return 'it takes a function of a program, which a configuration cannot hold'
    return _REFUSED.get(canonical(name))


def runs_code(name: str, value: object) -> bool:
    """True for a property by which code of others runs as a client is made."""
    return name in _CODE and (name != TOKEN_SOURCE or value == AWS)


def code_of_others(properties: Mapping[str, PropertyValue]) -> Iterator[str]:
    """A sentence for each property by which code of others runs in the bridge."""
    for name, value in properties.items():
        if runs_code(name, value):
            yield f'{name}: {_CODE[name].format(value=value)} {_THEN}'


def file_fault(name: str, value: str) -> str | None:
    """Why librdkafka must not open what a property names, which could be a pipe.

    Returns:
        A sentence, without a value that may be a key; None where it may, or would open nothing.
    """
    if name not in _FILES or not value or (value == 'probe' and name in _FOLDERS_TOO):
        return None
    pem = re.sub(r'(location|file)$', 'pem', name)
    if holds_text(value) and pem in KNOWN:
        return f'holds the text of a file: that belongs in {pem}'
    problem = file_problem(Path(value), _FILE_LIMIT_BYTES, or_directory=name in _FOLDERS_TOO)
    is_shown = len(value) <= _SHOWN_PATH_CHARS and not holds_text(value)
    return f'{value}: {problem}' if problem and is_shown else problem


def is_consumers(name: str) -> bool:
    """True for a property that only a consumer has."""
    return _plain(name) in CONSUMER_ONLY


def is_producers(name: str) -> bool:
    """True for a property that only a producer has."""
    return _plain(name) in PRODUCER_ONLY


def common_properties(
    properties: Mapping[str, PropertyValue], *, client_id: str
) -> dict[str, PropertyValue]:
    """What every client takes, for one that neither consumes nor produces."""
    users = {n: v for n, v in properties.items() if not is_consumers(n) and not is_producers(n)}
    return _merged({'client.id': client_id, **_CONNECTION}, users)


def consumer_properties(
    properties: Mapping[str, PropertyValue], *, group: str, client_id: str
) -> dict[str, PropertyValue]:
    """The user's properties without the producer's, and what the bridge needs of a consumer.

    Args:
        properties: By librdkafka's names, as the user wrote them.
        group: The consumer group.
        client_id: Used where the user gives no `client.id`.
    """
    users = {n: v for n, v in properties.items() if not is_producers(n)}
    own: dict[str, PropertyValue] = {
        'client.id': client_id,
        **_CONNECTION,
        _PREFETCH: _PREFETCH_KBYTES,
        # Fetching rests for so long once the prefetch is full: the default is a whole second.
        'fetch.queue.backoff.ms': 10,
        'topic.metadata.refresh.interval.ms': 10000,
    }
    if is_classic(users):
        own |= {
            'session.timeout.ms': 6000,
            'heartbeat.interval.ms': 2000,
            'partition.assignment.strategy': 'cooperative-sticky',
        }
    return _merged(own, users) | {
        'group.id': group,
        'enable.auto.commit': 'false',
        'enable.auto.offset.store': 'false',
        'auto.offset.reset': 'error',
    }


def prefetch_bytes(properties: Mapping[str, Any]) -> int:
    """How much a consumer reads ahead; its client refuses what is no number."""
    kbytes = str(properties.get(_PREFETCH, _PREFETCH_KBYTES)).strip()
    return 1024 * (int(kbytes) if kbytes.isdecimal() else _PREFETCH_KBYTES)


def is_classic(properties: Mapping[str, Any]) -> bool:
    """Whether the members of a group agree among themselves, by way of one of them.

    The other protocol is that of KIP-848, where the broker decides. librdkafka reads a value from
    its first character that is no space, in any case.
    """
    return str(properties.get('group.protocol', 'classic')).lstrip().lower() == 'classic'


def member_name(properties: Mapping[str, Any], membership: Membership) -> dict[str, str]:
    """The property of a member's name, new with each call; none where it is to have none.

    A broker that decides itself (KIP-848) waits for a member with a name that has left until its
    session ends, which is 45 s by default, and gives the name to no other before.
    """
    if membership == 'dynamic' or not is_classic(properties):
        return {}
    return {_MEMBER_NAME: uuid.uuid4().hex}


def producer_properties(
    properties: Mapping[str, PropertyValue], *, client_id: str
) -> dict[str, PropertyValue]:
    """The user's properties without the consumer's, and what the bridge needs of a producer.

    Weaker `acks` of the user turn idempotence off, which librdkafka allows with `all` only.

    Args:
        properties: By librdkafka's names, as the user wrote them.
        client_id: Used where the user gives no `client.id`.
    """
    users = {n: v for n, v in properties.items() if not is_consumers(n)}
    own: dict[str, PropertyValue] = {
        'client.id': client_id,
        **_CONNECTION,
        'acks': 'all',
        'enable.idempotence': 'false' if has_weak_acks(users) else 'true',
        'message.timeout.ms': 0,
        'linger.ms': LINGER_MS,
    }
    return _merged(own, users)


def has_weak_acks(properties: Mapping[str, PropertyValue]) -> bool:
    """True where the properties ask for fewer acknowledgements than all replicas' in sync."""
    acks = [v for n, v in properties.items() if canonical(n) == 'acks']
    return bool(acks) and str(acks[-1]).lower() not in {'all', '-1'}


def _plain(name: str) -> str:
    short = name.removeprefix('topic.')
    return short if short in _TOPIC_LEVEL else name


def plain_value(value: object) -> PropertyValue:
    """The value as librdkafka takes it, who knows neither `True` nor `1e3`."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, str | int | float) else str(value)


def _merged(
    own: Mapping[str, PropertyValue], users: Mapping[str, PropertyValue]
) -> dict[str, PropertyValue]:
    given = {canonical(name) for name in users}
    kept = {name: value for name, value in own.items() if canonical(name) not in given}
    return kept | {name: plain_value(value) for name, value in users.items()}
