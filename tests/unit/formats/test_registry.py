"""The Schema Registry's client: its properties, and what its errors become."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from support.formats.avro import (
    ROBOT,
    avro_bytes,
    cdr_from,
    fields_of,
    framed,
    json_text,
    scope_of,
)
from support.registry.answers import ONCE, SECRET, decode_error, encode_error
from support.registry.server import RegistryServer

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import BridgeError, ConfigError, DecodeError, RouteError
from ros2_kafka_bridge.formats import registry
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.registry import framed_id, open_registry
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive, String


@pytest.fixture
def server() -> Iterator[RegistryServer]:
    with RegistryServer() as one:
        yield one


@pytest.mark.parametrize(
    ('properties', 'said'),
    [
        ({'timeout': 3}, 'Missing required configuration property url'),
        ({'url': 'http://h', 'basic.auth': 'a'}, 'Unrecognized properties: basic.auth'),
        ({'url': 'localhost:8081'}, 'schema_registry: Invalid url localhost:8081'),
        ({'url': 'http://h', 'ssl.ca.location': '/none.pem'}, r'ssl\.ca\.location: no such file'),
        (
            {'url': 'http://h', 'ssl.key.location': 'k.pem'},
            r'schema_registry: ssl\.certificate\.location required',
        ),
        ({'url': 'http://h', 'basic.auth.user.info': SECRET}, 'basic.auth.user.info must be in'),
        ({'url': f'http://me:{SECRET}@h', 'basic.auth.user.info': f'me:{SECRET}'}, 'userinfo'),
        ({'url': f'ftp://me:{SECRET}@h'}, r'Invalid url ftp://\*\*\*@h'),
    ],
)
def test_what_the_client_refuses_is_a_mistake_in_the_file(
    properties: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError, match=said) as raised:
        open_registry(Scope('robots', registry=properties))
    assert SECRET not in str(raised.value)


def test_a_proxy_that_needs_another_package_is_a_mistake_in_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proxy = f'socks5://me:{SECRET}@localhost:1'
    with pytest.raises(ConfigError, match='SOCKS') as raised:
        open_registry(Scope('robots', registry={'url': 'http://h', 'proxy': proxy}))
    assert SECRET not in str(raised.value)
    monkeypatch.setenv('ALL_PROXY', proxy)
    with pytest.raises(ConfigError, match='SOCKS'):
        open_registry(Scope('robots', registry={'url': 'http://h'}))


@pytest.mark.parametrize(
    'properties',
    [
        {'url': f'http://e:{SECRET}@h'},
        {'url': 'http://h', 'basic.auth.user.info': f'e:{SECRET}'},
    ],
)
def test_a_password_is_hidden_and_a_user_of_one_letter_hides_nothing(
    properties: dict[str, Any],
) -> None:
    opened = open_registry(Scope('robots', registry=properties))
    assert SECRET not in repr(opened)
    said = opened.mask.sub('***', f'Connection refused for e:{SECRET} ({SECRET})')
    assert said == 'Connection refused for *** (***)'
    opened.client.close()


def test_a_schema_that_is_not_there_may_be_there_with_its_docs(
    server: RegistryServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, 'has_parser', lambda: False)
    said = str(encode_error(server.url, auto_register=False))
    assert 'the docs of a type belong to its schema, and are left out here' in said
    assert 'rosidl_adapter' in said


def test_a_route_with_a_registry_needs_one() -> None:
    with pytest.raises(ConfigError) as raised:
        make_encode(ROBOT, Scope('robots'))
    assert str(raised.value) == (
        'no Schema Registry: add schema_registry: {url: ...} to the file, or '
        'schema: {registry: false} to the route'
    )


def test_formats_without_a_schema_load_nothing_for_one() -> None:
    program = (
        'import sys; import ros2_kafka_bridge.formats.avro, ros2_kafka_bridge.formats.registry\n'
        'heavy = {"fastavro", "httpx", "httpx2", "confluent_kafka.schema_registry"}\n'
        'assert not heavy & set(sys.modules), heavy & set(sys.modules)'
    )
    subprocess.run([sys.executable, '-c', program], check=True)


@pytest.mark.parametrize('local', [True, False])
@pytest.mark.parametrize('make', [make_encode, make_decode])
def test_a_route_without_the_extra_says_what_to_install(
    make: Callable[..., object], monkeypatch: pytest.MonkeyPatch, *, local: bool
) -> None:
    monkeypatch.setitem(sys.modules, 'fastavro', None)
    scope = Scope('t', schema=SchemaSettings(registry=not local), registry={'url': 'http://h'})
    with pytest.raises(ConfigError, match=r'fastavro.* -m pip install .*\[avro\]'):
        make(ROBOT, scope)


def test_an_incompatible_schema_shows_what_the_registry_says(server: RegistryServer) -> None:
    old = Layout(ROBOT.type_name, (Field('level', String()), *ROBOT.fields[2:]))
    server.register('robots-value', json_text(avro_schema(old)))
    error = encode_error(server.url)
    assert isinstance(error, ConfigError)
    said = str(error)
    assert said.startswith(
        f'Schema Registry {server.url}, subject robots-value: the schema is not compatible with '
        'the versions that are there; use another subject'
    )
    assert "errorType:'TYPE_MISMATCH'" in said
    assert 'reader type: int not compatible with writer type: string' in said
    assert '{oldSchemaVersion: 1}' in said
    assert len(server.versions('robots-value')) == 1


@pytest.mark.parametrize(
    ('level', 'more', 'fits'),
    [
        ('BACKWARD', True, True),
        ('FORWARD', True, True),
        ('FULL_TRANSITIVE', True, True),
        ('FULL', False, False),
        ('NONE', False, True),
    ],
)
def test_a_field_may_come_or_go_but_not_change(
    server: RegistryServer, level: str, *, more: bool, fits: bool
) -> None:
    server.set_compatibility(level)
    make_encode(ROBOT, scope_of(server.url))
    extra = (Field('battery', Primitive('float32')),)
    changed = Layout(ROBOT.type_name, (*ROBOT.fields[2:], *extra))
    if not more:
        changed = Layout(ROBOT.type_name, (Field('name', Primitive('int8')), *ROBOT.fields[1:]))
    if fits:
        make_encode(changed, scope_of(server.url))
        assert len(server.versions('robots-value')) == 2
    else:
        with pytest.raises(ConfigError, match='is not compatible'):
            make_encode(changed, scope_of(server.url))


@pytest.mark.parametrize(
    ('status', 'kind', 'said'),
    [
        (
            401,
            RouteError,
            r'status 401\): it refuses this login, or wants one: look at basic.auth.user.info',
        ),
        (403, RouteError, r'status 403\): this user may not do that'),
        (404, RouteError, r'status 404\); does url name a Schema Registry\?'),
        (405, RouteError, r'status 405\); does url name a Schema Registry\?'),
        (429, RouteError, r'status 429\): it has too many requests for now'),
        (500, RouteError, r'told to answer 500 \(status 500\)$'),
        (503, RouteError, r'told to answer 503 \(status 503\)$'),
        (422, ConfigError, r'subject robots-value: the registry does not take the schema: told'),
    ],
)
def test_an_answer_that_is_no_success_says_what_to_do(
    server: RegistryServer, status: int, kind: type[BridgeError], said: str
) -> None:
    server.answer(status)
    error = encode_error(server.url)
    assert type(error) is kind
    assert error.args[0].startswith(f'Schema Registry {server.url}, subject robots-value: ')
    with pytest.raises(kind, match=said):
        raise error


@pytest.mark.parametrize('status', [401, 403, 404, 429, 500, 503])
def test_no_record_is_lost_to_a_registry_that_is_unwell(
    server: RegistryServer, status: int
) -> None:
    """A 404 that is not the registry's own says nothing about the record."""
    value = framed(
        server.register('robots-value', json_text(avro_schema(ROBOT))),
        avro_bytes(avro_schema(ROBOT), fields_of(cdr_from(ROBOT, {}), ROBOT)),
    )
    decode = make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    server.answer(status)
    with pytest.raises(RouteError, match=rf'schema 1: told to answer {status}'):
        decode(value)
    assert decode(value) == cdr_from(ROBOT, {})


def test_a_short_fault_is_no_fault(server: RegistryServer) -> None:
    server.answer(503)
    assert make_encode(ROBOT, scope_of(server.url))(cdr_from(ROBOT, {}))
    assert len(server.requests) == 2


def test_a_registry_that_is_read_only_says_so(server: RegistryServer) -> None:
    server.read_only = True
    error = encode_error(server.url)
    assert type(error) is RouteError
    assert 'the registry is read-only (Subject robots-value is in read-only mode)' in str(error)
    # What is there already may be used.
    server.read_only = False
    make_encode(ROBOT, scope_of(server.url))
    server.read_only = True
    assert make_encode(ROBOT, scope_of(server.url))(cdr_from(ROBOT, {}))


def test_a_subject_that_this_user_may_not_write_says_so(server: RegistryServer) -> None:
    server.forbidden = {'robots-value'}
    error = encode_error(server.url)
    assert type(error) is RouteError
    assert 'denied operation Write on Subject: robots-value (status 403): this user' in str(error)


@pytest.mark.parametrize(
    ('body', 'said'),
    [
        (b'<html>', 'answers with something else than JSON: does url name a Schema Registry?'),
        (b'[]', 'answers with something else than a registry does'),
        (b'{}', 'answers with something else than a registry does'),
        (b'', 'answers with something else than a registry does'),
        (b'7', 'answers with something else than a registry does'),
    ],
)
def test_something_else_at_the_url_says_so(server: RegistryServer, body: bytes, said: str) -> None:
    server.answer(200, 1, body)
    error = encode_error(server.url)
    assert type(error) is RouteError
    assert said in str(error)
    server.answer(200, 1, body)
    error = decode_error(server.url, framed(1, b'\0'))
    assert type(error) is RouteError
    assert said in str(error)


def test_nobody_at_the_url_says_so(server: RegistryServer) -> None:
    url = server.url
    server.stop()
    error = encode_error(url)
    assert type(error) is RouteError
    assert str(error).startswith(f'Schema Registry {url}: does not answer (ConnectError: ')


def test_a_registry_that_hangs_is_left(server: RegistryServer) -> None:
    server.hang()
    error = encode_error(server.url, {'timeout': 0.5})
    assert type(error) is RouteError
    assert 'does not answer (ReadTimeout' in str(error)


def test_a_second_url_is_asked_where_the_first_is_away(server: RegistryServer) -> None:
    with RegistryServer() as gone:
        away = gone.url
    scope = scope_of(f'{away},{server.url}', 'robots', ONCE)
    assert make_encode(ROBOT, scope)(cdr_from(ROBOT, {}))


def test_a_name_that_nobody_knows_says_so() -> None:
    error = encode_error('http://nobody.invalid')
    assert type(error) is RouteError
    assert str(error).startswith('Schema Registry http://nobody.invalid: does not answer')


@pytest.mark.parametrize('value', [b'', b'\0\0\0\1', b'\1\0\0\0\1', b'"a":1'])
def test_a_value_without_the_id_of_a_schema_has_none(value: bytes) -> None:
    with pytest.raises(DecodeError, match=r'was it written without a Schema Registry\?'):
        framed_id(value)


def test_the_id_of_a_schema_is_read() -> None:
    assert framed_id(framed(2**31 - 1, b'')) == 2**31 - 1
