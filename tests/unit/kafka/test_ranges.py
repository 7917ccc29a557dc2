"""Ranges of offsets, read whatever comes between the records, and in whatever order."""

import time
import weakref
from collections import deque
from collections.abc import Iterable, Mapping
from random import Random
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import pytest
from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.kafka.ranges import Place, RangeReader

A, B = ('orders', 0), ('orders', 1)
EOF, AWAY = KafkaError._PARTITION_EOF, KafkaError._ALL_BROKERS_DOWN


def told(place: Place, offset: int, code: int | None = None) -> Message:
    """A record, or with a code what a client tells in its place."""
    error = None if code is None else KafkaError(code)
    return Message(*place, offset=offset, error=error)


class Partition(NamedTuple):
    """What is in one: offsets of records, and before which offset it ends."""

    records: frozenset[int]
    end: int


class Client:
    """Hands out batches at random: of what is assigned, of what was, and what else is told."""

    def __init__(self, held: Mapping[Place, Partition], random: Random) -> None:
        self.positions: dict[Place, int] = {}
        self._held = held
        self._random = random
        self._before: list[Message] = [told(place, 0) for place in held]
        self._calls = 0

    def assign(self, starts: Iterable[TopicPartition]) -> None:
        self.positions = {(it.topic, it.partition): it.offset for it in starts}
        for place, offset in self.positions.items():
            if offset > self._held[place].end:
                self.positions[place] = 0  # auto.offset.reset

    def incremental_unassign(self, places: Iterable[TopicPartition]) -> None:
        for place in places:
            del self.positions[place.topic, place.partition]

    def consume(self, most: int, _timeout_s: float) -> list[Message]:
        self._calls += 1
        assert self._calls < 2000, 'it does not end'
        return [self._next() for _ in range(self._random.randrange(most + 1))]

    def _next(self) -> Message:
        foreign = [told(('letters', 0), 3), told(A, -1, AWAY), *self._before]
        if not self.positions or not self._random.randrange(4):
            return self._random.choice([it for it in foreign if not self._is_assigned(it)])
        place = self._random.choice(list(self.positions))
        records, end = self._held[place]
        at = self.positions[place]
        offset = min((it for it in records if it >= at), default=end)
        self.positions[place] = offset + (offset < end)
        return told(place, offset, None if offset < end else EOF)

    def _is_assigned(self, message: Message) -> bool:
        return message.error() is None and (message.topic(), message.partition()) in self.positions


@st.composite
def partitions(draw: st.DrawFn) -> tuple[Partition, range]:
    records = draw(st.frozensets(st.integers(0, 30), max_size=20))
    end = max(records, default=-1) + 1 + draw(st.integers(0, 3))
    start = draw(st.integers(0, 40))
    return Partition(records, end), range(start, start + draw(st.integers(0, 30)))


@given(st.lists(partitions(), max_size=4), st.integers(1, 10), st.randoms(use_true_random=False))
def test_exactly_the_records_in_the_ranges_are_told_each_once_and_in_order(
    drawn: list[tuple[Partition, range]], batch: int, random: Random
) -> None:
    held = {('orders', number): it for number, (it, _) in enumerate(drawn)}
    ranges = {('orders', number): offsets for number, (_, offsets) in enumerate(drawn)}
    reader = reader_of(Client(held, random), ranges, batch=batch)
    seen: dict[Place, list[int]] = {place: [] for place in ranges}
    for message in reader:
        seen[message.topic() or '', message.partition() or 0].append(message.offset() or 0)
    assert seen == {place: sorted(held[place].records & {*ranges[place]}) for place in ranges}
    assert not reader.left
    for place, end in reader.early_ends.items():
        assert end == held[place].end < ranges[place].stop


class Script:
    """A client that hands out these batches and then nothing; a second passes with each."""

    def __init__(self, *batches: list[Message]) -> None:
        self.clock_s = 0.0
        self.assigned: dict[Place, int] = {}
        self.batches = deque(batches)

    def assign(self, starts: Iterable[TopicPartition]) -> None:
        self.assigned = {(it.topic, it.partition): it.offset for it in starts}

    def incremental_unassign(self, places: Iterable[TopicPartition]) -> None:
        for place in places:
            del self.assigned[place.topic, place.partition]

    def consume(self, _most: int, _timeout_s: float) -> list[Message]:
        self.clock_s += 1.0
        return self.batches.popleft() if self.batches else []


def reader_of(client: object, ranges: Mapping[Place, range], **given: Any) -> RangeReader:
    return RangeReader(cast('Consumer', client), ranges, **given)


def offsets(reader: RangeReader) -> list[int | None]:
    return [message.offset() for message in reader]


def test_what_is_through_is_fetched_no_more_while_others_are_left() -> None:
    client = Script([told(A, 5), told(A, 6)], [told(B, 0)])
    reader = reader_of(client, {A: range(5, 6), B: range(2)}, stopped=lambda: not client.batches)
    assert offsets(reader) == [5, 0]
    assert client.assigned.keys() == {B}
    assert reader.left == {B: 1}


def test_an_error_that_passes_is_waited_for_and_after_another_it_goes_on_where_it_was() -> None:
    denied = told(A, 0, KafkaError.TOPIC_AUTHORIZATION_FAILED)
    client = Script([told(A, 0), told(A, -1, AWAY)], [told(A, 1), denied, told(A, 2)])
    reader = reader_of(client, {A: range(3)})
    seen: list[int | None] = []
    with pytest.raises(KafkaException, match='TOPIC_AUTHORIZATION_FAILED'):
        seen.extend(message.offset() for message in reader)
    assert seen == [0, 1]
    client.batches.append([told(A, 2)])
    assert offsets(reader) == [2]
    assert client.assigned == {A: 2}


def test_a_partition_that_ends_early_is_told_or_waited_for() -> None:
    def client() -> Script:
        return Script([told(A, 0), told(A, 4, EOF)], [told(A, 6)])

    reader = reader_of(client(), {A: range(7)})
    assert offsets(reader) == [0]
    assert (reader.left, reader.early_ends) == ({}, {A: 4})
    waiting = reader_of(client(), {A: range(7)}, waits=True)
    assert offsets(waiting) == [0, 6]
    assert (waiting.left, waiting.early_ends) == ({}, {})


def test_it_ends_where_nothing_new_comes_for_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    slow: list[list[Message]] = [[]] * 3
    slow += [[told(A, 0)], *slow, [told(A, 1), told(A, 2, EOF)]]
    client = Script(*slow, *[[told(A, -1, AWAY), told(A, 2, EOF)]] * 100)
    monkeypatch.setattr(time, 'monotonic', lambda: client.clock_s)
    reader = reader_of(client, {A: range(3)}, silent_s=5.0, waits=True)
    assert offsets(reader) == [0, 1]
    assert reader.left == {A: 2}
    assert 5.0 < reader.silence_s <= 7.0


def test_the_end_of_a_partition_is_no_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Script([], [], [], [told(A, 0, EOF)], [], [], [], [told(B, 0)])
    monkeypatch.setattr(time, 'monotonic', lambda: client.clock_s)
    assert offsets(reader_of(client, {A: range(1), B: range(1)}, silent_s=5.0)) == [0]


def test_the_time_that_whoever_takes_the_records_takes_is_no_silence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    client = Script([told(A, 0)], [], [told(A, 1)])
    monkeypatch.setattr(time, 'monotonic', lambda: client.clock_s)
    reader = reader_of(client, {A: range(2)}, silent_s=5.0)
    for _ in reader:
        client.clock_s += 60.0
    assert not reader.left


def test_a_record_is_let_go_of_as_soon_as_the_next_one_is_taken() -> None:
    """Of a batch of large records, those that were looked at take no memory."""

    class Large(SimpleNamespace):
        """One that tells when it is gone."""

    def made(offset: int) -> Large:
        answers = {'topic': A[0], 'partition': A[1], 'offset': offset, 'error': None}
        large = Large(**{name: lambda it=it: it for name, it in answers.items()})
        there.append(weakref.ref(large))
        return large

    there: list[weakref.ref[Large]] = []
    client = SimpleNamespace(
        assign=lambda _: None, consume=lambda *_: [made(offset) for offset in range(10)]
    )
    reader = reader_of(client, {A: range(10)})
    for number, _ in enumerate(reader):
        assert sum(it() is not None for it in there) <= 10 - number
