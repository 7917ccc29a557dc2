"""What the page reads and shows of dead letters is bounded, whatever is in them."""

import os
import tracemalloc
from collections.abc import Iterator
from typing import Any, Final, Self

import pytest
from support.bridges.made_letters import TOPIC, config, kafka_letter, read, ros_letter

from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark
from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.monitoring import letters

MEGABYTE: Final = 1_000_000


class Reader:
    """Reads letters that are made as they are read."""

    def __init__(self, many: int, letter: Letter) -> None:
        self.partitions = {TOPIC: 1}
        self.unseen: dict[tuple[str, int], LetterPlace] = {}
        self.cut: LetterPlace | None = None
        self._many = many
        self._letter = letter

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is held."""

    def has(self, _: str) -> bool:
        return True

    def newest(self, topic: str, most: int, _: float) -> Iterator[Letter | Mark]:
        for offset in range(min(self._many, most)):
            place = LetterPlace(topic, 0, offset)
            about = self._letter.about
            assert about is not None
            yield self._letter._replace(
                place=place, time_ms=offset, key=os.urandom(100_000),
                about=about._replace(reason='r' * (100_000 + offset)),
            )  # fmt: skip
            if offset % 2:
                yield Mark(place, 'to' * (50_000 + offset), 1)

    def fetch(self, *_: Any) -> Iterator[Letter]:
        yield self._letter


def _reader(
    monkeypatch: pytest.MonkeyPatch, many: int, value: bytes, headers: HeaderList | None = None
) -> None:
    letter = read(kafka_letter(value, headers or []))
    monkeypatch.setattr(letters, 'open_reader', lambda _: Reader(many, letter))


def _look(
    monkeypatch: pytest.MonkeyPatch, value: bytes, headers: HeaderList | None = None
) -> dict[str, Any]:
    _reader(monkeypatch, 1, value, headers)
    found = letters.look(config(max_message_bytes=5 * MEGABYTE), LetterPlace(TOPIC, 0, 7))
    assert found is not None
    return found


def test_of_many_large_letters_little_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    _reader(monkeypatch, 1000, b'order')
    tracemalloc.start()
    try:
        found = letters.newest(config(), TOPIC)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (found['seen'], found['replayed']) == (1000, 500)
    assert [it['offset'] for it in found['letters']] == list(range(999, 499, -1))
    assert all(len(it['reason']) == 500 for it in found['letters'])
    assert peak < 10 * MEGABYTE


def test_of_many_partitions_fewer_offsets_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    letter = read(kafka_letter(b'order'))
    crowded = Reader(1000, letter)
    crowded.partitions = {TOPIC: 1000}
    monkeypatch.setattr(letters, 'open_reader', lambda _: crowded)
    assert letters.newest(config(), TOPIC)['seen'] == 40


def test_a_small_value_that_would_be_megabytes_of_json_is_shown_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value = b'[' * 200 + b'1,' * 30_000 + b'1' + b']' * 200
    shown = _look(monkeypatch, value)['value']
    assert (shown['kind'], shown['text']) == ('text', value.decode())


def test_of_the_fields_of_a_large_message_the_beginning_is_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fields = _look(monkeypatch, b'x' * 2 * MEGABYTE)['fields']
    assert fields.startswith('{"data":"xxx')
    assert fields.endswith(' bytes more')
    assert len(fields) < 100_000
    assert _look(monkeypatch, b'x')['fields'] == '{\n  "data": "x"\n}'


def test_fields_of_a_message_are_shown_where_its_own_definition_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value = b'\0\1\0\0\2\0\0\0x\0'
    known = load_layout('std_msgs/msg/String').type_hash or ''
    unknown = 'acme_msgs/msg/Crate'
    for name, type_hash, shown in (
        ('std_msgs/msg/String', '', '{\n  "data": "x"\n}'),
        ('std_msgs/msg/String', known, '{\n  "data": "x"\n}'),
        ('std_msgs/msg/String', 'RIHS01_1', ''),
        (unknown, 'RIHS01_1', ''),
        (unknown, '', ''),
    ):
        letter = read(ros_letter(value, name=name, type_hash=type_hash))
        monkeypatch.setattr(letters, 'open_reader', lambda _, made=letter: Reader(1, made))
        found = letters.look(config(), LetterPlace(TOPIC, 0, 7))
        assert found is not None
        assert found['fields'] == shown


def test_long_headers_are_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    long = 'é'.encode() * MEGABYTE
    headers = _look(monkeypatch, b'x', [('h' * MEGABYTE, long), ('none', None)])['headers']
    assert [len(it['name']) for it in headers] == [2000, 4]
    assert headers[0]['value'] == 'é' * 1997 + '...'
    assert headers[1]['value'] is None
