"""A replay to ROS that a person stops: what it has marked, and what it says."""

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest
from made_letters import CONFIG, TOPIC, kafka_letter, read

from ros2_kafka_bridge.commands.dead_letters import replay as command
from ros2_kafka_bridge.commands.dead_letters.replay import ReplayOptions
from ros2_kafka_bridge.commands.dead_letters.replay_ros import LetterChannel
from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.filter import LetterFilter
from ros2_kafka_bridge.dead_letters.letter import Letter
from ros2_kafka_bridge.endpoints import RecordSource
from ros2_kafka_bridge.kafka.transactions import Parcel, Written
from ros2_kafka_bridge.kafka_to_ros import KafkaToRos
from ros2_kafka_bridge.route import readiness
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.records import RecordEntry
from ros2_kafka_bridge.route.type_hash import check_nothing
from ros2_kafka_bridge.testing.memory import MemoryMessageSink, MemoryRecordSink
from ros2_kafka_bridge.threads.stop import Stop

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


class StoppingReaders(MemoryMessageSink):
    """Readers whose queue has room for 7, during whose taking a person stops the replay."""

    def __init__(self, at: int, asks: int) -> None:
        super().__init__(room=7)
        self.ask: Callable[[], None]
        self._at, self._asks = at, asks

    def publish(self, messages: Iterable[bytes]) -> int:
        before = len(self.published)
        for cdr in messages:
            if not super().publish([cdr]):
                break
            if len(self.published) == self._at:
                for _ in range(self._asks):
                    self.ask()
        return len(self.published) - before


def as_it_is(value: bytes | None) -> bytes:
    return value or b''


def replay(readers: StoppingReaders, stored: Stored, monkeypatch: pytest.MonkeyPatch) -> int:
    @contextmanager
    def open_channels(_: Config, stop: Stop) -> Iterator[Any]:
        readers.ask = stop.ask

        def make(route: KafkaToRosRoute, source: RecordSource) -> KafkaToRos:
            log = logging.LoggerAdapter(logging.getLogger('test'), {})
            dead = DeadLetters[RecordEntry]('dead', MemoryRecordSink(), lambda: None, log)
            return KafkaToRos(route, 'me', source, readers, check_nothing, as_it_is, dead, log)

        opened = cache(lambda route: LetterChannel(route, make, stop))
        yield SimpleNamespace(open=opened)

    monkeypatch.setattr(readiness, 'SETTLE_S', 0.0)
    monkeypatch.setattr(command, 'open_reader', lambda _: nullcontext(stored))
    monkeypatch.setattr(command, 'Transactions', lambda *_: nullcontext(stored))
    monkeypatch.setattr(command, 'open_channels', open_channels)
    config = validated(Config, {**CONFIG, 'routes': CONFIG['routes'][:1]})
    options = ReplayOptions(to_ros=True, dry_run=False, again=False, force=False, all=True)
    return command.replay(LetterQuery(config, TOPIC, LetterFilter()), options)


@pytest.mark.parametrize('at', [100, 430])  # the last batch, too
def test_a_stop_says_what_every_reader_has_and_marks_just_that(
    at: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readers, stored = StoppingReaders(at, asks=1), Stored()
    assert replay(readers, stored, monkeypatch) == 1
    assert at <= len(readers.published) < LETTERS
    assert stored.marked == [int(value) for value in readers.published]
    told = f'stopped: {len(stored.marked)} letters replayed to ros:/orders; the same command'
    output = capsys.readouterr()
    assert output.out.startswith(told)
    assert output.err == ''


def test_a_stop_behind_the_last_letter_stops_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = Stored()
    assert replay(StoppingReaders(LETTERS, asks=1), stored, monkeypatch) == 0
    assert stored.marked == list(range(LETTERS))
    told, vouching = capsys.readouterr().out.splitlines()
    assert told == f'{LETTERS} letters replayed to ros:/orders'
    assert vouching.startswith(f'not vouched for: {LETTERS} whose record is not in its topic now')


def test_a_second_stop_says_that_some_may_come_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readers, stored = StoppingReaders(100, asks=2), Stored()
    assert replay(readers, stored, monkeypatch) == 1
    assert stored.marked == list(range(len(stored.marked)))
    assert len(stored.marked) < len(readers.published)
    words = 'the same command goes on with the rest, some of it perhaps again'
    assert words in capsys.readouterr().err
