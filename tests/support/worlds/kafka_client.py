"""A `Consumer` on a Kafka in memory, as confluent-kafka 2.16 shows one.

Calls back come out of `poll` and `consume` alone, in the order in which things have happened. A
fetch is ahead of what was handed out; what it has brought is dropped where its partition was taken
away or paused. One rebalance comes after the other, and none before each commit was answered.
"""

import json
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

from confluent_kafka import (
    OFFSET_BEGINNING,
    OFFSET_INVALID,
    KafkaError,
    KafkaException,
    TopicPartition,
)
from support.worlds.kafka import TOPIC, Gap, Kafka, Log, Offsets, Place, Reading, Stored, Told

FETCH: Final = 4  # records of a partition that are fetched at once
STATISTICS_S: Final = 4.0
WITHIN_A_POLL: Final = 3  # so many steps are made by its own threads


class Request(NamedTuple):
    """A commit that was not answered yet.

    Args:
        life: The session that it was made in.
        offsets: To commit.
        in_rebalance: It was made while a rebalance was called back.
    """

    life: int
    offsets: Offsets
    in_rebalance: bool


class MemoryClient:
    """A member of the group.

    Args:
        kafka: That it talks to.
        properties: Its callbacks are looked at, the rest is not.
    """

    def __init__(self, kafka: Kafka, properties: dict[str, Any]) -> None:
        self.readings: dict[int, Reading] = {}
        self.assignments = 0  # so far
        self._kafka = kafka
        self._properties = properties
        self._told: deque[Told | Callable[[], None]] = deque()
        self._requests: deque[Request] = deque()
        self._paused: set[int] = set()  # kept while a partition is away
        self._ends: dict[int, tuple[int, int]] = {}
        self._wanted: dict[int, int] = {}
        self._handing = frozenset[int]()  # to another, once each commit was answered
        self._has_joined = self._is_rebalancing = self._has_assigned = False
        self._is_called = self._is_leaving = self._knows_no_broker = False
        self._failure: KafkaError | None = None
        self._statistics_at_s = kafka.clock.monotonic()
        self._on_assign: Callable[..., None]
        self._on_revoke: Callable[..., None]
        self._on_lost: Callable[..., None]
        for reading in kafka.newest.readings.values() if kafka.newest else ():
            reading.is_gone = True
        kafka.newest = self

    @property
    def waits(self) -> int:
        """How many commits were not answered yet, but for those out of a rebalance."""
        return sum(not request.in_rebalance for request in self._requests)

    # What happens to it

    def goes_away(self) -> None:
        """It finds no broker any more."""
        error = KafkaError(KafkaError._ALL_BROKERS_DOWN, '1/1 brokers are down')
        self._told.append(partial(self._properties['error_cb'], error))

    def forget_brokers(self) -> None:
        self._knows_no_broker = True

    def is_given_up(self) -> None:
        """Its session has ended; it hears of that."""
        if self._is_rebalancing or self._is_leaving or not self._has_joined:
            return
        self._kafka.group.give_up(self)
        self._has_joined, self._handing = False, frozenset()
        if self.readings:
            self._is_rebalancing = True
            self._told.append(self._lose)

    def fail(self, text: str) -> None:
        self._failure = KafkaError(KafkaError._FATAL, text, fatal=True)
        self._kafka.group.give_up(self)

    def is_killed(self, *, late: bool) -> None:
        """Its process has ended; what it was sending has arrived, or not."""
        while self._requests and late:
            self._take(self._requests.popleft())
        self._kafka.group.give_up(self)

    # What is asked of it

    def subscribe(
        self,
        topics: list[str],
        on_assign: Callable[..., None],
        on_revoke: Callable[..., None],
        on_lost: Callable[..., None],
    ) -> None:
        assert topics == [TOPIC]
        self._on_assign, self._on_revoke, self._on_lost = on_assign, on_revoke, on_lost

    def poll(self, timeout: float) -> Told | None:
        for _ in range(WITHIN_A_POLL if timeout else 1):
            self._work()
            self._raise_failure()
            while self._told:
                told = self._told.popleft()
                if not isinstance(told, Told):
                    told()
                elif self._counts(told):
                    return self._handed_out(told)
        self._kafka.clock.sleep(timeout)
        return None

    def consume(self, num_messages: int, timeout: float) -> list[Told]:
        assert timeout == 0.0, 'it waits for all of that time'
        self._work()
        self._raise_failure()
        batch: list[Told] = []
        while self._told and len(batch) < num_messages:
            told = self._told.popleft()
            if not isinstance(told, Told):
                told()
                batch = [*filter(self._counts, batch)]
            elif self._counts(told):
                batch.append(self._handed_out(told))
        return batch

    def commit(self, *, offsets: Iterable[TopicPartition], asynchronous: bool) -> None:
        self._raise_failure()
        group = self._kafka.group
        request = {it.partition: Stored(it.offset, it.metadata or '') for it in offsets}
        if asynchronous:
            self._requests.append(Request(group.life, request, self._is_called))
            return
        self._reach()
        if (error := group.take(self, group.life, request)) is not None:
            raise KafkaException(error)

    def committed(self, partitions: Sequence[TopicPartition], timeout: float) -> list[Place]:
        self._reach(timeout)
        offsets, nothing = self._kafka.group.offsets, Stored(OFFSET_INVALID, '')
        return [Place(TOPIC, p.partition, *offsets.get(p.partition, nothing)) for p in partitions]

    def assignment(self) -> list[TopicPartition]:
        return [TopicPartition(TOPIC, number) for number in self.readings]

    def incremental_assign(self, partitions: Iterable[TopicPartition]) -> None:
        self._raise_failure()
        self._has_assigned = True
        self.assignments += 1
        for place in partitions:
            if place.partition in self.readings:
                raise KafkaException(KafkaError(KafkaError._CONFLICT))
            reading = Reading(place.partition, place.offset, place.offset)
            self.readings[place.partition] = reading

    def incremental_unassign(self, partitions: Iterable[TopicPartition]) -> None:
        self._raise_failure()
        for place in partitions:
            if self.readings.pop(place.partition, None) is None:
                raise KafkaException(KafkaError(KafkaError._INVALID_ARG))

    def pause(self, partitions: Iterable[TopicPartition]) -> None:
        for place in partitions:
            if place.partition not in self._paused:
                self._paused.add(place.partition)
                self.readings[place.partition].rewind()

    def resume(self, partitions: Iterable[TopicPartition]) -> None:
        self._paused -= {place.partition for place in partitions}

    def get_watermark_offsets(
        self, partition: TopicPartition, timeout: float = 0.0, *, cached: bool = False
    ) -> tuple[int, int]:
        if cached:
            return self._ends.get(partition.partition, (OFFSET_INVALID, OFFSET_INVALID))
        self._reach(timeout)
        log = self._kafka.logs[partition.partition]
        return log.low, log.stable

    def offsets_for_times(
        self, partitions: Iterable[TopicPartition], timeout: float
    ) -> list[Place]:
        self._reach(timeout)
        logs = self._kafka.logs
        return [Place(TOPIC, it.partition, logs[it.partition].stable) for it in partitions]

    def list_topics(self, topic: str, timeout: float) -> Any:
        self._reach(timeout)
        found = SimpleNamespace(error=None, partitions=dict.fromkeys(self._kafka.numbers))
        return SimpleNamespace(topics={topic: found})

    def unsubscribe(self) -> None:
        self._raise_failure()
        self._is_leaving = True
        self._told.append(lambda: self._revoke(frozenset(self.readings)))

    def close(self) -> None:
        if not self._kafka.is_away:
            self._answer()
        self._kafka.group.give_up(self)

    # Its work

    def _reach(self, timeout: float = 0.0) -> None:
        if self._kafka.is_away:
            self._kafka.clock.sleep(timeout)
            raise KafkaException(KafkaError(KafkaError._TRANSPORT))

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise KafkaException(self._failure)

    def _work(self) -> None:
        """What its own threads do."""
        self._kafka.clock.sleep(0.001)
        self._kafka.work()
        self._report()
        if self._kafka.is_away or self._failure is not None:
            return
        if not self._kafka.group.holds_answers:
            self._answer()
        self._take_its_place()
        for reading in self.readings.values():
            if reading.number not in self._paused and not self._holds_of(reading):
                self._fetch(reading, self._kafka.logs[reading.number])

    def _answer(self) -> None:
        while self._requests:
            request = self._requests.popleft()
            error = self._take(request)
            answers = [Place(TOPIC, number, *to) for number, to in request.offsets.items()]
            self._told.append(partial(self._properties['on_commit'], error, answers))
        if self._handing:
            handed, self._handing = self._handing, frozenset()
            self._kafka.group.held -= handed
            self._kafka.on_handed_over(handed)

    def _take(self, request: Request) -> KafkaError | None:
        return self._kafka.group.take(self, request.life, request.offsets)

    def _take_its_place(self) -> None:
        group = self._kafka.group
        if self._is_rebalancing or self._is_leaving or self._requests or self._handing:
            return
        if self._kafka.newest is not self:
            return
        if not self._has_joined:
            group.let_in(self)
            self._has_joined = True
            self._rebalance(self._assign, group.share)
        elif gone := self.readings.keys() - group.share:
            self._rebalance(self._revoke, frozenset(gone))
        elif new := group.share - self.readings.keys():
            self._rebalance(self._assign, new)

    def _rebalance(self, how: Callable[[frozenset[int]], None], numbers: frozenset[int]) -> None:
        self._is_rebalancing = True
        if how == self._assign:
            self._kafka.group.held |= numbers
        self._told.append(partial(how, numbers))

    def _assign(self, numbers: frozenset[int]) -> None:
        self._is_rebalancing = self._has_assigned = False
        self._kafka.on_assigned(numbers)
        self._call(self._on_assign, numbers)
        if not self._has_assigned:
            self.incremental_assign(_places(numbers))

    def _revoke(self, numbers: frozenset[int]) -> None:
        self._is_rebalancing = False
        self._call(self._on_revoke, numbers)
        self._drop(numbers)
        self._handing |= numbers

    def _lose(self) -> None:
        self._is_rebalancing = False
        self._call(self._on_lost, frozenset(self.readings))
        self._drop(frozenset(self.readings))

    def _call(self, callback: Callable[..., None], numbers: frozenset[int]) -> None:
        self._is_called = True
        callback(self, _places(numbers))
        self._is_called = False

    def _drop(self, numbers: frozenset[int]) -> None:
        for number in numbers & self.readings.keys():
            self.readings.pop(number).is_gone = True
            self._wanted.pop(number, None)
        gaps = self._kafka.gaps  # of what was handed out in the same moment, and does not count
        gaps[:] = [gap for gap in gaps if gap.number not in numbers]

    def _fetch(self, reading: Reading, log: Log) -> None:
        if reading.is_stopped:
            return
        if reading.at < 0:
            self._find(reading, log)  # with a request of its own
            return
        if not log.low <= reading.at <= log.high:
            self._wanted[reading.number] = min(
                reading.at, self._wanted.get(reading.number, reading.at)
            )
            self._stop(reading, reading.at)
            return
        self._ends[reading.number] = log.low, log.high
        found = [it for it in log.records if reading.at <= it < log.stable][:FETCH]
        self._told += [Told(reading, reading.version, it) for it in found]
        reading.at = found[-1] + 1 if len(found) == FETCH else max(reading.at, log.stable)
        if reading.at == log.stable != reading.ended:
            reading.ended = reading.at
            self._told.append(
                Told(reading, reading.version, reading.at, KafkaError._PARTITION_EOF)
            )

    def _find(self, reading: Reading, log: Log) -> None:
        """Ask for the offset that the group has, or for the first one."""
        stored = self._kafka.group.offsets.get(reading.number)
        if reading.at == OFFSET_BEGINNING:
            reading.low = reading.start = reading.at = log.low
        elif stored is None:
            self._stop(reading, OFFSET_INVALID)
        else:
            reading.start = reading.at = stored.offset

    def _stop(self, reading: Reading, wanted: int) -> None:
        reading.is_stopped = True
        self._told.append(Told(reading, reading.version, wanted, KafkaError._AUTO_OFFSET_RESET))

    def _holds_of(self, reading: Reading) -> bool:
        return any(isinstance(it, Told) and it.reading is reading for it in self._told)

    def _counts(self, told: Told) -> bool:
        reading = told.reading
        return self.readings.get(reading.number) is reading and told.version == reading.version

    def _handed_out(self, told: Told) -> Told:
        number = told.reading.number
        if told.code is None:
            told.reading.start = told.at + 1
        if told.code != KafkaError._AUTO_OFFSET_RESET and number in self._wanted:
            low = told.at if told.reading.low is None else told.reading.low
            gap = Gap(number, self._wanted.pop(number), low, told.at)
            if self._kafka.newest is self:
                self._kafka.gaps.append(gap)
        return told

    def _report(self) -> None:
        """Tell its statistics, now and then."""
        clock = self._kafka.clock
        if clock.now_s < self._statistics_at_s:
            return
        self._statistics_at_s = clock.now_s + STATISTICS_S
        state = 'DOWN' if self._kafka.is_away else 'UP'
        broker = {'nodeid': 1, 'source': 'learned', 'state': state}
        ends = {
            number: {
                'leader': 1, 'fetch_state': 'active',
                'ls_offset': self._kafka.logs[number].stable, 'hi_offset': high,
            }
            for number, (_, high) in self._ends.items()
            if number in self.readings
        }  # fmt: skip
        brokers = {} if self._knows_no_broker else {'b:1/1': broker}
        topics = {TOPIC: {'metadata_age': 1000, 'partitions': ends}}
        told = json.dumps({'type': 'consumer', 'brokers': brokers, 'topics': topics})
        self._told.append(partial(self._properties['stats_cb'], told))


def _places(numbers: Iterable[int]) -> list[TopicPartition]:
    return [TopicPartition(TOPIC, number) for number in numbers]
