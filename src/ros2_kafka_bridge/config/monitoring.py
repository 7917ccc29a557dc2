"""The settings of what watches a bridge: metrics, health, the page, its ROS node, traces."""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Final, Literal

from annotated_types import Ge, Le

from ros2_kafka_bridge.config.base import After, Before, Settings, Values, setting, settings
from ros2_kafka_bridge.config.mistakes import Mistake
from ros2_kafka_bridge.config.values import no_bool, web_address

ADDRESSES: Final = 'host:port such as 127.0.0.1:9464 or [::1]:9464'
"""How an address is written, for a sentence."""

_SHORTEST_TOKEN: Final = 16
_ENDPOINTS: Final = ('OTEL_EXPORTER_OTLP_ENDPOINT', 'OTEL_EXPORTER_OTLP_TRACES_ENDPOINT')


class Address(str):
    """An address to listen on, as `host:port`; an IPv6 host stands in brackets."""

    __slots__ = ()

    @property
    def host(self) -> str:
        """The host, without brackets."""
        return self.rpartition(':')[0].strip('[]')

    @property
    def port(self) -> int:
        """The port."""
        return int(self.rpartition(':')[2])


def is_address(text: str) -> bool:
    """Whether a text is the `host:port` of an `Address`."""
    host, colon, port = text.rpartition(':')
    bare = host.strip('[]')
    right = colon and bare and (':' not in bare or host == f'[{bare}]')
    return bool(right and re.fullmatch(r'\d{1,5}', port) and int(port) <= 65_535)


def _address(value: str) -> str:
    if value != 'off' and not is_address(value):
        raise ValueError(f'expected {ADDRESSES}, or off')
    return value


def _token(value: str) -> str:
    if len(value) < _SHORTEST_TOKEN:
        raise ValueError(
            f'is too short to keep others out: at least {_SHORTEST_TOKEN} characters, such as '
            'those of: openssl rand -hex 16'
        )
    if not value.isascii() or not value.isprintable() or ' ' in value:
        raise ValueError('expected ASCII characters without blanks: it goes into an HTTP header')
    return value


ListenAddress = Annotated[str, After(_address)]
AccessToken = Annotated[str, After(_token)]
Endpoint = Annotated[str, web_address('http://localhost:4318/v1/traces')]
Ratio = Annotated[float, Ge(0), Le(1), Before(no_bool)]


@settings
class MonitoringSettings(Settings):
    """What a bridge shows of itself, in a process beside those that move messages."""

    listen: ListenAddress = setting(
        'Address of metrics, health and the live page. off: none of them.',
        default='127.0.0.1:9464',
    )
    token: AccessToken | None = setting(
        'Whoever has the token may pause, resume and replay from the page, and '
        'reload. Without a token the page is read-only.',
        default=None,
        secret=True,
    )
    allowed_hosts: list[str] = setting(
        'Further host names under which browsers may open the page, such as the name '
        'of a reverse proxy.',
        default_factory=list,
    )
    node: bool = setting(
        'Whether a ROS node publishes /diagnostics and has the parameters, services '
        'and lifecycle of the bridge.',
        default=True,
    )
    start: Literal['active', 'unconfigured'] = setting(
        'active: the routes run at once. unconfigured: they wait for a lifecycle '
        'manager that configures and activates the node.',
        default='active',
    )

    @property
    def address(self) -> Address | None:
        """Where to listen, None for nowhere."""
        return None if self.listen == 'off' else Address(self.listen)


@settings
class TracingSettings(Settings):
    """W3C trace context in the headers of records, and spans by OpenTelemetry."""

    sample: Ratio = setting(
        'Share of the messages from ROS whose trace is sampled. For a record from '
        'Kafka, its traceparent header decides. A record without that header counts like a '
        'message from ROS.',
        default=0.01,
    )
    endpoint: Endpoint | None = setting(
        'Where spans are sent: OTLP over HTTP, such as '
        'http://localhost:4318/v1/traces. Without it, OTEL_EXPORTER_OTLP_* in the environment '
        'decide. Without both, no span is made and only the headers are written.',
        default=None,
    )
    service: str | None = setting(
        'service.name of the spans. Without it, the name of the bridge.', default=None
    )

    def exports(self, environ: Mapping[str, str]) -> bool:
        """Whether spans are made and sent."""
        return _exports(self.endpoint, environ)

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """Spans without what sends them."""
        check, endpoint = context.get('check_format'), given.get('endpoint')
        if check is None or not _exports(endpoint, context.get('environ', {})):
            return
        if problem := check('tracing'):
            yield Mistake(('endpoint',) if endpoint else (), problem)


def _exports(endpoint: object, environ: Mapping[str, str]) -> bool:
    if environ.get('OTEL_SDK_DISABLED', '').strip().lower() == 'true':
        return False
    return bool(endpoint or any(environ.get(name) for name in _ENDPOINTS))
