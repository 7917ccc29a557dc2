"""A secret in any field of a configuration is in nothing that a person is shown."""

import base64
import json
import logging
import re
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import KafkaError
from support.processes.terminal import typed
from support.registry.answers import decode_error, encode_error
from support.registry.server import RegistryServer

from ros2_kafka_bridge.commands.check.report import report
from ros2_kafka_bridge.config.base import Settings
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.mistakes import field_names
from ros2_kafka_bridge.config.monitoring import MonitoringSettings, TracingSettings
from ros2_kafka_bridge.config.registry import SchemaRegistrySettings
from ros2_kafka_bridge.config.settings import Config, masked
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.properties import KNOWN, is_secret
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.config_diff import difference
from ros2_kafka_bridge.process.plan import plan_of

MARK = 'swordfish-31b0'
OTHER = 'swordfish-77c2'
ADDRESS = f'https://me:{MARK}@host:8081/path?api_key={MARK}&{MARK}#{MARK}'

KAFKA = {
    **dict.fromkeys(
        (
            'sasl.jaas.config', 'sasl.oauthbearer.client.secret', 'sasl.oauthbearer.config',
            'sasl.kerberos.kinit.cmd', 'sasl.oauthbearer.extensions',
            'sasl.password', 'ssl.key.password', 'ssl.key.pem', 'ssl.keystore.password',
            'sasl.oauthbearer.assertion.private.key.passphrase',
            'sasl.oauthbearer.assertion.private.key.pem',
        ),
        MARK,
    ),
    'sasl.oauthbearer.token.endpoint.url': ADDRESS,
}  # fmt: skip
REGISTRY = {
    'url': f'https://registry/?api_key={MARK}, HTTP://other/?{MARK}',
    'basic.auth.user.info': f'me:{MARK}',
    'ssl.key.password': MARK,
    'bearer.auth.token': MARK,
    'bearer.auth.client.secret': MARK,
    'bearer.auth.issuer.endpoint.url': ADDRESS,
    'bearer.auth.issuer.endpoint.query': f'resource=x&client_secret={MARK}',
    'proxy': ADDRESS,
}
MONITORING = {'token': MARK * 2}
TRACING = {'endpoint': ADDRESS}
HIDING: dict[str, dict[str, str]] = {
    'kafka': KAFKA,
    'schema_registry': REGISTRY,
    'monitoring': MONITORING,
    'tracing': TRACING,
}
NO_SECRETS: dict[type[Settings], set[str]] = {
    SchemaRegistrySettings: {
        'ssl.ca.location', 'ssl.certificate.location', 'ssl.key.location',
        'bearer.auth.credentials.source', 'bearer.auth.client.id', 'bearer.auth.scope',
        'bearer.auth.logical.cluster', 'bearer.auth.identity.pool.id', 'timeout', 'max.retries',
        'retries.wait.ms', 'retries.max.wait.ms',
    },
    MonitoringSettings: {'listen', 'allowed_hosts', 'node', 'start'},
    TracingSettings: {'sample', 'service'},
    Config: {'name', 'membership', 'ros', 'workers', 'defaults', 'routes'},
}  # fmt: skip

BEARER = {
    'bearer.auth.client.id': 'x',
    'bearer.auth.scope': 'x',
    'bearer.auth.logical.cluster': 'x',
}
ACCESS: dict[str, tuple[dict[str, str], tuple[str, ...]]] = {
    'password': (
        {'ssl.certificate.location': 'x', 'ssl.key.location': 'x'},
        ('url', 'basic.auth.user.info', 'ssl.key.password', 'proxy'),
    ),
    'token': (
        {'bearer.auth.logical.cluster': 'x', 'bearer.auth.credentials.source': 'STATIC_TOKEN'},
        ('url', 'bearer.auth.token'),
    ),
    'client': (
        {**BEARER, 'bearer.auth.credentials.source': 'OAUTHBEARER'},
        ('url', 'bearer.auth.client.secret', 'bearer.auth.issuer.endpoint.url'),
    ),
    'machine': (
        {
            'bearer.auth.logical.cluster': 'x',
            'bearer.auth.credentials.source': 'OAUTHBEARER_AZURE_IMDS',
        },
        ('url', 'bearer.auth.issuer.endpoint.url', 'bearer.auth.issuer.endpoint.query'),
    ),
}
"""How to get into a registry: what that needs besides, and what of it is to be hidden."""

ROUTES = [
    {
        'name': 'a',
        'format': 'text',
        'from': {'ros': '/a'},
        'to': {'kafka': 'a', 'properties': {'compression.type': 'zstd'}},
    }
]


def values(access: str = 'password') -> dict[str, Any]:
    """A configuration with a secret in all fields that may hold one."""
    more, hidden = ACCESS[access]
    return {
        'name': 'b',
        'kafka': {'bootstrap.servers': 'x:1', **KAFKA},
        'schema_registry': {**more, **{name: REGISTRY[name] for name in hidden}},
        'monitoring': MONITORING,
        'tracing': TRACING,
        'routes': ROUTES,
    }


def configured(found: dict[str, Any], mark: str = MARK) -> Config:
    return loads(json.dumps(found).replace(MARK, mark), 'x', {})


def hides(said: str) -> bool:
    return re.search(r'swordfish|31b0|77c2', said) is None


def test_every_field_either_hides_a_secret_here_or_holds_none() -> None:
    blocks: dict[type[Settings], Mapping[str, Any]] = {
        SchemaRegistrySettings: REGISTRY,
        MonitoringSettings: MONITORING,
        TracingSettings: TRACING,
        Config: HIDING,
    }
    for model, rows in blocks.items():
        assert set(rows) | NO_SECRETS[model] == set(field_names(model))
    assert {name for _, hidden in ACCESS.values() for name in hidden} == set(REGISTRY)
    secret = {name for name in KNOWN if is_secret(name) or re.search('url|proxy|query$', name)}
    assert secret <= set(KAFKA) | {'coordinator.query.interval.ms'}


@pytest.mark.parametrize('access', ACCESS)
def test_no_shown_configuration_shows_one(
    access: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = configured(values(access))
    assert MARK in str(config.kafka)
    assert hides(f'{config!r} {masked(config)}')
    assert masked(config)['schema_registry']['url'] == (
        'https://registry/?api_key=***, HTTP://other/?***'
    )
    assert report(config, tmp_path / 'b.yaml', connect=False) == 0
    said = capsys.readouterr().out
    assert hides(said)
    assert (
        'kafka sasl.oauthbearer.token.endpoint.url: https://***@host:8081/path?api_key=***' in said
    )


@pytest.mark.parametrize('access', ACCESS)
def test_no_reload_shows_one(access: str) -> None:
    one, two = (plan_of(configured(values(access), mark), Path('x')) for mark in (MARK, OTHER))
    bare = {'name': 'b', 'kafka': {'bootstrap.servers': 'x:1'}, 'routes': ROUTES}
    none = plan_of(configured(bare), Path('x'))
    changed = difference(one, two)
    assert 'schema_registry.url: has changed' in changed.lines
    assert 'tracing.endpoint: has changed' in changed.lines
    assert 'kafka.sasl.oauthbearer.token.endpoint.url: has changed' in changed.lines
    assert all(hides(str(it)) for it in (changed, difference(none, one), difference(one, none)))


def wrong_configurations(access: str) -> Iterator[dict[str, Any]]:
    """Each of those fields with a wrong value that holds its secret still."""
    whole = values(access)
    for block, rows in HIDING.items():
        for name in rows if block != 'schema_registry' else ACCESS[access][1]:
            for value in wrong_values(rows[name]):
                yield {**whole, block: {**whole[block], name: value}}


def wrong_values(value: str) -> list[Any]:
    wrong: list[Any] = [[value], {'a': value}, {value: 'a'}]
    if '://' in value:
        broken = f'https://me:{MARK}/{MARK}@host/'
        wrong += [value.replace('://', ':/'), f'https://host/?a={MARK} {MARK}', broken]
        wrong += [f'https://me:{MARK}\uff03@host/', f'https://[me:{MARK}@host/', f'me:{MARK}@host']
    return wrong


@pytest.mark.parametrize('access', ACCESS)
def test_no_mistake_shows_one(access: str) -> None:
    for found in wrong_configurations(access):
        try:
            config = configured(found)
        except ConfigError as error:
            said = f'{error}{error!r}{error.__cause__!r}{error.__context__!r}'
        else:
            said = f'{config!r}{masked(config)}'
        assert hides(said), found


@pytest.mark.parametrize(
    'servers',
    [
        f'me:{MARK}@host:9092',
        'me:swordfish,31b0@host:9092',
        f'PLAINTEXT://me:{MARK}@host:9092',
        f'https://host/?api_key={MARK}',
        f'https://me:{MARK}@host/',
    ],
)
def test_no_list_of_brokers_shows_one(servers: str, tmp_path: Path) -> None:
    file = tmp_path / 'b.yaml'
    whole = {'name': 'b', 'kafka': {'bootstrap.servers': servers}, 'routes': ROUTES}
    file.write_text(json.dumps(whole))
    status, out, err = typed('check', file)
    assert status == 2
    assert f'{file}:1: kafka.bootstrap.servers: ' in err
    assert hides(out + err)


def test_no_problem_of_librdkafka_shows_one() -> None:
    for name, value in KAFKA.items():
        assert hides(str(property_problems({name: value, 'acks': 'all'})))


def test_no_error_of_a_token_endpoint_shows_one() -> None:
    url = f'https://host/token?client_secret={MARK} {MARK}'
    for said in ('400', f'Failed to retrieve OIDC token from "{url}": no'):
        error = KafkaError(
            KafkaError._AUTHENTICATION, f'Failed to acquire SASL OAUTHBEARER token: {said}'
        )
        client = Client(properties={'sasl.oauthbearer.token.endpoint.url': url})
        text = str(translate(error, 'topic a', client))
        assert hides(text)
        assert 'https://host/token?client_secret=***' in text


# The Schema Registry


def test_no_error_of_a_registry_shows_one() -> None:
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))  # nobody listens there
        host = f'127.0.0.1:{taken.getsockname()[1]}'
        url = f'http://{host}/?api_key={MARK}'
        for more in ({}, {'proxy': f'http://me:{MARK}@{host}/?a={MARK}'}):
            for error in (encode_error(url, more), decode_error(url, b'\0\0\0\0\1x', more)):
                assert hides(str(error))
                assert f'Schema Registry http://{host}/?api_key=***' in str(error)


def test_no_answer_of_a_registry_shows_one() -> None:
    with RegistryServer() as server:
        body = {'error_code': 500, 'message': f'no {MARK}: GET /?api_key={MARK}'}
        server.answer(500, 1, json.dumps(body).encode())
        said = str(encode_error(f'{server.url}/?api_key={MARK}'))
    assert hides(said)
    assert 'no ***: GET /?api_key=***' in said


# The log


@pytest.mark.usefixtures('own_log')
@pytest.mark.parametrize('log_format', ['text', 'json'])
def test_no_line_of_the_log_shows_one_whoever_says_it(
    log_format: logs.LogFormat,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(logging, 'lastResort', logging.lastResort)
    logs.set_up(log_format)
    logs.route_log('a').warning('traces: not sent to %s', ADDRESS)
    logs.route_log('a').error('a bug', exc_info=ValueError(f'of {ADDRESS}'))
    monkeypatch.setattr(logging.root, 'handlers', [])  # those of pytest
    logging.getLogger('httpx').warning('HTTP Request: GET %s', ADDRESS)
    said = capfd.readouterr().err
    assert hides(said)
    assert said.count('https://***@host:8081/path?api_key=***') == 3
    last = said.splitlines()[-1]
    assert last.startswith('{') if log_format == 'json' else 'WARNING HTTP Request' in last


def test_a_server_that_repeats_what_it_refuses_shows_no_secret() -> None:
    name = 'sasl.oauthbearer.client'
    properties = {f'{name}.id': 'me', f'{name}.secret': MARK}
    header = base64.b64encode(f'me:{MARK}'.encode()).decode()
    said = f'Failed to acquire SASL OAUTHBEARER token: bad secret {MARK}, auth=Basic {header}'
    error = translate(
        KafkaError(KafkaError._AUTHENTICATION, said), 'topic t', Client('READ', properties)
    )
    assert hides(str(error))
    assert header not in str(error)
    assert 'check sasl.oauthbearer.token.endpoint.url' in str(error)
