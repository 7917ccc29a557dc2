"""What `status` asks and prints: of a right file, of one with mistakes, and without a file."""

import functools
import json
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from support.registry import answers as endless_answers
from support.registry.answers import Answer, answering

from ros2_kafka_bridge.commands.status.ask import ask
from ros2_kafka_bridge.commands.status.report import report
from ros2_kafka_bridge.config.bridge_address import bridge_address
from ros2_kafka_bridge.config.monitoring import Address
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.process.load import load_checked

HEAD = """\
name: warehouse-1
monitoring: {{listen: '{address}', token: '{token}'}}
"""
TOKEN = 'a-token-for-the-tests'  # noqa: S105 (of tests)
REST = """\
kafka: {bootstrap.servers: x}
routes:
  - {name: orders, from: {kafka: o}, to: {ros: /o, type: std_msgs/msg/String}, format: text}
"""
ROUTE = {
    'name': 'orders', 'state': 'running', 'reason': '', 'rate': 1.5, 'delay_s': [0.004, 2.0],
    'lag': 7, 'in_flight': 0, 'ended': {'dead_lettered': 3}, 'spooled': 0, 'age_s': 0.4,
    'memory_limit': 110_500_000,
}  # fmt: skip
STATE: dict[str, Any] = {
    'bridge': {
        'name': 'warehouse-1', 'ready': True, 'lifecycle': 'active', 'problems': [],
        'old': False, 'report_age_s': 0,
    },
    'routes': [ROUTE, {**ROUTE, 'name': 'returned', 'lag': None, 'delay_s': None}],
    'workers': [],
    'broker': None,
}  # fmt: skip


class _Bridge(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        body = json.dumps(STATE).encode()
        self.send_response(200)
        self.send_header('content-length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope='module')
def address() -> Iterator[str]:
    """Where a bridge answers."""
    with ThreadingHTTPServer(('127.0.0.1', 0), _Bridge) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f'127.0.0.1:{server.server_port}'
        server.shutdown()
        thread.join()


@pytest.fixture
def file(tmp_path: Path, address: str) -> Path:
    made = tmp_path / 'bridge.yaml'
    made.write_text(HEAD.format(address=address, token=TOKEN) + REST)
    return made


def cells(out: str, route: str) -> list[str]:
    (line,) = [line for line in out.splitlines() if line.startswith(f'  {route} ')]
    return re.split(r'\s{2,}', line.strip())


def test_what_a_route_has_no_figure_for_is_a_dash(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(file, '', as_json=False) == 0
    told = capsys.readouterr()
    assert told.err == ''
    assert told.out.startswith('warehouse-1: ready, active\n')
    assert cells(told.out, 'orders')[3:] == ['4.0 ms', '2.0 s', '7', '0', '3', '111', '-']
    assert cells(told.out, 'returned')[3:] == ['-', '-', '-', '0', '3', '111', '-']


def test_a_bridge_of_before_tells_nothing_of_memory(
    monkeypatch: pytest.MonkeyPatch, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    older = {name: value for name, value in ROUTE.items() if name != 'memory_limit'}
    monkeypatch.setitem(STATE, 'routes', [older])
    assert report(file, '', as_json=False) == 0
    assert 'MB at most' not in capsys.readouterr().out


def test_numbers_of_before_are_told_with_their_age(
    monkeypatch: pytest.MonkeyPatch, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    silent = {**ROUTE, 'name': 'silent', 'age_s': 47.6}
    monkeypatch.setitem(STATE, 'bridge', {**STATE['bridge'], 'old': True, 'report_age_s': 17})
    monkeypatch.setitem(STATE, 'routes', [ROUTE, silent])
    assert report(file, '', as_json=False) == 0
    out = capsys.readouterr().out
    assert out.startswith('warehouse-1: ready, active, told 17 s ago\n')
    assert cells(out, 'orders')[-2:] == ['0 s ago', '-']
    assert cells(out, 'silent')[-2:] == ['48 s ago', '-']


def test_before_anything_is_told_nothing_is_made_up(
    monkeypatch: pytest.MonkeyPatch, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bridge = {**STATE['bridge'], 'ready': False, 'lifecycle': None, 'old': True}
    monkeypatch.setitem(STATE, 'bridge', bridge)
    monkeypatch.setitem(STATE, 'routes', [])
    assert report(file, '', as_json=False) == 1
    out = capsys.readouterr().out
    assert out == 'warehouse-1: not ready, nothing told yet\nKafka: not asked yet\n'


def test_a_route_that_has_told_nothing_shows_no_numbers(
    monkeypatch: pytest.MonkeyPatch, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = 'rate', 'delay_s', 'lag', 'in_flight', 'spooled', 'age_s', 'memory_limit'
    unknown = dict.fromkeys(names)
    silent = {**ROUTE, **unknown, 'name': 'silent', 'ended': {'dead_lettered': None}}
    monkeypatch.setitem(STATE, 'routes', [ROUTE, silent])
    assert report(file, '', as_json=False) == 0
    found = cells(capsys.readouterr().out, 'silent')
    assert found == ['silent', 'running', *['-'] * 8, 'not yet', '-']


def test_what_waits_on_disk_is_a_column_where_there_is_any(
    monkeypatch: pytest.MonkeyPatch, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(
        STATE, 'routes', [ROUTE, {**ROUTE, 'name': 'spooling', 'spooled': 1234567}]
    )
    report(file, '', as_json=False)
    out = capsys.readouterr().out
    assert cells(out, 'route')[6:9] == ['in flight', 'on disk', 'dead letters']
    assert cells(out, 'orders')[6:9] == ['0', '0', '3']
    assert cells(out, 'spooling')[6:9] == ['0', '1234567', '3']
    monkeypatch.setitem(STATE, 'routes', [ROUTE])
    report(file, '', as_json=False)
    assert 'on disk' not in capsys.readouterr().out


@pytest.mark.parametrize(
    ('right', 'wrong'),
    [
        ('format: text', 'format: textt'),
        ('std_msgs/msg/String', 'robot_msgs/msg/Order'),
        (TOKEN, '${NOWHERE_SET}'),
        ('- {name: orders', '- {name: orders:'),
        ('kafka: {', "kafka: {x: ', "),
        ('  - {name', ' \t- {name'),
    ],
)
def test_a_file_with_mistakes_is_enough_to_ask_the_bridge_that_runs(
    file: Path, capsys: pytest.CaptureFixture[str], right: str, wrong: str
) -> None:
    """It runs by what it has read; a variable or a type may be there for it alone."""
    file.write_text(file.read_text().replace(right, wrong))
    with pytest.raises(ConfigError):
        load_checked(file)
    assert report(file, '', as_json=True) == 0
    told = capsys.readouterr()
    assert json.loads(told.out) == STATE
    (line,) = told.err.splitlines()
    assert line.startswith(f'{file}: has mistakes')
    assert line.endswith(f'ros2-kafka-bridge check {file} shows them')


@pytest.mark.parametrize(
    ('right', 'wrong'),
    [
        ('name: warehouse-1', 'nam: warehouse-1'),
        ('name: warehouse-1', 'name: ware.house'),
        ('name: warehouse-1', 'name: ${NOWHERE_SET}'),
        ('name: warehouse-1', 'name: x\nname: warehouse-1'),
        ('name: warehouse-1', 'name: "warehouse-1'),
        ('listen: ', 'listen: 7, listens: '),
        ('monitoring: {', 'monitorings: {'),
        ('monitoring: {', 'monitoring: {{'),
    ],
)
def test_a_file_that_does_not_tell_the_bridge_is_refused_with_its_mistakes(
    file: Path, right: str, wrong: str
) -> None:
    file.write_text(file.read_text().replace(right, wrong).replace('format: text', 'format: x'))
    with pytest.raises(ConfigError) as refused:
        load_checked(file)
    with pytest.raises(ConfigError) as caught:
        report(file, '', as_json=False)
    *mistakes, cure = caught.value.problems
    assert mistakes == refused.value.problems
    assert '--address HOST:PORT' in cure


def test_a_monitoring_that_says_no_address_has_the_one_of_every_bridge(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text('name: a\nmonitoring: {node: maybe}\nkafka: [\n')
    assert bridge_address(file, {}) == ('a', '127.0.0.1:9464')
    file.write_text('name: ${A}\nmonitoring: {listen: "${B}"}\n')
    assert bridge_address(file, {'A': 'a', 'B': '[::1]:7'}) == ('a', '[::1]:7')


@pytest.mark.parametrize('more', ['', 'monitoring: {listen: off}\n'])
def test_a_right_file_of_a_bridge_that_listens_nowhere_says_that_alone(
    tmp_path: Path, more: str
) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(f'name: a\n{more}{REST}')
    with pytest.raises(ConfigError, match='it listens nowhere') as caught:
        report(file, '', as_json=False)
    assert len(caught.value.problems) == 1


def test_a_bridge_is_asked_by_its_address_without_a_file(
    address: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(None, address, as_json=False) == 0
    assert capsys.readouterr().out.startswith('warehouse-1: ready')
    with pytest.raises(ConfigError, match='--address: expected host:port'):
        report(None, 'off', as_json=False)
    with pytest.raises(ConfigError, match='leave one out'):
        report(file, address, as_json=False)
    with pytest.raises(ConfigError, match='name its FILE'):
        report(None, '', as_json=False)


def test_another_bridge_at_the_address_of_a_file_is_named(file: Path) -> None:
    file.write_text(file.read_text().replace('warehouse-1', 'warehouse-2'))
    with pytest.raises(ConfigError, match='is the bridge warehouse-1, not warehouse-2'):
        report(file, '', as_json=False)


def _answer(body: bytes, head: bytes = b'HTTP/1.1 200 OK') -> Answer:
    length = b'\r\nContent-Length: %d\r\n\r\n' % len(body)
    return lambda connection: connection.sendall(head + length + body)


def _chunked(chunks: bytes) -> Answer:
    head = b'HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n'
    return lambda connection: connection.sendall(head + chunks)


def _of(*path: str, value: object) -> bytes:
    """The state of a bridge with another value in one place; of none where it is `...`."""
    state = json.loads(json.dumps(STATE))
    *above, last = path
    place = functools.reduce(lambda found, name: found[name], above, state)
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return json.dumps(state).encode()


def refusal(answer: Answer, patience_s: float = 10.0) -> str:
    """What is said of who answers so, in one sentence."""
    with answering(answer) as url, pytest.raises(ConfigError) as caught:
        ask(Address(url.removeprefix('http://')), 'it', patience_s)
    [text] = caught.value.problems
    assert text.isprintable()
    assert len(text) < 400
    return re.sub(r'^127.0.0.1:\d+:? ', '', text)


@pytest.mark.parametrize('name', ['slow_head', 'slow_body', 'nothing'])
def test_an_answer_that_does_not_end_is_left_alone(name: str) -> None:
    said = refusal(getattr(endless_answers, name), 0.2)
    assert said.startswith('does not answer (')
    assert said.endswith('): does a bridge run with it?')


@pytest.mark.parametrize('name', ['blanks', 'lists'])
def test_an_answer_is_not_read_beyond_what_a_bridge_says(name: str) -> None:
    said = refusal(getattr(endless_answers, name))
    assert said.endswith('its answer has more than 16,000,000 bytes')


@pytest.mark.parametrize(
    ('answer', 'said'),
    [
        (_answer(b'', b'HTTP/1.1 404 Not Found'), ' (Not Found)'),
        (_answer(b'', b'HTTP/1.1 799 Odd'), ' (status 799)'),
        (_answer(b'', b'HTTP/1.1 302 Found\r\nLocation: http://169.254.169.254/'), ' (Found)'),
        (_answer(b'', b'SSH-2.0-\x1b[31m\x9b' + b'x' * 5000), ' (BadStatusLine: SSH-2.0-'),
        (endless_answers.many_heads, ' (HTTPException: got more than 100 headers)'),
        (_chunked(b'-5\r\n'), ' (IncompleteRead: '),
        (_chunked(b'nine\r\n'), ' (IncompleteRead: '),
        (_answer(b'<html>'), ''),
        (_answer(b'[' * 100_000), ''),
        (_answer(b'9' * 5000), ''),
        (_answer(b'7'), ', or one of another version (Expected `object`, got `int`)'),
        (_answer(b'{"x":' + b'[' * 100_000), ''),
        (_answer(b'{}', b'HTTP/1.1 200 OK\r\nContent-Length: 9'), ''),
        (
            _answer(_of('bridge', 'old', value=...)),
            ', or one of another version (Object missing required field `old` - at `$.bridge`)',
        ),
        (
            _answer(_of('bridge', 'problems', value='none')),
            ', or one of another version (Expected `array`, got `str` - at `$.bridge.problems`)',
        ),
        (_answer(_of('routes', value=[7])), ', or one of another version (Expected `object`'),
        (_answer(_of('workers', value={})), ', or one of another version (Expected `array`'),
        (_answer(_of('broker', value=1)), ', or one of another version (Expected `object'),
    ],
)
def test_what_is_no_bridge_is_told_in_a_sentence(answer: Answer, said: str) -> None:
    assert refusal(answer).startswith(f'what answers there is no bridge{said}')


@pytest.mark.parametrize('host', ['a..b', 'x' * 64, 'a b', 'a\rb', 'a\u202eb'])
def test_a_name_that_is_none_is_told_in_a_sentence(host: str) -> None:
    with pytest.raises(
        ConfigError, match=r'^[ -~]+:9464 does not answer \(.+\): does a bridge run'
    ):
        report(None, f'{host}:9464', as_json=False)


def test_a_bridge_that_is_somebody_elses_forges_no_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with answering(_answer(_of('bridge', 'name', value='a: ready\nb\x1b[31m\u202e'))) as url:
        report(None, url.removeprefix('http://'), as_json=False)
        assert capsys.readouterr().out.startswith('a: ready\\nb\\x1b[31m\\u202e: ready, active\n')
        report(None, url.removeprefix('http://'), as_json=True)
    out = capsys.readouterr().out
    assert out.isascii()
    assert json.loads(out)['bridge']['name'] == 'a: ready\nb\x1b[31m\u202e'


def test_a_number_that_is_too_large_for_us_is_handed_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    state = json.dumps({**STATE, 'more': 0}).replace('"more": 0', f'"more": {"9" * 5000}')
    with answering(_answer(state.encode())) as url:
        assert report(None, url.removeprefix('http://'), as_json=True) == 0
    assert '9' * 5000 in capsys.readouterr().out
