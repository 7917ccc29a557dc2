"""A file that is only checked loads no code, runs no command, asks nobody, waits for nothing."""

import os
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path

import confluent_kafka
import pytest

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.properties import code_of_others
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.kafka.tls import check_files

TOKENS: Mapping[str, object] = {
    'security.protocol': 'SASL_PLAINTEXT',
    'sasl.mechanisms': 'OAUTHBEARER',
    'sasl.oauthbearer.method': 'oidc',
    'sasl.oauthbearer.client.id': 'a',
    'sasl.oauthbearer.client.secret': 'hunter2',
}
SOURCE = 'sasl.oauthbearer.metadata.authentication.type'
SETTINGS = 'sasl.oauthbearer.config'
FILES = (
    'ssl.ca.location', 'ssl.certificate.location', 'ssl.key.location', 'ssl.crl.location',
    'ssl.keystore.location', 'https.ca.location', 'sasl.oauthbearer.assertion.file',
    'sasl.oauthbearer.assertion.jwt.template.file',
    'sasl.oauthbearer.assertion.private.key.file',
)  # fmt: skip


PEM = '-----BEGIN PRIVATE KEY-----\nhunter2\n-----END PRIVATE KEY-----\n'


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    """The settings of each client that is made; none is really."""
    found: list[dict[str, object]] = []

    class Noted:
        def __init__(self, given: dict[str, object], **_more: object) -> None:
            if '-' in given:  # with a name that is none, no client is made
                raise ValueError('No such configuration property: "-"')
            found.append(given)

        def flush(self, _timeout: float) -> None: ...
        def close(self) -> None: ...

    for kind in ('Producer', 'Consumer'):
        monkeypatch.setattr(confluent_kafka, kind, Noted)
    return found


def test_what_would_run_code_of_others_reaches_no_client(made: list[dict[str, object]]) -> None:
    code: dict[str, object] = {
        'bootstrap.servers': 'localhost:9092',
        'metadata.broker.list': 'localhost:9092',
        'ssl.engine.location': '/no/engine.so',
        'ssl.providers': 'default,../no/provider',
        'sasl.kerberos.kinit.cmd': 'exit',
        SOURCE: 'aws_iam',
    }
    assert property_problems({**TOKENS, 'ssl.engine.id': 'mine', **code}).keys() <= {SOURCE}
    assert len(made) == 3
    for given in made:
        assert not given.keys() & code.keys()
        assert given['sasl.kerberos.min.time.before.relogin'] == 0


def test_what_would_load_code_of_others_is_not_tried() -> None:
    code = {'ssl.engine.location': '/no/engine.so', 'ssl.providers': 'default,../no/provider'}
    assert property_problems({'security.protocol': 'ssl', **code}) == {}


def test_a_key_that_only_a_provider_may_read_is_not_tried_without_it(tmp_path: Path) -> None:
    store = tmp_path / 'store.p12'
    store.write_bytes(b'of a provider')
    files: dict[str, object] = {
        'security.protocol': 'ssl',
        'ssl.keystore.location': str(store),
        'ssl.keystore.password': 'hunter2',
    }
    assert list(property_problems(files)) == ['ssl.keystore.location']
    assert property_problems({**files, 'ssl.providers': 'legacy'}) == {}


@pytest.mark.parametrize(
    ('name', 'meant'),
    [
        ('ssl.engine.locatio', 'ssl.engine.location'),
        ('ssl.provider', 'ssl.providers'),
        ('sasl.kerberos.kinit.cmdd', 'sasl.kerberos.kinit.cmd'),
    ],
)
def test_a_misspelled_name_is_found_though_it_is_not_tried(name: str, meant: str) -> None:
    problem = f"librdkafka knows no such property (did you mean '{meant}'?)"
    assert property_problems({name: 'x', 'security.protocol': 'ssl'}) == {name: problem}


@pytest.mark.parametrize('name', FILES)
def test_what_is_no_file_is_not_opened(name: str, tmp_path: Path) -> None:
    pipe, large = tmp_path / 'pipe', tmp_path / 'large'
    os.mkfifo(pipe)
    with large.open('wb') as file:
        file.truncate(1 << 40)
    said = 'not a regular file: no pipe, socket or device is read here'
    asked = {'security.protocol': 'ssl', 'ssl.keystore.password': 'abc'}
    for path in (pipe, Path('/dev/zero')):
        assert property_problems({**asked, name: str(path)}) == {name: f'{path}: {said}'}
    found = property_problems({**asked, name: str(large)})
    assert found == {name: f'{large}: larger than 16777216 bytes: is it the right file?'}


@pytest.mark.parametrize('name', FILES)
@pytest.mark.parametrize(
    ('value', 'said'),
    [
        (PEM, 'holds the text of a file: '),
        (PEM.replace('\n', ' '), 'holds the text of a file: '),
        ('hunter2' * 50, 'File name too long'),
        ('/etc/passwd/hunter', '/etc/passwd/hunter: Not a directory'),
        ('/no/file', '/no/file: no such file'),
    ],
)
def test_what_names_no_file_is_told_and_a_key_never_quoted(
    name: str, value: str, said: str
) -> None:
    asked = {'security.protocol': 'ssl', 'ssl.keystore.password': 'abc'}
    found = property_problems({**asked, name: value})
    assert found[name].startswith(said)
    with pytest.raises(RouteError) as caught:
        check_files({name: value}, 'topic a')
    assert 'hunter2' not in f'{found}{caught.value}'
    assert str(caught.value).startswith(f'topic a: {name}: {said}')


def test_the_text_of_a_file_is_told_where_it_belongs() -> None:
    belongs = 'holds the text of a file: that belongs in ssl.key.pem'
    assert property_problems({'ssl.key.location': PEM}) == {'ssl.key.location': belongs}
    other = 'holds the text of a file: write the name of the file here'
    assert property_problems({'ssl.crl.location': PEM}) == {'ssl.crl.location': other}


def test_an_empty_name_names_no_file() -> None:
    files: dict[str, object] = dict.fromkeys(FILES, '')
    assert property_problems({'security.protocol': 'ssl', **files}) == {}
    check_files(files, 'topic a')


def test_a_pipe_is_not_waited_for_where_a_client_is_made(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(RouteError, match=r'ssl\.key\.location: .*/pipe: not a regular file'):
        check_files({'ssl.key.location': f'{tmp_path}/pipe'}, 'topic a')


def test_authorities_may_lie_in_a_folder_or_be_looked_for(tmp_path: Path) -> None:
    for place in (str(tmp_path), 'probe'):
        authorities = {'ssl.ca.location': place, 'https.ca.location': place}
        assert property_problems({'security.protocol': 'ssl', **authorities}) == {}
    found = property_problems({'security.protocol': 'ssl', 'ssl.key.location': str(tmp_path)})
    assert found == {'ssl.key.location': f'{tmp_path}: a directory: name the file in it'}


@pytest.fixture
def proxy(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """What the environment names as a proxy; nobody answers there."""
    with closing(socket.create_server(('127.0.0.1', 0))) as server:
        server.settimeout(0)
        address = f'http://127.0.0.1:{server.getsockname()[1]}'
        for name in ('http_proxy', 'https_proxy', 'all_proxy'):
            monkeypatch.setenv(name, address)
        yield server


@pytest.mark.parametrize(
    'source',
    [
        {'sasl.oauthbearer.token.endpoint.url': 'http://login.example.org/token'},
        {SOURCE: 'azure_imds', SETTINGS: 'query=resource=x'},
    ],
)
def test_no_proxy_is_given_the_secret_to_find_problems(
    proxy: socket.socket, source: dict[str, object]
) -> None:
    assert property_problems({**TOKENS, **source}) == {}
    time.sleep(0.05)  # it would be asked by a thread of the client
    with pytest.raises(BlockingIOError):
        proxy.accept()


@pytest.mark.parametrize(
    ('given', 'problem'),
    [
        ({}, f'needs {SETTINGS}, such as region=eu-central-1,audience=https://kafka'),
        ({SETTINGS: 'region=x'}, "needs boto3: pip install 'confluent-kafka[oauthbearer-aws]'"),
        ({'sasl.oauthbearer.method': 'default'}, 'needs sasl.oauthbearer.method: oidc'),
        ({'sasl.oauthbearer.method': 'OIDC'}, 'needs sasl.oauthbearer.method: oidc'),
        ({SOURCE: 'AWS_IAM'}, 'confluent-kafka knows one spelling of it: aws_iam'),
    ],
)
def test_what_a_token_of_aws_needs_is_said_and_nobody_asked(
    given: dict[str, object], problem: str
) -> None:
    assert property_problems({**TOKENS, SOURCE: 'aws_iam', **given}) == {SOURCE: problem}


@pytest.mark.parametrize('spelled', ['AWS_IAM', ' aws_iam '])
def test_what_confluent_kafka_does_not_take_for_aws_is_refused_and_loads_nothing(
    spelled: str,
) -> None:
    given = {**TOKENS, SETTINGS: 'region=x', SOURCE: spelled}
    assert 'boto3' not in property_problems(given)[SOURCE]
    assert list(code_of_others({SOURCE: spelled})) == []
    assert list(code_of_others({SOURCE: 'aws_iam'})) != []


def test_so_many_properties_are_no_properties() -> None:
    many: dict[str, object] = {f'linger.ms{number}': 1 for number in range(1001)}
    expected = {'linger.ms1000': 'more than 1000 properties: librdkafka knows some 200'}
    assert property_problems(many) == expected


def test_the_properties_of_a_sink_are_judged_beside_those_of_all() -> None:
    assert property_problems({'acks': 1}, {'enable.idempotence': True}).keys() == {'acks'}
    assert property_problems({'acks': 1}, {}) == {}
    assert property_problems({'-': 1}, {}) == {'-': 'librdkafka knows no such property'}
