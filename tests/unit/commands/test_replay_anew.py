"""A replay whose transactions are spent: others go on, with what is left by the marks of then."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any

import pytest
from support.bridges.made_letters import CONFIG, TOPIC, kafka_letter, read, stored

from ros2_kafka_bridge.commands.dead_letters import replay as command
from ros2_kafka_bridge.commands.dead_letters.replay import ReplayOptions
from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.filter import LetterFilter
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark, mark, parse
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.kafka.transactions import Parcel, RefusedParcel, Written

LETTERS = 450  # in batches of 200
OF_OTHERS = range(210, 220)


class Topics:
    """Letters, a record that is none, and what is written; each transaction opens them anew."""

    def __init__(self) -> None:
        self.partitions = {'orders': 3, TOPIC: 1}
        self.unseen: dict[tuple[str, int], Any] = {}
        self.there = [read(kafka_letter(b'%d' % at), at) for at in range(LETTERS)]
        self.marks: list[Letter | Mark] = []
        self.written: list[int] = []
        self.opened = 0
        self.spent = False
        self.fails_again = False

    def has(self, topic: str) -> bool:
        return topic == TOPIC

    def letters(self, *_: Any, **__: Any) -> Iterator[Letter | Mark]:
        return iter([*self.there, *self.marks])

    def fetch(self, _topic: str, _partition: int, wanted: Iterable[int]) -> Iterator[Letter]:
        return iter([letter for letter in self.there if letter.place.offset in wanted])

    def bounds(self, *_: Any) -> range:
        return range(1000, 2000)  # they are gone

    def open(self, *_: Any) -> 'nullcontext[Topics]':
        self.opened += 1
        assert self.opened < 20, 'goes on for ever'
        self.spent = False
        return nullcontext(self)

    def write(self, parcels: Sequence[Parcel]) -> Written:
        """Of the first two batches another client is needed for the rest."""
        refused, left, now = list[RefusedParcel](), list[Parcel](), list(parcels)
        if self.opened < 3:
            self.spent = True
            refused = [RefusedParcel(now[0], RecordError('too large'))]
            now, left = now[1:150], now[150:]
        if self.fails_again:  # and Kafka is slow: each transaction is the last of its client
            self.spent = True
            self.there += [read(kafka_letter(b''), len(self.there) + n) for n in range(len(now))]
        for parcel in now:
            self._take(parcel)
        if self.opened == 1:
            self.marks += [self._mark(offset) for offset in OF_OTHERS]
        return Written(refused, left)

    def _take(self, parcel: Parcel) -> None:
        offset = int(dict(parcel.sends[1].record.headers)['dead_letter.replayed'] or -1)
        self.written.append(offset)
        self.marks.append(self._mark(offset))

    @staticmethod
    def _mark(offset: int) -> Letter | Mark:
        made = mark(LetterPlace(TOPIC, 0, offset), 'orders')
        return parse(TOPIC, stored(made, LETTERS + offset))


@pytest.mark.parametrize('which', ['those without a mark', 'again'])
def test_what_is_left_is_replayed_once_and_what_others_have_replayed_meanwhile_is_not(
    which: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    topics, again = Topics(), which == 'again'
    monkeypatch.setattr(command, 'open_reader', lambda _: nullcontext(topics))
    monkeypatch.setattr(command, 'Transactions', topics.open)
    config = validated(Config, {**CONFIG, 'routes': CONFIG['routes'][:1]})
    options = ReplayOptions(to_ros=False, dry_run=False, again=again, force=True, all=True)
    assert command.replay(LetterQuery(config, TOPIC, LetterFilter()), options) == 1
    assert topics.opened == 3
    of_others = set() if again else set(OF_OTHERS)
    assert sorted(topics.written) == sorted(set(range(LETTERS)) - {0, 150} - of_others)
    told = capsys.readouterr().out
    assert told.count('left: ') == 2
    before = '' if again else f'; {len(OF_OTHERS)} replayed before (--again)'
    count = LETTERS - 2 - len(of_others)
    assert f'{count} letters replayed to orders; 2 left as they are{before}\n' in told


def test_what_fails_again_while_it_is_replayed_is_left_to_the_next_replay(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    topics = Topics()
    topics.fails_again = True
    monkeypatch.setattr(command, 'open_reader', lambda _: nullcontext(topics))
    monkeypatch.setattr(command, 'Transactions', topics.open)
    config = validated(Config, {**CONFIG, 'routes': CONFIG['routes'][:1]})
    options = ReplayOptions(to_ros=False, dry_run=False, again=True, force=True, all=True)
    assert command.replay(LetterQuery(config, TOPIC, LetterFilter()), options) == 1
    assert max(topics.written) < LETTERS
    assert f'{LETTERS - 2} letters replayed' in capsys.readouterr().out


def test_a_dry_run_tells_of_the_letters_of_every_topic(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    topics = Topics()
    monkeypatch.setattr(topics, 'has', lambda _: True)
    monkeypatch.setattr(topics, 'letters', lambda topic, *_, **__: iter(_of(topic, topics)))
    monkeypatch.setattr(topics, 'fetch', lambda topic, *_: iter(_of(topic, topics)))
    monkeypatch.setattr(command, 'open_reader', lambda _: nullcontext(topics))
    config = validated(Config, CONFIG)
    options = ReplayOptions(to_ros=False, dry_run=True, again=False, force=False, all=True)
    assert command.replay(LetterQuery(config, '', LetterFilter()), options) == 0
    assert f'{2 * LETTERS} letters would be replayed' in capsys.readouterr().out


def _of(topic: str, topics: Topics) -> list[Letter]:
    return [it._replace(place=it.place._replace(topic=topic)) for it in topics.there]
