"""One table that says for a Kafka error what a person can do about it."""

from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError


class Cure(NamedTuple):
    """What to do about an error, known by its code and by words in its text.

    Args:
        codes: Names of codes, any where it is empty.
        words: A pattern that the text holds.
        text: What to do; `{right}` is the operation on the topic that the client needs.
        kind: What the error means, None where its code tells.
        passes: Whether it mostly passes by itself: then it is no cause until it stays.
    """

    codes: str
    words: str
    text: str
    kind: type[BridgeError] | None = None
    passes: bool = False


OWN_GROUP: Final = 'give this route a group of its own (group in from), or leave group out'
"""What to do about a group that is another application's."""

_FOREIGN_GROUP: Final = (
    'the group is that of another application, whose members share partitions in another way: '
    f'{OWN_GROUP}'
)

# The first that fits. librdkafka gives some errors of TLS and SASL a code that says `wait`, and
# some that mend themselves one that does not.
CURES: Final = (
    Cure(
        '_FAIL _TRANSPORT',
        r'Too many open files',
        'raise the limit of open files of the bridge (ulimit -Hn, LimitNOFILE of systemd)',
    ),
    Cure(
        '_SSL _TRANSPORT',
        r'expired \(broker\)',
        'renew the certificate of the broker',
        RouteError,
    ),
    Cure(
        '_SSL _TRANSPORT',
        r'not valid for .* \(broker\)',
        'write the host in bootstrap.servers as the certificate of the broker names it, or give '
        'the broker a certificate for this host; advertised.listeners of the broker counts too',
        RouteError,
    ),
    Cure(
        '_SSL _TRANSPORT',
        r'certificate verify failed',
        'ssl.ca.location must name the authority that has signed the certificate of the broker',
        RouteError,
    ),
    Cure(
        '_SSL _TRANSPORT',
        r'alert (?:bad certificate|certificate|unknown ca|handshake failure|access denied)',
        'the broker refuses the certificate of this bridge: ssl.certificate.location and '
        'ssl.key.location must name one that has not expired, signed by an authority that the '
        'broker trusts',
        RouteError,
    ),
    Cure(
        '_TRANSPORT',
        r'SSL connection closed by peer|PLAINTEXT broker listener',
        'if it stays: this listener may speak no TLS, check security.protocol and the port',
    ),
    Cure('_SSL', '', 'check the ssl.* properties of this bridge'),
    Cure(
        '_INVALID_ARG',
        r'OpenSSL (?:engine|provider)',
        'ssl.engine.location and ssl.providers must name what the OpenSSL of the client can load: '
        'mend them, or leave them out',
    ),
    Cure(
        '_AUTHENTICATION',
        r'OAUTHBEARER token',
        'check sasl.oauthbearer.token.endpoint.url, sasl.oauthbearer.client.id and '
        'sasl.oauthbearer.client.secret, and that the token endpoint answers',
        TransportError,
    ),
    Cure(
        '_AUTHENTICATION',  # a session just ended, or nobody there knows of logins
        r'current SASL state',
        'if it stays: this listener may take no login, check security.protocol and the port',
        TransportError,
        passes=True,
    ),
    Cure(
        '_AUTHENTICATION',  # the connection has ended
        r'handshake failed: Local: (?:Broker transport failure|Timed out)',
        '',
        TransportError,
    ),
    Cure(
        '_AUTHENTICATION',
        r'Unsupported SASL mechanism|mechanism handshake failed',
        'set sasl.mechanisms to one that the broker takes',
    ),
    Cure(
        '_AUTHENTICATION',
        r'invalid_token|OAUTHBEARER',
        'the broker refuses the token: if it has expired, sasl.oauthbearer.token.endpoint.url '
        'gives no new ones; else check its audience, issuer and scope, and the clocks',
    ),
    Cure(
        '_AUTHENTICATION SASL_AUTHENTICATION_FAILED',
        '',
        'check sasl.username and sasl.password',
    ),
    Cure(
        '_ALL_BROKERS_DOWN',
        '',
        'does it run, are bootstrap.servers and security.protocol right (and advertised.listeners '
        'of the brokers, if one answers there)?',
    ),
    Cure('_RESOLVE', '', 'check bootstrap.servers'),
    # Nothing behind it in its partition can be read: said as a failure, or nobody would know.
    Cure(
        '_BAD_COMPRESSION',
        '',
        'if this batch unpacks to more than receive.message.max.bytes (100 MB by default), set '
        'that higher; else set the offset of the group behind it',
        RouteError,
    ),
    Cure(
        '_BAD_MSG',
        r'Invalid response size',  # of HTTP, the first four letters
        'what answers there may be no broker, or speak TLS: check the port in bootstrap.servers '
        '(and advertised.listeners of the brokers), and security.protocol; where it is a broker, '
        'set receive.message.max.bytes higher',
        RouteError,
    ),
    Cure('_BAD_MSG', '', 'set the offset of the group behind what cannot be read', RouteError),
    Cure('TOPIC_AUTHORIZATION_FAILED', '', 'give this user {right} on the topic (ACL)'),
    Cure(
        'GROUP_AUTHORIZATION_FAILED',
        '',
        'give this user READ on the consumer group (ACL on the group, or on its prefix)',
    ),
    Cure(
        'CLUSTER_AUTHORIZATION_FAILED',
        '',
        'give this user {right} on the topic (ACL), and before Kafka 2.8 IDEMPOTENT_WRITE on the '
        'cluster',
    ),
    Cure('INCONSISTENT_GROUP_PROTOCOL', '', _FOREIGN_GROUP),
    Cure('_FATAL GROUP_ID_NOT_FOUND', 'group id does not exist', _FOREIGN_GROUP),
    # Each life of a bridge has a name of its own in the group, so that nobody else can have it.
    Cure(
        '_FATAL FENCED_INSTANCE_ID',
        r'Static consumer fenced',
        'an earlier request of this bridge has come late: it joins once more',
    ),
    Cure('UNKNOWN_TOPIC_OR_PART _UNKNOWN_TOPIC', '', 'create the topic'),
)
