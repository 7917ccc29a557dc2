"""A Kafka that lets in whom it knows: certificates, users, tokens and permissions of a test."""

import datetime as dt
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import trustme
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AclBinding,
    AclBindingFilter,
    AclOperation,
    AclPermissionType,
    AdminClient,
    ResourcePatternType,
    ResourceType,
    ScramCredentialInfo,
    ScramMechanism,
    UserScramCredentialUpsertion,
)
from cryptography.hazmat.primitives import serialization
from ruamel.yaml import YAML
from support.bridges.routes import to_kafka, to_ros, values
from support.kafka.token_endpoint import TokenEndpoint
from support.patience import patient
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.testing.local_kafka import HOST, LocalKafka, free_port
from ros2_kafka_bridge.testing.orders import encode, orders

TOKEN_S: Final = 8
RENEW_S: Final = 3
_PATIENCE_S: Final = 20
# The user of docs/security.md, by its certificate, its token, and PLAIN.
USER: Final = 'warehouse-1'
PASSWORD: Final = 'swordfish-5dd1'  # noqa: S105 (of a test)
CLIENT_SECRET: Final = 'open-sesame-90ab'  # noqa: S105 (of a test)
WRONG: Final = 'not-the-password-31b0'
OTHER: Final = 'another-password-4be7'
SECRETS: Final = (PASSWORD, CLIENT_SECRET, WRONG, OTHER)


class Right(NamedTuple):
    """One permission: an operation on a topic or a group."""

    kind: ResourceType
    name: str
    operation: AclOperation
    prefixed: bool = False


class Round(NamedTuple):
    """The way of orders through two routes: from one topic to ROS, from there to another."""

    name: str
    source: str
    returned: str

    @property
    def routes(self) -> list[dict[str, Any]]:
        """The two routes."""
        ros = f'/{self.name}'
        return [
            to_ros(self.source, ros, name=self.name),
            to_kafka(ros, self.returned, name=f'{self.name}_returned'),
        ]

    def rights(self, bridge: str) -> list[Right]:
        """Exactly what docs/security.md says that the bridge needs for them."""
        return [
            topic_right(self.source, 'READ'),
            group_right(f'{bridge}.', prefixed=True),
            topic_right(self.returned, 'WRITE'),
        ]


def make_round(bench: Bench, name: str) -> Round:
    """Create the topics of a round, which nobody else uses."""
    stem = f'{name}-{uuid.uuid4().hex[:8]}'
    made = Round(name, stem, f'{stem}.returned')
    bench.create_topic(made.source, made.returned)
    return made


def topic_right(name: str, operation: str) -> Right:
    """A permission on a topic."""
    return Right(ResourceType.TOPIC, name, AclOperation[operation])


def group_right(name: str, *, prefixed: bool = False) -> Right:
    """READ on a group, or on all that begin with the name."""
    return Right(ResourceType.GROUP, name, AclOperation.READ, prefixed)


def let_in(secured: 'SecuredKafka', bench: Bench, name: str = 'orders', user: str = USER) -> Round:
    """A round that a bridge may go as this user, with the rights of docs/security.md alone."""
    goods = make_round(bench, name)
    secured.allow(user, goods.rights(bench.name))
    return goods


class Listener(NamedTuple):
    """Where clients connect."""

    name: str
    protocol: str
    port: int

    @property
    def address(self) -> str:
        """For bootstrap.servers."""
        return f'{HOST}:{self.port}'


class SecuredKafka:
    """One Kafka with a listener for each way to get in, or to be kept out.

    SECURE and RENEWED take SCRAM, PLAIN and tokens over TLS; RENEWED asks for the credentials
    again every few seconds. MUTUAL asks for a certificate of the client. EXPIRED and ELSEWHERE
    have certificates that are too old, and of another host. The plain listener, for the tests'
    own administration, is the super user.
    """

    def __init__(self, place: Path, tokens: TokenEndpoint) -> None:
        self.place = place
        self.tokens = tokens
        self.authority = trustme.CA()
        self.ca_file = self._write('ca.pem', self.authority.cert_pem)
        self.other_ca_file = self._write('other-ca.pem', trustme.CA().cert_pem)
        protocols = {
            'SECURE': 'SASL_SSL',
            'RENEWED': 'SASL_SSL',
            'MUTUAL': 'SSL',
            'EXPIRED': 'SASL_SSL',
            'ELSEWHERE': 'SASL_SSL',
        }
        self.listeners = {
            name: Listener(name, protocol, free_port()) for name, protocol in protocols.items()
        }
        self.node = LocalKafka(
            place / 'node',
            properties=self._properties(),
            jvm_flags=(
                f'-Dorg.apache.kafka.sasl.oauthbearer.allowed.urls={tokens.keys_url},{tokens.url}',
            ),
        )

    @property
    def admin(self) -> AdminClient:
        """A client of the super user."""
        return AdminClient({'bootstrap.servers': self.node.bootstrap_servers})

    def address(self, listener: str = 'SECURE') -> str:
        """Where clients of a listener connect."""
        return self.listeners[listener].address

    def properties(self, way: str, place: Path) -> dict[str, Any]:
        """The example of docs/security.md, with this broker and files of the test in it.

        The secrets are in `place`; `$KAFKA_PASSWORD` is left to the environment.
        """
        certificate, key = self.client_certificate(USER)
        (place / 'kafka-password').write_text(f'{PASSWORD}\n')
        (place / 'client-secret').write_text(f'{CLIENT_SECRET}\n')
        ours = {
            'kafka.example.org:9093': self.address('SECURE'),
            'kafka.example.org:9094': self.address('MUTUAL'),
            '/etc/kafka/ca.pem': str(self.ca_file),
            '/etc/kafka/warehouse-1.crt': str(certificate),
            '/etc/kafka/warehouse-1.key': str(key),
            '/run/secrets': str(place),
            'https://login.example.org/token': self.tokens.url,
        }
        found = documented(way)
        for theirs, own in ours.items():
            found = {name: value.replace(theirs, own) for name, value in found.items()}
        return found

    # Certificates

    def client_certificate(self, user: str, *, expired: bool = False) -> tuple[Path, Path]:
        """Make a certificate of a client; returns the files of certificate and key."""
        made = self.authority.issue_cert(
            f'{user}.example.org',
            common_name=user,
            not_before=_begin(expired=expired),
            not_after=_end(expired=expired),
        )
        chain = b''.join(pem.bytes() for pem in made.cert_chain_pems)
        stem = uuid.uuid4().hex[:8]
        certificate = self._write(f'{stem}.crt', trustme.Blob(chain))
        return certificate, self._write(f'{stem}.key', made.private_key_pem)

    # Users and permissions

    def set_password(self, user: str, password: str) -> None:
        """Add a SCRAM user, or change its password."""
        info = ScramCredentialInfo(ScramMechanism.SCRAM_SHA_512, 4096)
        change = UserScramCredentialUpsertion(user, info, password.encode())
        admin = self.admin
        admin.alter_user_scram_credentials([change])[user].result(patient(_PATIENCE_S))

    def allow(self, user: str, rights: Sequence[Right]) -> None:
        """Give permissions, and wait until the broker applies them."""
        admin = self.admin  # kept: its futures fail when it goes
        made = [_binding(user, right) for right in dict.fromkeys(rights)]
        for future in admin.create_acls(made).values():
            future.result(patient(_PATIENCE_S))
        wanted = [_filter(binding) for binding in made]
        eventually(lambda: all(_found(admin, one) for one in wanted), _PATIENCE_S)

    def forbid(self, user: str, rights: Sequence[Right]) -> None:
        """Take permissions back, and wait until the broker applies it."""
        admin = self.admin
        wanted = [_filter(_binding(user, right)) for right in rights]
        for future in admin.delete_acls(wanted).values():
            assert future.result(patient(_PATIENCE_S)), 'there was no such permission'
        eventually(lambda: not any(_found(admin, one) for one in wanted), _PATIENCE_S)

    # The node

    def _write(self, name: str, content: trustme.Blob) -> Path:
        path = self.place / name
        content.write_to_path(path)
        return path

    def _properties(self) -> dict[str, str]:
        protocols = {'CONTROLLER': 'PLAINTEXT', 'PLAINTEXT': 'PLAINTEXT'}
        protocols |= {name: listener.protocol for name, listener in self.listeners.items()}
        made = {
            'listeners': ','.join(f'{n}://{x.address}' for n, x in self.listeners.items()),
            'listener.security.protocol.map': ','.join(f'{n}:{p}' for n, p in protocols.items()),
            'inter.broker.listener.name': 'PLAINTEXT',
            'authorizer.class.name': 'org.apache.kafka.metadata.authorizer.StandardAuthorizer',
            'super.users': 'User:ANONYMOUS',
            'auto.create.topics.enable': 'false',
            'ssl.principal.mapping.rules': 'RULE:^.*CN=([^,]+).*$/$1/,DEFAULT',
            'ssl.truststore.type': 'PEM',
            'ssl.truststore.location': str(self.ca_file),
        }
        for listener in self.listeners.values():
            made |= self._listener_properties(listener)
        return made

    def _listener_properties(self, listener: Listener) -> dict[str, str]:
        host = 'elsewhere.example.org' if listener.name == 'ELSEWHERE' else HOST
        expired = listener.name == 'EXPIRED'
        made = self.authority.issue_cert(
            host, not_before=_begin(expired=expired), not_after=_end(expired=expired)
        )
        pem = self._write(f'{listener.name}.pem', _java_key_store(made))
        prefix = f'listener.name.{listener.name.lower()}'
        properties = {
            f'{prefix}.ssl.keystore.type': 'PEM',
            f'{prefix}.ssl.keystore.location': str(pem),
        }
        if listener.protocol == 'SSL':
            return properties | {f'{prefix}.ssl.client.auth': 'required'}
        return properties | self._sasl_properties(prefix, listener)

    def _sasl_properties(self, prefix: str, listener: Listener) -> dict[str, str]:
        security = 'org.apache.kafka.common.security'
        users = f'user_{USER}="{PASSWORD}"'
        token = f'{prefix}.oauthbearer'
        properties = {
            f'{prefix}.sasl.enabled.mechanisms': 'SCRAM-SHA-512,PLAIN,OAUTHBEARER',
            f'{prefix}.scram-sha-512.sasl.jaas.config': (
                f'{security}.scram.ScramLoginModule required;'
            ),
            f'{prefix}.plain.sasl.jaas.config': (
                f'{security}.plain.PlainLoginModule required {users};'
            ),
            f'{token}.sasl.jaas.config': (
                f'{security}.oauthbearer.OAuthBearerLoginModule required;'
            ),
            f'{token}.sasl.server.callback.handler.class': (
                f'{security}.oauthbearer.OAuthBearerValidatorCallbackHandler'
            ),
            f'{token}.sasl.oauthbearer.jwks.endpoint.url': self.tokens.keys_url,
            f'{token}.sasl.oauthbearer.expected.audience': 'kafka',
        }
        if listener.name == 'RENEWED':
            for mechanism in ('scram-sha-512', 'oauthbearer'):
                name = f'{prefix}.{mechanism}.connections.max.reauth.ms'
                properties[name] = str(RENEW_S * 1000)
        return properties


DOCS: Final = Path(__file__).parents[3] / 'docs' / 'security.md'


def documented(way: str) -> dict[str, Any]:
    """The properties under `kafka:` in the example of docs/security.md for one way to get in."""
    section = DOCS.read_text('utf-8').partition(f'\n### {way}\n')[2]
    example = section.partition('```yaml\n')[2].partition('```')[0]
    found: dict[str, Any] = YAML(typ='safe').load(example)['kafka']
    return found


def mended(properties: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Properties with others in their place; `_` in a name for `.`, None takes one away."""
    named = {name.replace('_', '.'): value for name, value in changes.items()}
    return {n: v for n, v in {**properties, **named}.items() if v is not None}


@contextmanager
def watched(
    bench: Bench,
    routes: list[dict[str, Any]],
    kafka: dict[str, Any],
    *options: str,
    **environ: str,
) -> Iterator[Process]:
    """A bridge that keeps its secrets: from its output, and from `ps`, with its children.

    At the end it drains.
    """
    with bench.run(bench.config(routes, kafka=kafka), *options, **environ) as bridge:
        yield bridge
        shown = ''.join(_command_lines(bridge.pid))
        assert bridge.end() == 0, bridge.output()
        shown += bridge.output()
        assert not [secret for secret in SECRETS if secret in shown], 'a secret was shown'


def carries_orders(secured: SecuredKafka, bench: Bench, way: str) -> None:
    """A bridge that gets in this way takes orders to ROS and back, and complains of nothing."""
    goods = let_in(secured, bench)
    source = orders(seed=5)
    sent = [encode(next(source)) for _ in range(500)]
    bench.produce(goods.source, sent)
    kafka = secured.properties(way, bench.place)
    with watched(bench, goods.routes, kafka, KAFKA_PASSWORD=PASSWORD) as bridge:
        assert values(bench.records(goods.returned, len(sent))) == sent
    assert 'ERROR' not in bridge.output()
    assert 'Kafka is away' not in bridge.output()


def _command_lines(pid: int) -> Iterator[str]:
    """What `ps` shows of a process and of all that it has started."""
    with suppress(OSError):
        yield Path(f'/proc/{pid}/cmdline').read_text()
        for children in Path(f'/proc/{pid}/task').glob('*/children'):
            for child in children.read_text().split():
                yield from _command_lines(int(child))


@contextmanager
def running(place: Path) -> Iterator[SecuredKafka]:
    """A secured Kafka with its token endpoint, which knows the password of `USER`."""
    with TokenEndpoint(USER, TOKEN_S) as tokens:
        secured = SecuredKafka(place, tokens)
        with secured.node:
            secured.set_password(USER, PASSWORD)
            yield secured


def _binding(user: str, right: Right) -> AclBinding:
    pattern = ResourcePatternType.PREFIXED if right.prefixed else ResourcePatternType.LITERAL
    return AclBinding(
        right.kind, right.name, pattern, f'User:{user}', '*',
        right.operation, AclPermissionType.ALLOW,
    )  # fmt: skip


def _filter(binding: AclBinding) -> AclBindingFilter:
    """What finds that permission, and no other."""
    return AclBindingFilter(
        binding.restype, binding.name, binding.resource_pattern_type, binding.principal,
        binding.host, binding.operation, binding.permission_type,
    )  # fmt: skip


def _found(admin: AdminClient, wanted: AclBindingFilter) -> bool:
    """Whether the broker itself knows of it: it learns of changes from the controller, later."""
    return bool(admin.describe_acls(wanted).result(patient(_PATIENCE_S)))


def _java_key_store(certificate: trustme.LeafCert) -> trustme.Blob:
    """Key and chain in one, as Java reads them: PKCS 8 alone."""
    key = serialization.load_pem_private_key(certificate.private_key_pem.bytes(), None)
    pem = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    return trustme.Blob(pem + b''.join(blob.bytes() for blob in certificate.cert_chain_pems))


def _begin(*, expired: bool) -> dt.datetime | None:
    now = dt.datetime.now(dt.UTC)
    return now - dt.timedelta(days=2) if expired else None


def _end(*, expired: bool) -> dt.datetime | None:
    now = dt.datetime.now(dt.UTC)
    return now - dt.timedelta(days=1) if expired else None
