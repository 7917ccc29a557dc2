"""`dead-letters` without a broker: what it shows, and its command line."""

import base64
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from support.bridges.made_letters import kafka_letter, read
from support.processes.terminal import typed

from ros2_kafka_bridge.commands.dead_letters.report import _letter_json, described
from ros2_kafka_bridge.dead_letters.writer import without_value
from ros2_kafka_bridge.kafka import letters, overview


def test_everything_of_a_letter_is_shown_and_a_long_value_is_cut() -> None:
    shown = '\n'.join(described(read(kafka_letter(b'x' * 5000)), None))
    for line in ('route     orders', 'source    orders[2]@5', 'key       key', 'trace = \\xff'):
        assert f'  {line}' in shown
    assert 'trace = null' in shown
    assert '... 904 bytes more: --raw writes all' in shown
    left_out = '\n'.join(described(read(without_value(kafka_letter())), None))
    assert 'value     left out (5 bytes)' in left_out
    assert 'value     null' in '\n'.join(described(read(kafka_letter(None)), None))
    odd = '\n'.join(described(read(kafka_letter(b'\xffA')), None))
    assert 'value     2 bytes, not UTF-8' in odd
    assert '00000000  ff 41' in odd


# The command line


def said_of(place: Path, command: str, *rest: str) -> tuple[int, str]:
    file = place / 'bridge.yaml'
    file.write_text(
        'name: test\nkafka: {bootstrap.servers: "127.0.0.1:1"}\nroutes:\n'
        '  - {name: orders, from: {kafka: orders}, format: text,\n'
        '     to: {ros: /orders, type: std_msgs/msg/String}}\n'
    )
    status, out, err = typed('dead-letters', command, file, *rest)
    return status, out + err


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['replay'], 'which letters? Give a filter such as --route or --since, or --all'),
        (['replay', '--all', '--to', 'ros', '--force'], '--force goes with --to kafka only'),
        (['list', '--since', 'soon'], "--since: 'soon' is not a time"),
        (['show', 'nonsense'], "'nonsense' is no letter: one is written as"),
        (['show', 'a[0]@1', '--offset', '2'], 'name two letters'),
        (['replay', '--to', 'mars'], "'mars' is not one of"),
    ],
)
def test_a_wrong_use_is_said_before_anybody_is_asked(
    tmp_path: Path, arguments: Sequence[str], words: str
) -> None:
    status, output = said_of(tmp_path, *arguments)
    assert status == 2
    assert words in output


@pytest.mark.parametrize('option', ['--since', '--until'])
def test_an_age_is_not_counted_by_a_clock_that_begins_in_1970(
    tmp_path: Path, option: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, 'time', lambda: 20.0)
    status, output = said_of(tmp_path, 'replay', option, '1h')
    assert status == 2
    assert f"{option}: this machine's clock says 1970-01-01" in output


@pytest.mark.parametrize('arguments', [['list'], ['show', 'a[0]@1'], ['replay', '--all']])
def test_a_broker_that_is_not_there_is_said_in_a_sentence(
    tmp_path: Path, arguments: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (letters, overview):
        monkeypatch.setattr(module, '_REQUEST_S', 0.5)
    status, output = said_of(tmp_path, *arguments)
    assert status == 1
    assert 'the broker does not answer' in output
    assert 'Traceback' not in output


def test_json_keeps_the_bytes_of_a_key() -> None:
    told = _letter_json(read(kafka_letter()), None)
    assert base64.b64decode(told['key_base64']) == b'key'
    assert told['about']['offset'] == 5
