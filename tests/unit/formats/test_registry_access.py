"""Who may ask a Schema Registry, and whether it is the one that is trusted."""

import ssl
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import trustme
from support.formats.avro import ROBOT, cdr_from, framed, scope_of
from support.registry.answers import SECRET, decode_error, encode_error
from support.registry.server import RegistryServer

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.scope import Scope


@pytest.fixture
def authority() -> trustme.CA:
    return trustme.CA()


@pytest.fixture
def trusted(authority: trustme.CA, tmp_path: Path) -> str:
    """A file with the certificate of the authority."""
    file = tmp_path / 'ca.pem'
    authority.cert_pem.write_to_path(file)
    return str(file)


def tls_of(authority: trustme.CA, name: str = '127.0.0.1') -> ssl.SSLContext:
    """How a server speaks TLS whose certificate is for this name."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert(name).configure_cert(context)
    return context


@pytest.fixture
def users() -> Iterator[RegistryServer]:
    with RegistryServer(users={'bridge': f'{SECRET}:with colon'}) as one:
        yield one


def in_properties(server: RegistryServer) -> Scope:
    info = {'basic.auth.user.info': f'bridge:{SECRET}:with colon'}
    return scope_of(server.url, 'robots', info)


def in_url(server: RegistryServer) -> Scope:
    return scope_of(server.url.replace('://', f'://bridge:{SECRET}%3Awith%20colon@'))


@pytest.mark.parametrize('scope', [in_properties, in_url])
def test_who_the_registry_knows_may_ask(
    users: RegistryServer, scope: Callable[[RegistryServer], Scope]
) -> None:
    value = cdr_from(ROBOT, {})
    assert make_decode(ROBOT, scope(users))(make_encode(ROBOT, scope(users))(value)) == value


@pytest.mark.parametrize('properties', [{}, {'basic.auth.user.info': f'bridge:{SECRET}'}])
def test_who_the_registry_does_not_know_is_told_so(
    users: RegistryServer, properties: dict[str, Any]
) -> None:
    error = encode_error(users.url, properties)
    assert type(error) is RouteError
    assert 'Unauthorized (status 401): it refuses this login, or wants one' in str(error)
    assert SECRET not in str(error)
    assert type(decode_error(users.url, framed(1, b''), properties)) is RouteError


def test_a_password_in_the_url_is_never_shown(server: RegistryServer) -> None:
    url = server.url.replace('://', f'://bridge:{SECRET}@')
    body = f'{{"error_code": 500, "message": "for bridge:{SECRET}"}}'.encode()
    server.answer(500, 1, body)
    said = str(encode_error(url))
    shown = server.url.replace('://', '://***@')
    assert said == f'Schema Registry {shown}, subject robots-value: for *** (status 500)'


def test_tls_to_a_registry_that_is_trusted(authority: trustme.CA, trusted: str) -> None:
    with RegistryServer(tls=tls_of(authority)) as server:
        assert server.url.startswith('https://')
        scope = scope_of(server.url, 'robots', {'ssl.ca.location': trusted})
        value = cdr_from(ROBOT, {})
        assert make_decode(ROBOT, scope)(make_encode(ROBOT, scope)(value)) == value


def test_a_registry_that_is_not_trusted_says_so(authority: trustme.CA) -> None:
    with RegistryServer(tls=tls_of(authority)) as server:
        error = encode_error(server.url)
        assert type(error) is RouteError
        assert 'its certificate is not trusted: name the CA in ssl.ca.location' in str(error)


def test_a_certificate_of_another_name_says_so(authority: trustme.CA, trusted: str) -> None:
    with RegistryServer(tls=tls_of(authority, 'registry.example')) as server:
        error = encode_error(server.url, {'ssl.ca.location': trusted})
        assert type(error) is RouteError
        assert 'its certificate is for another name than the one in url' in str(error)


def test_tls_to_a_registry_that_speaks_none_says_so(server: RegistryServer) -> None:
    error = encode_error(server.url.replace('http:', 'https:'))
    assert type(error) is RouteError
    assert 'try http:// in url' in str(error)


def test_a_registry_may_ask_for_a_certificate(
    authority: trustme.CA, trusted: str, tmp_path: Path
) -> None:
    context = tls_of(authority)
    context.verify_mode = ssl.CERT_REQUIRED
    authority.configure_trust(context)
    file = tmp_path / 'client.pem'
    authority.issue_cert('bridge').private_key_and_cert_chain_pem.write_to_path(file)
    with RegistryServer(tls=context) as server:
        known = {'ssl.ca.location': trusted, 'ssl.certificate.location': str(file)}
        make_encode(ROBOT, scope_of(server.url, 'robots', known))
        assert len(server.versions('robots-value')) == 1
        assert type(encode_error(server.url, {'ssl.ca.location': trusted})) is RouteError
