"""What comes from outside ends no route, fills no memory, forges no line, runs no code."""

import ast
import gc
import logging
import os
import subprocess
import sys
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.worlds.handles import handle, hear
from support.worlds.pipeline_to_ros import House

import ros2_kafka_bridge
from ros2_kafka_bridge.config.checks import key_parts, simple_name
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD
from ros2_kafka_bridge.config.references import EXPANDED_LIMIT_CHARS, expand
from ros2_kafka_bridge.config.tree import YamlError, read_yaml
from ros2_kafka_bridge.dead_letters.writer import HEADER_LIMIT, explain, from_kafka
from ros2_kafka_bridge.depth import recording
from ros2_kafka_bridge.endpoints import HeaderList, Message, Outgoing
from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError, RecordTooLargeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.walk import make_end
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive, String
from ros2_kafka_bridge.process.lines import LineReader
from ros2_kafka_bridge.route.labels import KEY_LIMIT_BYTES, make_key
from ros2_kafka_bridge.testing.memory import MemoryRecord, MemoryRecordSink

pytestmark = pytest.mark.usefixtures('no_settle_time')

SCOPE = Scope('topic')
LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
STRING = Layout('std_msgs/msg/String', (Field('data', String()),))
SOURCES = Path(ros2_kafka_bridge.__file__).parent


class UnreadableRecord(MemoryRecord):
    """A record with a header whose name is not UTF-8, as confluent-kafka shows it."""

    def headers(self) -> HeaderList | None:
        raise SystemError('headers returned a result with an exception set')


class SmallTopic(MemoryRecordSink[Any]):
    """A sink whose topic takes records of 1000 bytes at most, all counted."""

    def produce(self, record: Outgoing, token: Any) -> bool:
        parts = [record.key, record.value, *(v for _, v in record.headers)]
        size = sum(len(part) for part in parts if part is not None)
        if size > 1000:
            raise RecordTooLargeError(size, 1000, 'max.message.bytes of the topic')
        return super().produce(record, token)


def make_house() -> House:
    """A pipeline of text, whose dead letters may not be large."""
    return House(letters=SmallTopic(), decode=FORMATS['text'].make_decode(STRING, SCOPE))


def play(house: House, *records: MemoryRecord) -> dict[int, int]:
    """Run them; returns the positions in the end."""
    house.source.waiting.extend(records)
    house.steps(8)
    return house.positions()


# Records


def test_a_record_with_unreadable_headers_is_delivered_all_the_same() -> None:
    house = make_house()
    assert play(house, UnreadableRecord(b'fine'), MemoryRecord(b'next', 1)) == {0: 2}
    assert len(house.sink.published) == 2


def test_a_dead_letter_says_that_headers_could_not_be_read() -> None:
    house = make_house()
    assert play(house, UnreadableRecord(b'\xff')) == {0: 1}
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert told['dead_letter.headers'] == 'left out: a name is not UTF-8'
    assert letter.value == b'\xff'


@pytest.mark.parametrize(
    'headers',
    [
        [('mine', b'x' * 5000)],
        [('dead_letter.error', b'x' * 5000)],
        [('dead_letter.error', b'forged'), ('dead_letter.source', b'x' * 5000)],
    ],
)
def test_no_header_keeps_a_dead_letter_from_its_topic(headers: HeaderList) -> None:
    house = make_house()
    assert play(house, MemoryRecord(b'\xff' * 2000, header_list=headers)) == {0: 1}
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert len(told) == len(letter.headers), 'only the own block is left'
    assert told['dead_letter.error'] == 'DecodeError: not UTF-8 at byte 0: 0xff'
    assert told['dead_letter.value_bytes'] == '2000'


def test_a_dead_letter_keeps_a_thousand_headers_or_none() -> None:
    origin = from_kafka('orders', 'orders', 0, 7)
    for count, kept in ((HEADER_LIMIT, HEADER_LIMIT), (HEADER_LIMIT + 1, 0)):
        record = Outgoing('', None, b'', [('h', b'')] * count)
        letter = explain(record, DecodeError('why'), origin)
        assert sum(name == 'h' for name, _ in letter.headers) == kept
    assert dict(letter.headers)['dead_letter.headers'] == 'left out: 1001, more than 1000'


def test_the_reason_of_a_dead_letter_can_always_be_written() -> None:
    letter = explain(
        Outgoing('', None, b'', []), DecodeError('\ud800\n'), from_kafka('r', 't', 0, 1)
    )
    assert dict(letter.headers)['dead_letter.error'] == 'DecodeError: \\ud800\\n'


def test_a_record_that_waits_keeps_neither_key_nor_headers_in_memory() -> None:
    house = make_house()
    house.sink.room = 0
    record = MemoryRecord(b'fine', key_bytes=b'k' * 10**6)
    seen = weakref.ref(record)
    play(house, record)
    del record
    gc.collect()
    assert len(house.pipeline._flight.lane.ready) == 1
    assert seen() is None


def test_a_key_made_of_a_message_is_bounded() -> None:
    key = make_key('{message.data}', '/orders', STRING)
    decode = FORMATS['text'].make_decode(STRING, SCOPE)
    longest = b'x' * KEY_LIMIT_BYTES
    assert key(Message(decode(longest), b'', 0, 0)) == longest
    with pytest.raises(EncodeError, match='a key of 8193 bytes: at most 8192'):
        key(Message(decode(b'x' * (KEY_LIMIT_BYTES + 1)), b'', 0, 0))


# Configuration and files


def test_one_large_file_that_is_named_often_does_not_fill_the_memory(tmp_path: Path) -> None:
    (tmp_path / 'large').write_text('x' * 1_000_000)
    data = {f'field_{number}': '${file:large}' * 5 for number in range(20)}
    expanded = expand(data, {}, tmp_path)
    assert sum(map(len, expanded.data.values())) <= EXPANDED_LIMIT_CHARS
    [mistake] = expanded.mistakes
    assert 'more than 16777216 characters' in mistake.text


def test_repeated_fields_count_as_values(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.config.tree.VALUE_LIMIT', 100)
    with pytest.raises(YamlError, match='more than 100 values'):
        read_yaml('{' + 'a: 1,' * 101 + '}')


def test_a_file_that_is_no_configuration_is_told_in_few_lines() -> None:
    text = ''.join(f'"\\x1bf{number}": 1\n' for number in range(500))
    with pytest.raises(ConfigError) as caught:
        loads(text, 'x.yaml', {})
    assert len(caught.value.problems) == MISTAKES_TOLD + 1
    assert caught.value.problems[-1].endswith('more mistakes')
    assert '\x1b' not in str(caught.value)


def test_names_and_key_templates_are_bounded() -> None:
    assert simple_name('a' * 255)
    with pytest.raises(ValueError, match='at most 255'):
        simple_name('a' * 256)
    with pytest.raises(ValueError, match='at most 1000'):
        key_parts('a' * 1001)


@pytest.mark.parametrize('content', [f'{10**30}\n', f'{"9" * 5000}\n', 'x' * 10_000])
def test_a_file_of_times_that_is_none_is_told_in_one_short_line(
    tmp_path: Path, content: str
) -> None:
    file = tmp_path / 'times'
    file.write_text(content)
    with pytest.raises(ConfigError) as caught:
        recording.read_arrivals(file)
    assert len(str(caught.value)) < 200 + len(str(file))


def test_a_file_of_times_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, 'SIZE_LIMIT_BYTES', 10)
    file = tmp_path / 'times'
    file.write_text('1\n2\n3\n')
    assert len(recording.read_arrivals(file)) == 3
    file.write_text('1\n' * 20)
    with pytest.raises(ConfigError, match='larger than 10 bytes'):
        recording.read_arrivals(file)


# Processes and code


@pytest.mark.parametrize(
    'line', [b'{', b'[]', b'{"snapshots": [{}]}', b'{"snapshots": 1}', b'\xff']
)
def test_a_worker_that_talks_nonsense_does_not_end_its_supervisor(line: bytes) -> None:
    worker = handle('orders')
    before = dict(worker.snapshots)
    hear(worker, line + b'\n')
    assert worker.snapshots == before


def test_a_worker_that_ends_no_line_does_not_fill_its_supervisor() -> None:
    pipe, its_end = os.pipe()
    reader = LineReader(pipe, 100)
    for _ in range(100):
        os.write(its_end, b'x' * 60)
        assert reader.read() == []
        assert len(reader._rest) <= 100
    os.close(pipe)
    os.close(its_end)


def test_a_worker_opens_as_many_files_as_its_user_may() -> None:
    code = (
        'import resource, ros2_kafka_bridge.process.start as w\n'
        '_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)\n'
        'resource.setrlimit(resource.RLIMIT_NOFILE, (64, hard))\n'
        'w.allow_open_files()\n'
        'soft, now = resource.getrlimit(resource.RLIMIT_NOFILE)\n'
        'assert now == hard and soft == (min(hard, 65536) if hard > 0 else 65536), (soft, hard)\n'
    )
    subprocess.run([sys.executable, '-c', code], check=True, timeout=60)


def test_names_of_fields_never_become_code() -> None:
    names = ('a\nraise SystemExit', "'; import os; '", '"""', '__import__("os")')
    layout = Layout('x/msg/X', tuple(Field(name, Primitive('bool')) for name in names))
    end = make_end(layout)
    assert end(b'\0\1\0\0' + bytes(4)) == 8
    for number in range(4):
        with pytest.raises(DecodeError, match='needs a bool'):
            end(b'\0\1\0\0' + bytes(number) + b'\2' + bytes(3 - number))


def calls(tree: ast.AST) -> Iterator[str]:
    """Names of all that is called or imported."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name)) | ast.Call(func=ast.Attribute(attr=name)):
                yield name
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=str(name)):
                yield name


def test_nothing_in_the_bridge_makes_code_or_objects_of_data() -> None:
    """One place runs source text, and that is its own, made of layouts, never of values."""
    forbidden = {
        'eval', 'exec', '__import__', 'pickle', 'marshal', 'shelve', 'dill', 'cloudpickle',
        'system', 'popen', 'unsafe_load', 'full_load', 'jsonpickle',
    }  # fmt: skip
    found = {
        (str(file.relative_to(SOURCES)), name)
        for file in SOURCES.rglob('*.py')
        for name in calls(ast.parse(file.read_text(encoding='utf-8')))
        if name in forbidden
    }
    assert found == {('formats/generated.py', 'exec')}
