"""A replay to ROS that a person stops: what it has marked, and what it says."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest
from support.bridges.made_letters import CONFIG, TOPIC, Readers, kafka_letter, read, to_readers

from ros2_kafka_bridge.commands.dead_letters import replay as command
from ros2_kafka_bridge.commands.dead_letters.replay import ReplayOptions
from ros2_kafka_bridge.commands.dead_letters.replay_ros import LetterChannel
from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.filter import LetterFilter
from ros2_kafka_bridge.dead_letters.letter import Letter
from ros2_kafka_bridge.kafka.transactions import Parcel, Written
from ros2_kafka_bridge.threads.stop import Stop

pytestmark = pytest.mark.usefixtures('no_settle_time')

LETTERS = 450  # in batches of 200


class Stored:
    """The letters, and the marks that are written for them."""

    def __init__(self) -> None:
        self.partitions = {'orders': 3, TOPIC: 1}
        self.unseen: dict[tuple[str, int], Any] = {}
        self.letters_there = [read(kafka_letter(b'%d' % at), at) for at in range(LETTERS)]
        self.marked: list[int] = []
        self.spent = False

    def has(self, topic: str) -> bool:
        return topic == TOPIC

    def letters(self, *_: Any, **__: Any) -> Iterator[Letter]:
        return iter(self.letters_there)

    def fetch(self, _topic: str, _partition: int, wanted: Iterable[int]) -> Iterator[Letter]:
        return iter([letter for letter in self.letters_there if letter.place.offset in wanted])

    def bounds(self, *_: Any) -> range:
        return range(1000, 2000)  # they are gone

    def write(self, parcels: Sequence[Parcel]) -> Written:
        for parcel in parcels:
            [send] = parcel.sends
            self.marked.append(int(dict(send.record.headers)['dead_letter.replayed'] or -1))
        return Written([], [])


def replay(
    stored: Stored, at: int, asks: int, monkeypatch: pytest.MonkeyPatch
) -> tuple[int, list[bytes]]:
    """Replay to readers with room for 7, and stop that so often when they have so many."""
    readers = Readers(room=7)

    @contextmanager
    def open_channels(_: Config, stop: Stop) -> Iterator[Any]:
        def ask() -> None:
            for _ in range(asks):
                stop.ask()

        readers.happen_at(at, ask)
        opened = cache(lambda route: LetterChannel(route, to_readers(readers), stop))
        yield SimpleNamespace(open=opened)

    monkeypatch.setattr(command, 'open_reader', lambda _: nullcontext(stored))
    monkeypatch.setattr(command, 'Transactions', lambda *_: nullcontext(stored))
    monkeypatch.setattr(command, 'open_channels', open_channels)
    config = validated(Config, {**CONFIG, 'routes': CONFIG['routes'][:1]})
    options = ReplayOptions(to_ros=True, dry_run=False, again=False, force=False, all=True)
    status = command.replay(LetterQuery(config, TOPIC, LetterFilter()), options)
    return status, readers.published


@pytest.mark.parametrize('at', [100, 430])  # the last batch, too
def test_a_stop_says_what_every_reader_has_and_marks_just_that(
    at: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = Stored()
    status, published = replay(stored, at, 1, monkeypatch)
    assert status == 1
    assert at <= len(published) < LETTERS
    assert stored.marked == [int(value) for value in published]
    told = f'stopped: {len(stored.marked)} letters replayed to ros:/orders; the same command'
    output = capsys.readouterr()
    assert output.out.startswith(told)
    assert output.err == ''


def test_a_stop_behind_the_last_letter_stops_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = Stored()
    assert replay(stored, LETTERS, 1, monkeypatch)[0] == 0
    assert stored.marked == list(range(LETTERS))
    told, vouching = capsys.readouterr().out.splitlines()
    assert told == f'{LETTERS} letters replayed to ros:/orders'
    assert vouching.startswith(f'not vouched for: {LETTERS} whose record is not in its topic now')


def test_a_second_stop_says_that_some_may_come_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = Stored()
    status, published = replay(stored, 100, 2, monkeypatch)
    assert status == 1
    assert stored.marked == list(range(len(stored.marked)))
    assert len(stored.marked) < len(published)
    words = 'the same command goes on with the rest, some of it perhaps again'
    assert words in capsys.readouterr().err
