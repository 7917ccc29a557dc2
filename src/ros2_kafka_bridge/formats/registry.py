"""The Schema Registry: its client, and what its errors mean.

The client is confluent-kafka's own. It is opened without asking the network; what its user asks
stands in `Registry.registering` or `Registry.reading`, which make errors of the bridge of all
that the client can raise.
"""

import math
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qsl, unquote, urlsplit
from weakref import finalize

from ros2_kafka_bridge.errors import BridgeError, ConfigError, DecodeError, RouteError
from ros2_kafka_bridge.formats.looks import FRAME, LARGEST_ID, cdr_as_id, unframed
from ros2_kafka_bridge.kafka.properties import PropertyValue, is_secret
from ros2_kafka_bridge.message_types.definition import has_parser
from ros2_kafka_bridge.message_types.layout import Layout, dotted_name
from ros2_kafka_bridge.outside.masking import (
    MASK,
    finding,
    login,
    masked_address,
    masked_addresses,
)
from ros2_kafka_bridge.outside.pem import tls_problems

if TYPE_CHECKING:
    from confluent_kafka.schema_registry import Schema, SchemaRegistryClient

    from ros2_kafka_bridge.formats.answers import Bounds
    from ros2_kafka_bridge.formats.scope import Scope

# A route that fails is tried again with backoff: the client need not be patient itself.
_DEFAULTS: Final[dict[str, PropertyValue]] = {
    'timeout': 5,
    'max.retries': 1,
    'retries.wait.ms': 200,
    'retries.max.wait.ms': 1000,
}
_NO_REGISTRY: Final = (
    'no Schema Registry: add schema_registry: {url: ...} to the file, or '
    'schema: {registry: false} to the route'
)
_ADDRESSES: Final = ('url', 'proxy', 'bearer.auth.issuer.endpoint.url')
_SHORTEST_SECRET: Final = 8
_LONGEST_ANSWER: Final = 2000
_MISSING_S: Final = 5.0
_MOST_MISSING: Final = 1000

NO_SCHEMA: Final = 40403
_NOT_FOUND: Final = frozenset({40401, 40402, NO_SCHEMA})  # subject, version, schema
_NOT_FOUND_BY_HTTP: Final = 404
_READ_ONLY: Final = 42205


class UnusableSchemaError(Exception):
    """Why nothing that was written with a schema can be read, as said of it: `has ...`."""


def strategy(scope: 'Scope') -> str:
    """The `subject.name.strategy.type` of confluent, whose default would ask the network."""
    return scope.schema.subject.upper()


def subject(scope: 'Scope', layout: Layout) -> str:
    """The subject of a record's value, by the strategy of the route."""
    return {
        'topic': f'{scope.topic}-value',
        'record': dotted_name(layout),
        'topic_record': f'{scope.topic}-{dotted_name(layout)}',
    }[scope.schema.subject]


def framed_id(value: bytes) -> int:
    """The id of a value's schema: a zero byte stands before it, the value behind it.

    Raises:
        DecodeError: The value does not begin so, or with what is the id of no schema.
    """
    schema_id = int.from_bytes(value[1:FRAME], 'big')
    if len(value) < FRAME:
        said = f'{len(value)} bytes: a value with the id of its schema has at least {FRAME}'
    elif value[0]:
        said = f'begins with {value[0]:#04x}, and the id of a schema has a zero byte before it'
    elif schema_id > LARGEST_ID:
        said = f'begins as with the id {schema_id} of a schema, and none is above {LARGEST_ID}'
    else:
        return schema_id
    raise DecodeError(f'{said}{unframed(value)}')


def open_registry(scope: 'Scope') -> 'Registry':
    """Make the client of the registry; nothing is asked yet.

    Raises:
        ConfigError: There is no registry, or a property is wrong.
    """
    if not scope.registry:
        raise ConfigError([_NO_REGISTRY])
    mask = _mask(scope.registry)
    url = masked_address(str(scope.registry.get('url', '')))
    client = _client(_DEFAULTS | dict(scope.registry), mask)
    from ros2_kafka_bridge.formats.answers import Bounds  # noqa: PLC0415 (as heavy as the client)

    return Registry(client, url, mask, Bounds(client))


def text_of(schema: 'Schema') -> str:
    """The text of a schema that was read.

    Raises:
        TypeError: The answer had none, which `Registry.reading` makes a RouteError of: a proxy,
            or a registry under maintenance, answers so, and says nothing about the schema.
    """
    if not isinstance(schema.schema_str, str) or not schema.schema_str:
        raise TypeError('an answer without a schema')
    return schema.schema_str


def kind_of(schema: 'Schema') -> str:
    """Which kind of schema one is that was read: `AVRO`, `PROTOBUF`, `JSON`.

    Raises:
        TypeError: As `text_of`.
    """
    kind: object = schema.schema_type or 'AVRO'
    if not isinstance(kind, str):
        raise TypeError('an answer with a schema of no kind')
    return kind


def _client(properties: dict[str, PropertyValue], mask: re.Pattern[str]) -> 'SchemaRegistryClient':
    # Half a second to import, and only these formats need it.
    from confluent_kafka.schema_registry import SchemaRegistryClient  # noqa: PLC0415
    from confluent_kafka.schema_registry.common._httpx_compat import httpx  # noqa: PLC0415

    # Its own error names no file, and it asks the terminal for a password that is not there.
    if wrong := tls_problems(properties):
        raise ConfigError([f'schema_registry: {name}: {text}' for name, text in wrong.items()])
    try:
        return SchemaRegistryClient.new_client(properties)
    except (ImportError, OSError, TypeError, ValueError, httpx.InvalidURL) as error:
        # Of a proxy, also one in the environment, whose protocol needs another package.
        raise ConfigError([f'schema_registry: {_shown(mask, error)}']) from None


def _mask(properties: Mapping[str, PropertyValue]) -> re.Pattern[str]:
    """Finds what must never be shown."""
    secrets = [str(value) for name, value in properties.items() if is_secret(name)]
    for url in _urls(','.join(str(properties.get(name, '')) for name in _ADDRESSES)):
        secrets += [url.password, unquote(url.password)] if url.password else []
        secrets += [url.netloc.rpartition('@')[0]] * ('@' in url.netloc)
        # A word as short as v1 or dev is in many a sentence.
        secrets += [it for _, it in parse_qsl(url.query) if len(it) >= _SHORTEST_SECRET]
    # A password may be said without its user. The user is no secret, and one of a single letter
    # would hide half of what is said.
    secrets += [secret.partition(':')[2] for secret in secrets]
    logins = [str(properties.get('basic.auth.user.info', '')), login(properties, 'bearer.auth')]
    return finding(secrets, logins)


def _urls(urls: str) -> list[Any]:
    return [urlsplit(url.strip()) for url in urls.split(',')]


def _shown(mask: re.Pattern[str], error: object) -> str:
    return mask.sub(MASK, masked_addresses(str(error)))


@dataclass(slots=True)
class Registry:
    """A client of the Schema Registry, for one thread.

    Args:
        client: confluent-kafka's own.
        url: As the user wrote it, without what may be secret in it.
        mask: Finds what must never be shown.
        bounds: Of what it may answer.
    """

    client: 'SchemaRegistryClient'
    url: str
    mask: re.Pattern[str] = field(repr=False)
    bounds: 'Bounds'
    _missing: dict[int, float] = field(default_factory=dict)

    def close_with(self, owner: object) -> None:
        """Close the connection when `owner`, whoever asks the registry, is gone."""
        finalize(owner, self.client.close)

    @contextmanager
    def registering(
        self, subject: str, type_name: str, schema_format: str, *, auto_register: bool
    ) -> Iterator[None]:
        """Make errors of the bridge of what the client raises while a schema is registered.

        Args:
            subject: Where the schema is registered or looked up.
            type_name: The message type that the schema is of.
            schema_format: `avro` or `protobuf`.
            auto_register: Whether it is registered; else it is only looked up.

        Raises:
            ConfigError: The registry refuses the schema, or has none where none is registered.
            RouteError: The registry does not answer, or not to this user.
        """
        printed = f'ros2-kafka-bridge schema {type_name} --format {schema_format}'
        missing = (
            f'{self.url} has no schema of {type_name} in subject {subject}, and auto_register is '
            f'false: register what `{printed}` prints, or set schema: {{auto_register: true}}'
        )
        if not has_parser():
            missing += (
                '; the docs of a type belong to its schema, and are left out here, because there '
                'is no rosidl_adapter: was it registered where ROS 2 is installed?'
            )
        not_found = None if auto_register else ConfigError([missing])
        with self._asking(f'subject {subject}', not_found):
            yield

    @contextmanager
    def reading(self, schema_id: int) -> Iterator[None]:
        """Make errors of the bridge of what the client raises while a schema is read by its id.

        The client forgets what it was answered: who reads keeps what is good. That there is no
        such schema is remembered here, for seconds: it may be registered at any time.

        Raises:
            DecodeError: The registry has no such schema.
            RouteError: The registry does not answer, or not to this user.
        """
        hint = cdr_as_id(schema_id)
        missing = DecodeError(f'{self.url} has no schema with the id {schema_id}{hint}')
        if time.monotonic() < self._missing.get(schema_id, -math.inf) + _MISSING_S:
            raise missing
        try:
            with self._asking(f'schema {schema_id}', missing, schema_id):
                yield
        except DecodeError:
            self._remember_missing(schema_id)
            raise
        finally:
            # It keeps an answer without a schema as well as any other.
            self.client.clear_caches()  # type: ignore[no-untyped-call]  # of the library

    def _remember_missing(self, schema_id: int) -> None:
        if len(self._missing) >= _MOST_MISSING:
            self._missing.clear()
        self._missing[schema_id] = time.monotonic()

    @contextmanager
    def _asking(
        self, about: str, missing: BridgeError | None, schema_id: int | None = None
    ) -> Iterator[None]:
        """`missing` is what an answer of "not found" means, where it means something."""
        from confluent_kafka.schema_registry.common._httpx_compat import httpx  # noqa: PLC0415
        from confluent_kafka.schema_registry.error import (  # noqa: PLC0415 -- heavy, as above
            OAuthTokenError,
            SchemaRegistryError,
        )

        from ros2_kafka_bridge.formats.answers import UnboundedError  # noqa: PLC0415 -- the same

        where, question = f'Schema Registry {self.url}', 'does url name a Schema Registry?'
        try:
            with self.bounds.kept():
                yield
        except UnboundedError as error:
            raise RouteError(f'{where}: {error}: {question}') from None
        except SchemaRegistryError as error:
            raise self._refused(error, about, missing, schema_id) from None
        except (httpx.UnsupportedProtocol, httpx.InvalidURL) as error:
            raise ConfigError([f'schema_registry: url: {self._shown(error)}']) from None
        except httpx.HTTPError as error:
            raise RouteError(f'{where}: {self._away(error)}') from None
        except OAuthTokenError as error:
            said = f'no token from bearer.auth.issuer.endpoint.url: {self._shown(error.message)}'
            raise RouteError(f'{where}: {said}') from None
        except (BridgeError, UnusableSchemaError):
            raise
        except Exception as error:
            said = f'{where}: answers with something else than'
            if type(error).__name__ == 'JSONDecodeError':  # the client has it of several libraries
                raise RouteError(f'{said} JSON: {question}') from None
            # JSON of another shape goes wrong wherever the client looks at it first.
            found = self._shown(error) or type(error).__name__
            raise RouteError(f'{said} a registry does ({found}): {question}') from error

    def _shown(self, error: object) -> str:
        return _shown(self.mask, error)[:_LONGEST_ANSWER]

    def _refused(
        self, error: Any, about: str, missing: BridgeError | None, schema_id: int | None
    ) -> BridgeError:
        """What an answer of the registry means, by its status and its own code."""
        status, code = error.http_status_code, error.error_code
        said = self._shown(error.error_message or f'status {status}')
        where = f'Schema Registry {self.url}, {about}'
        if missing and status == 404 and self._is_missing(code, schema_id):
            return missing
        if status == 409:
            return ConfigError([f'{where}: {_INCOMPATIBLE}: {said}'])
        if code == _READ_ONLY:
            return RouteError(
                f'{where}: the registry is read-only ({said}): register the schema where it is '
                'not, or set schema: {auto_register: false}'
            )
        if status == 422:
            return ConfigError([f'{where}: the registry does not take the schema: {said}'])
        cure = _CURES.get(status, '')
        if not cure and status < 500:
            cure = '; does url name a Schema Registry?'
        return RouteError(f'{where}: {said} (status {status}){cure}')

    def _is_missing(self, code: object, schema_id: int | None) -> bool:
        """Whether an answer of 404 is that of a registry which has no such thing.

        Some say so without a code of their own. So does something else at the address, perhaps for
        a moment: then nothing is known of the schema.
        """
        if isinstance(code, int) and code in _NOT_FOUND:
            return True
        if code != _NOT_FOUND_BY_HTTP or schema_id is None:
            return False
        return self._answers_as_one() and self._lacks(schema_id)

    def _answers_as_one(self) -> bool:
        """Whether what is there answers another question as a registry does."""
        try:
            with self._asking('config', None):
                return bool(self.client.get_config().compatibility_level)
        except BridgeError:
            return False

    def _lacks(self, schema_id: int) -> bool:
        """Whether it says so once more, of the schema itself."""
        from confluent_kafka.schema_registry.error import (  # noqa: PLC0415 -- heavy, as above
            SchemaRegistryError,
        )

        with suppress(BridgeError), self._asking(f'schema {schema_id}', None):
            try:
                self.client.get_schema(schema_id)
            except SchemaRegistryError as error:
                return bool(error.http_status_code == 404)
        return False

    def _away(self, error: Exception) -> str:
        """Why there is no answer."""
        text = self._shown(error) or type(error).__name__
        for sign, cure in _AWAY.items():
            if sign in text:
                return f'{cure} ({text})'
        name = type(error).__name__
        return f'does not answer ({text if text == name else f"{name}: {text}"})'


_INCOMPATIBLE: Final = (
    'the schema is not compatible with the versions that are there; use another subject (another '
    'topic, or schema: {subject: record}), or change the compatibility of this one; '
    'the registry says'
)
_CURES: Final = {
    401: ': it refuses this login, or wants one: look at basic.auth.user.info or bearer.auth.*',
    403: ': this user may not do that: give it the right to this subject',
    429: ': it has too many requests for now',
}
_AWAY: Final = {
    'Hostname mismatch': 'its certificate is for another name than the one in url',
    'IP address mismatch': 'its certificate is for another name than the one in url',
    'CERTIFICATE_VERIFY_FAILED': 'its certificate is not trusted: name the CA in ssl.ca.location',
    'WRONG_VERSION_NUMBER': 'it speaks no TLS there: try http:// in url',
    'CERTIFICATE_REQUIRED': 'it asks for a certificate: set ssl.certificate.location',
    'UNKNOWN_CA': 'it does not trust the certificate in ssl.certificate.location',
}
