"""The settings of the Schema Registry's client, by the names that confluent-kafka gives them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal
from urllib.parse import urlsplit

from ros2_kafka_bridge.config.base import (
    After,
    Before,
    Settings,
    Values,
    dotted,
    setting,
    settings,
)
from ros2_kafka_bridge.config.mistakes import Mistake, field_names, kind_of
from ros2_kafka_bridge.config.values import (
    CountOrNone,
    NotNegative,
    Positive,
    is_web_address,
    web_address,
)
from ros2_kafka_bridge.kafka.properties import PropertyValue
from ros2_kafka_bridge.outside.files import file_problem
from ros2_kafka_bridge.outside.pem import tls_problems

_NEEDED = {
    'OAUTHBEARER': (
        'bearer.auth.client.id',
        'bearer.auth.client.secret',
        'bearer.auth.scope',
        'bearer.auth.issuer.endpoint.url',
        'bearer.auth.logical.cluster',
    ),
    'OAUTHBEARER_AZURE_IMDS': ('bearer.auth.logical.cluster',),
    'STATIC_TOKEN': ('bearer.auth.token', 'bearer.auth.logical.cluster'),
}
_OPTIONAL = {
    'OAUTHBEARER': ('bearer.auth.identity.pool.id',),
    'OAUTHBEARER_AZURE_IMDS': (
        'bearer.auth.identity.pool.id',
        'bearer.auth.issuer.endpoint.url',
        'bearer.auth.issuer.endpoint.query',
    ),
    'STATIC_TOKEN': ('bearer.auth.identity.pool.id',),
}
_SOURCE = 'bearer.auth.credentials.source'
_PROXIES = ('http', 'https', 'socks5', 'socks5h')
_FILES = ('ssl.ca.location', 'ssl.certificate.location', 'ssl.key.location')


def _urls(value: str) -> str:
    for url in value.split(','):
        if not is_web_address(url.strip()):
            raise ValueError('expected addresses with commas, such as https://registry:8081')
        if '@' in urlsplit(url.strip()).netloc:
            raise ValueError('holds a user or a password: these belong in basic.auth.user.info')
    return value


def _user_info(value: str) -> str:
    if ':' not in value:
        raise ValueError('expected <user>:<password>')
    return value


def _authorities(value: object) -> object:
    if isinstance(value, str) or value is False:
        return value
    raise ValueError(f'expected a path, or false for no check, got {kind_of(value)}')


Urls = Annotated[str, After(_urls)]
Issuer = Annotated[str, web_address('https://login.example.org/token')]
Proxy = Annotated[str, web_address('http://proxy:3128', _PROXIES)]
UserInfo = Annotated[str, After(_user_info)]
Authorities = Annotated[str | Literal[False], Before(_authorities)]


@settings
@dotted
class SchemaRegistrySettings(Settings):
    """The Schema Registry of the formats avro and protobuf: properties of confluent-kafka's
    `SchemaRegistryClient`, by their own names.
    """

    # The names in a file are those of the client, never Python's.
    __pydantic_config__: ClassVar[dict[str, Any]] = {
        **Settings.__pydantic_config__,
        'populate_by_name': False,
    }

    url: Urls = setting(
        'Address, or several with commas between them, which are tried in this order.'
    )
    basic_auth_user_info: UserInfo | None = setting(
        'User and password, as `<user>:<password>`.', default=None, secret=True
    )
    ssl_ca_location: Authorities | None = setting(
        "File or directory of the authorities that sign the registry's certificate. "
        "Without it, certifi's. false: nothing is checked.",
        default=None,
    )
    ssl_certificate_location: str | None = setting(
        "File of the bridge's certificate.", default=None
    )
    ssl_key_location: str | None = setting('File of the key of that certificate.', default=None)
    ssl_key_password: str | None = setting('Password of that key.', default=None, secret=True)
    bearer_auth_credentials_source: (
        Literal['OAUTHBEARER', 'OAUTHBEARER_AZURE_IMDS', 'STATIC_TOKEN'] | None
    ) = setting('Where bearer tokens come from.', default=None)
    bearer_auth_token: str | None = setting(
        'The token of STATIC_TOKEN.', default=None, secret=True
    )
    bearer_auth_client_id: str | None = setting('Who asks for a token.', default=None)
    bearer_auth_client_secret: str | None = setting(
        'The secret of that client.', default=None, secret=True
    )
    bearer_auth_scope: str | None = setting('The scope of a token.', default=None)
    bearer_auth_issuer_endpoint_url: Issuer | None = setting('Who issues tokens.', default=None)
    bearer_auth_issuer_endpoint_query: str | None = setting(
        'The query of OAUTHBEARER_AZURE_IMDS.', default=None
    )
    bearer_auth_logical_cluster: str | None = setting(
        'The logical cluster that a token is for.', default=None
    )
    bearer_auth_identity_pool_id: str | None = setting(
        'Identity pools, with commas between them.', default=None
    )
    proxy: Proxy | None = setting('Address of a proxy.', default=None)
    timeout: Positive | None = setting(
        'Longest time for an answer, in seconds. The bridge chooses 5.', default=None
    )
    max_retries: CountOrNone | None = setting(
        'How often a request is sent again before the whole route is tried again. '
        'The bridge chooses 1.',
        default=None,
    )
    retries_wait_ms: NotNegative | None = setting(
        'First wait before a request is sent again, in milliseconds.', default=None
    )
    retries_max_wait_ms: NotNegative | None = setting(
        'Longest wait before a request is sent again, in milliseconds.', default=None
    )

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """What belongs together, and files that are not there."""
        for name in ('ssl.key.location', 'ssl.key.password'):
            if given.get(name) is not None and given.get('ssl.certificate.location') is None:
                yield Mistake((name,), 'needs ssl.certificate.location, too')
        if given.get('basic.auth.user.info') is not None and given.get(_SOURCE) is not None:
            yield Mistake((_SOURCE,), 'basic.auth.user.info is there: leave one of them out')
        yield from _bearer_mistakes(given)
        if context.get('check_kafka'):
            yield from _file_mistakes(given)

    def properties(self) -> dict[str, PropertyValue]:
        """What the client is made with, secrets included."""
        values = {s: getattr(self, name) for s, name in field_names(type(self)).items()}
        return {spelled: value for spelled, value in values.items() if value is not None}


def _file_mistakes(given: Values) -> Iterator[Mistake]:
    """Files that cannot be opened; else what is wrong inside them."""
    found: dict[str, str] = {}
    for name in _FILES:
        path, is_ca = given.get(name), name == 'ssl.ca.location'
        if isinstance(path, str) and (why := file_problem(Path(path), or_directory=is_ca)):
            found[name] = why
    for name, why in (found or tls_problems(given)).items():
        yield Mistake((name,), why)


def _bearer_mistakes(given: Values) -> Iterator[Mistake]:
    source = given.get(_SOURCE)
    said = [name for name, value in given.items() if value is not None]
    parts = [name for name in said if name.startswith('bearer.auth.') and name != _SOURCE]
    if source is None:
        for name in parts:
            yield Mistake((name,), f'needs {_SOURCE}, too: {", ".join(_NEEDED)}')
        return
    needed = _NEEDED.get(str(source), ())
    for name in needed:
        if name not in said:
            yield Mistake((name,), f'is missing: {source} needs it')
    for name in parts:
        if name not in (*needed, *_OPTIONAL.get(str(source), ())):
            yield Mistake((name,), f'{source} has no use for it')
