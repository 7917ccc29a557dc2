"""A file is judged soon, whatever it holds: what it names is bounded, and what it is made of."""

import os
import re
import socket
import threading
from collections.abc import Mapping
from pathlib import Path

import pytest

from ros2_kafka_bridge.config import settings, tree, validation
from ros2_kafka_bridge.config.checks import cycles
from ros2_kafka_bridge.config.file import load, loads
from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD
from ros2_kafka_bridge.config.settings import Config, warnings
from ros2_kafka_bridge.config.tree import DEPTH_LIMIT, YamlError, read_yaml
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.message_types import type_names

EXAMPLE = """\
name: b
kafka: {bootstrap.servers: 'localhost:9092', client.id: x}
routes:
- {name: a, from: {ros: /a}, to: {kafka: a}, format: text}
"""


def problems_of(text: str, file: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        loads(text, str(file), {}, check_kafka=lambda _given, _common: {})
    return caught.value.problems


@pytest.mark.parametrize('kind', ['pipe', 'socket', 'device', 'link to a pipe'])
def test_a_secret_is_read_of_a_regular_file_alone(kind: str, tmp_path: Path) -> None:
    path = tmp_path / 'secret'
    os.mkfifo(tmp_path / 'pipe')
    if kind == 'socket':
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(str(path))
    else:
        path.symlink_to('/dev/zero' if kind == 'device' else 'pipe')
    text = EXAMPLE.replace('client.id: x', 'client.id: "${file:secret}"')
    said = 'not a regular file: no pipe, socket or device is read here'
    [problem] = problems_of(text, tmp_path / 'b.yaml')
    assert problem == f'{tmp_path}/b.yaml:2: kafka.client.id: the file {path}: {said}'


def test_a_secret_may_be_linked_as_those_of_kubernetes_and_lie_in_proc(tmp_path: Path) -> None:
    (tmp_path / '..data').mkdir()
    (tmp_path / '..data' / 'secret').write_text('hunter2\n')
    (tmp_path / 'secret').symlink_to('..data/secret')
    text = EXAMPLE.replace('client.id: x', 'client.id: "${file:secret}${file:/proc/self/comm}"')
    comm = Path('/proc/self/comm').read_text().strip()
    assert loads(text, str(tmp_path / 'b.yaml'), {}).kafka['client.id'] == f'hunter2{comm}'


def test_a_name_that_no_file_can_have_is_a_mistake(tmp_path: Path) -> None:
    text = EXAMPLE.replace('client.id: x', 'client.id: "${file:a\\0b}"')
    [problem] = problems_of(text, tmp_path / 'b.yaml')
    assert problem.startswith(f'{tmp_path}/b.yaml:2:')


# librdkafka reads up to the NUL: a plugin that was loaded, a key that was shown, a pipe.
@pytest.mark.parametrize(
    'wrong',
    [
        r'"plugin.library.paths\0x": /x.so',
        r'"ssl.key.pem\0": SECRET',
        r'"ssl.ca.location\0": /fifo',
        r'client.id: "a\0b"',
        r'"client.id\ud800": a',
        r'client.id: "\ud800"',
    ],
)
def test_a_nul_or_half_a_character_is_nowhere_in_a_file(wrong: str) -> None:
    text = EXAMPLE.replace('client.id: x', wrong)
    [problem] = problems_of(text, Path('b.yaml'))
    assert re.match(r'b\.yaml:2:\d+: a NUL, or a character that is none', problem)


@pytest.mark.parametrize('name', ['acks ', 'ssl.key.pem=', 'äcks', ''])
def test_a_name_that_no_property_has_reaches_no_client(name: str) -> None:
    text = EXAMPLE.replace('client.id: x', f'"{name}": x')
    [problem] = problems_of(text, Path('b.yaml'))
    assert problem.endswith('is refused: no property has such a name')
    assert property_problems({name: 'x'}) == {}


def test_what_is_no_text_comes_from_no_reference(tmp_path: Path) -> None:
    (tmp_path / 'key').write_bytes(b'a\0b')
    text = EXAMPLE.replace('client.id: x', 'client.id: "${LATIN}", client.rack: "${file:key}"')
    with pytest.raises(ConfigError) as caught:
        loads(text, str(tmp_path / 'b.yaml'), {'LATIN': os.fsdecode(b'pass\xe9')})
    first, second = caught.value.problems
    assert first.endswith('kafka.client.id: the variable LATIN is not UTF-8')
    assert second.endswith('it holds a NUL: it is no text')


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        (f'x: &x "{"$a" * 200_000}"\ny: [{"*x, " * 30_000}]', 'more than 4194304 characters'),
        (f'x: &x {"n" * 400_000}\ny: [{"{*x : 1}, " * 5000}]', 'more than 4194304 characters'),
        (f'x: {"9" * 5000}', 'a number of more than 400 characters'),
        (f'%YAML 1.1\n---\nx: {"1:" * 100_000}1', 'a number of more than 400 characters'),
        ('x: !!int ""', 'a value that does not fit its tag'),
        ('x: !!float ""', 'a value that does not fit its tag'),
        (r'x: "\UFFFFFFFF"', 'not YAML'),
        (r'x: "\U00110000"', 'not YAML'),
    ],
)
def test_what_would_take_hours_or_end_the_reader_is_told(text: str, said: str) -> None:
    with pytest.raises(YamlError) as caught:
        read_yaml(text)
    assert said in str(caught.value)


def test_the_file_itself_may_be_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / 'b.yaml'
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=(EXAMPLE,))
    writer.start()
    assert load(pipe, {}).name == 'b'
    writer.join()


def test_a_file_of_the_schema_registry_is_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    registry = f'schema_registry: {{url: "http://r", ssl.ca.location: {tmp_path}/pipe}}\n'
    [problem] = problems_of(EXAMPLE + registry, tmp_path / 'b.yaml')
    assert 'schema_registry.ssl.ca.location: not a regular file' in problem
    text = EXAMPLE + registry.replace('/pipe', '')
    assert loads(text, 'b.yaml', {}, check_kafka=lambda _given, _common: {})


@pytest.mark.parametrize(
    ('path', 'said'),
    [
        ('x' * 300, 'File name too long'),
        ('/etc/passwd/x', 'Not a directory'),
        ('-----BEGIN CERTIFICATE-----\\nMIIB', 'holds the text of a file: write the name of'),
    ],
)
@pytest.mark.parametrize('name', ['ssl.ca.location', 'ssl.certificate.location'])
def test_what_can_name_no_file_of_the_schema_registry_is_a_mistake(
    name: str, path: str, said: str
) -> None:
    registry = f'schema_registry: {{url: "http://r", {name}: "{path}"}}\n'
    [problem] = problems_of(EXAMPLE + registry, Path('b.yaml'))
    assert problem.startswith(f'b.yaml:5: schema_registry.{name}: {said}')


def test_a_folder_whose_name_is_too_long_is_no_folder() -> None:
    folders = f'ros: {{message_path: [{"x" * 300}]}}\n'
    [problem] = problems_of(EXAMPLE + folders, Path('b.yaml'))
    assert problem == 'b.yaml:5: ros.message_path[0]: no such folder'
    with pytest.raises(ConfigError, match='there is no such folder'):
        type_names([Path('x' * 300)])


@pytest.mark.parametrize('within', ['{}', 'defaults: {{{}}}'])
def test_hints_are_given_for_as_many_mistakes_as_are_told(
    within: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def near(word: str, _known: object) -> str:
        asked.append(word)
        return ''

    for module in (settings, validation):
        monkeypatch.setattr(module, 'near', near)
    comma = ', ' if within.startswith('d') else '\n'
    many = comma.join(f'f{number}: 1' for number in range(MISTAKES_TOLD + 50))
    assert len(problems_of(EXAMPLE + within.format(many), Path('b.yaml'))) == MISTAKES_TOLD + 1
    assert len(asked) == MISTAKES_TOLD


@pytest.mark.parametrize(
    ('text', 'line', 'column'),
    [
        ('[' + '[],' * 200, 1, 299),
        ('a: &a x\nb: [' + '*a,' * 200, 2, 299),
        ('{' + 'a: 1, ' * 200, 1, 599),
        ('- 1\n' * 200 + ']', 100, 3),
        ('? a\n' * 200 + ']', 100, 1),
    ],
)
def test_the_value_that_is_too_many_is_told_before_the_rest_is_read(
    text: str, line: int, column: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tree, 'VALUE_LIMIT', 100)
    with pytest.raises(YamlError, match='more than 100 values') as caught:
        read_yaml(text)  # ends in the middle: whoever reads on says that it is not YAML
    assert abs(caught.value.line - line) <= 1
    assert line > 1 or caught.value.column >= column - 3


@pytest.mark.parametrize('text', ['[' * 200, '- ' * 200, '{a: ' * 200, '[{a: ' * 100])
def test_what_lies_too_deep_is_told_where_it_begins(text: str) -> None:
    with pytest.raises(YamlError, match='nested too deeply') as caught:
        read_yaml(text)
    assert caught.value.column == _column(text)


def _column(text: str) -> int:
    """Of what lies in one more than are allowed, from 1."""
    starts = [place for place, char in enumerate(text) if char in '[{-']
    return starts[DEPTH_LIMIT + 1] + 1


@pytest.mark.parametrize('text', ['? [a]\n: b\n]', '{{a: b}: c', '? {a: b\n'])
def test_a_name_of_many_parts_is_told_before_the_rest_is_read(text: str) -> None:
    with pytest.raises(YamlError, match='a list or mapping as the name of a field'):
        read_yaml(text)


def routes(*properties: Mapping[str, object]) -> str:
    kept = [
        f'- {{name: r{n}, from: {{ros: /r{n}}}, to: {{kafka: t{n}, properties: {dict(own)}}}, '
        'format: text}\n'
        for n, own in enumerate(properties)
    ]
    return EXAMPLE.partition('- ')[0] + ''.join(kept)


def test_sinks_of_the_same_properties_are_tried_once() -> None:
    asked = []

    def check(given: Mapping[str, object], common: Mapping[str, object] | None) -> dict[str, str]:
        asked.append((dict(given), common and dict(common)))
        return dict.fromkeys(given, 'no') if 'acks' in given else {}

    text = routes({'acks': 1}, {'linger.ms': 2}, {'acks': 1}, {'client.id': 'y'})
    with pytest.raises(ConfigError) as caught:
        loads(text, 'b.yaml', {}, check_kafka=check)
    assert caught.value.problems == [
        'b.yaml:4: routes[0].to.properties.acks: no',
        'b.yaml:6: routes[2].to.properties.acks: no',
    ]
    shared = {'bootstrap.servers': 'localhost:9092', 'client.id': 'x'}
    assert asked == [
        (shared, None),
        ({'acks': 1}, shared),
        ({'linger.ms': 2}, shared),
        ({'client.id': 'y'}, {'bootstrap.servers': 'localhost:9092'}),
    ]


def test_sinks_beyond_so_many_different_ones_are_not_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settings, '_SINKS_LIMIT', 2)
    asked = []

    def note(given: Mapping[str, object], _: object) -> dict[str, str]:
        asked.append(given)
        return {}

    own = [{'client.id': f'x{n}'} for n in (0, 1, 0, 2, 3, 1)]
    loads(routes(*own), 'b.yaml', {}, check_kafka=note)
    assert asked[1:] == own[:2]


def test_only_the_first_cycles_are_told() -> None:
    edges = [(0, 'a', 'b'), *((number, 'b', 'a') for number in range(1, MISTAKES_TOLD + 50))]
    assert len(cycles(edges)) == MISTAKES_TOLD


def test_code_of_others_that_a_start_would_load_is_told() -> None:
    code = {
        'ssl.engine.location': '/opt/engine.so',
        'ssl.providers': 'legacy',
        'sasl.kerberos.kinit.cmd': 'hunter2',
        'sasl.oauthbearer.metadata.authentication.type': 'aws_iam',
    }
    given = EXAMPLE.replace('client.id: x', ', '.join(f'{n}: {v}' for n, v in code.items()))
    then = 'where the bridge connects to Kafka (run, check --connect), never by a plain check'
    found: Config = loads(given, 'b.yaml', {})
    assert warnings(found) == [
        f'kafka.ssl.engine.location: /opt/engine.so: code of others, loaded {then}',
        f'kafka.ssl.providers: legacy: code of others, loaded {then}',
        f'kafka.sasl.kerberos.kinit.cmd: a command of the shell, run {then}',
        (
            'kafka.sasl.oauthbearer.metadata.authentication.type: aws_iam: boto3 is loaded, and '
            f'asks AWS, {then}'
        ),
    ]
