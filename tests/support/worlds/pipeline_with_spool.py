"""The pipeline ROS -> Kafka with a spool on disk, driven step by step with ends in memory."""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import pytest
from support.kafka.identities import AUTHOR, STRING, identify
from support.worlds import flights

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import Message, Record, Reports
from ros2_kafka_bridge.errors import EncodeError, RecordTooLargeError, RouteError, TransportError
from ros2_kafka_bridge.formats import guarded
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.messages import MessageEntry
from ros2_kafka_bridge.route.labels import Conversion, make_headers
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.type_hash import check_nothing
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spool.rows import Row
from ros2_kafka_bridge.spool.store import Spool, file_of
from ros2_kafka_bridge.testing.memory import MemoryMessageSource, MemoryRecordSink
from ros2_kafka_bridge.threads.stop import Stop

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
GID = bytes(range(16))


def made_ns(number: int) -> int:
    """When the message of that number was published."""
    return 1_700_000_000_000_000_000 + number


def encode(cdr: bytes) -> bytes:
    if cdr.startswith(b'bad'):
        raise EncodeError('not what it should be')
    return cdr


class Moody(MemoryRecordSink[MessageEntry]):
    """A sink whose broker refuses all that is in flight, so many times.

    Never one of several: an idempotent producer does not deliver what is behind a failure.
    """

    refusals = 0

    def poll(self, timeout_s: float) -> Reports[MessageEntry]:
        if not self.refusals or not self.answering or not self._in_flight:
            return super().poll(timeout_s)
        self.refusals -= 1
        refused, self._in_flight = self._in_flight, []
        return Reports([], [(entry, TransportError('timed out')) for entry, _ in refused])


class Broker(Moody):
    """A broker that also refuses all that comes with a record that is too large for it."""

    def poll(self, timeout_s: float) -> Reports[MessageEntry]:
        held = [record.value or b'' for _, record in self._in_flight]
        if not self.answering or not any(b'too large' in value for value in held):
            return super().poll(timeout_s)
        refused, self._in_flight = self._in_flight, []
        error = RecordTooLargeError(1, 0, 'max.message.bytes')
        return Reports([], [(entry, error) for entry, _ in refused])


class Letters(MemoryRecordSink[Any]):
    """The topic of the dead letters, which may refuse each of them."""

    forbidden = False

    def poll(self, timeout_s: float) -> Reports[Any]:
        if not self.forbidden:
            return super().poll(timeout_s)
        refused, self._in_flight = self._in_flight, []
        return Reports([], [(token, RouteError('no permission')) for token, _ in refused])


class NoTail:
    """The end of a topic that holds `found`, once it is read."""

    topic = 'orders'
    complete = True
    is_cut = False
    since_ns = 0.0

    def __init__(self) -> None:
        self.records = 0
        self.partitions = 0
        self.found: list[Record] = []

    def read(self, records: int, within_s: float, note: Callable[[Record], None]) -> None:
        del within_s
        self.records, self.partitions = records, 1
        for record in self.found:
            note(record)


class House(flights.Driven):
    """One life of a pipeline, with a spool in `place`."""

    def __init__(
        self,
        place: Path,
        spool: dict[str, Any] | None = None,
        sink: Moody | None = None,
        *,
        answering: bool = True,
        away: bool = False,
        **more: Any,
    ) -> None:
        self.source = MemoryMessageSource()
        self.sink = sink or Moody()
        self.sink.answering = answering
        if away:
            go_away(self)
        self.tail = NoTail()
        self.letters = Letters()
        self.clock = 0
        disk = {'path': str(place), **(spool or {})}
        route = validated(
            RosToKafkaRoute, {'name': 'orders', **flights.TO_KAFKA, 'spool': disk, **more}
        )
        assert route.spool is not None
        self.sink.room = route.max_in_flight  # as that of the real producer
        self.spool = Spool(file_of(place, 'test', route.name), sync=False, log=LOG)
        self.backlog = Backlog(self.spool, route.spool, LOG, drops=route.drops)
        self.pipeline: RosToKafka = RosToKafka(
            route,
            self.source,
            Produced(self.tail, NoTail(), identify, lambda _: None, LOG),
            self.sink,
            Conversion(
                lambda: guarded(encode, route.max_message_bytes, EncodeError),
                lambda _: b'key',
                make_headers(AUTHOR, STRING, lambda _: ''),
                check_nothing,
            ),
            DeadLetters('orders.dead', self.letters, lambda: None, LOG),
            self.backlog,
            LOG,
        )
        self.pipeline._prepare()
        self.begin()

    def give(self, *numbers: int) -> None:
        for number in numbers:
            self.source.waiting.append(Message(b'%d' % number, GID, number, made_ns(number)))

    def until_all_confirmed(self, *numbers: int) -> Self:
        """What there is, and the messages of these numbers."""
        self.give(*numbers)
        for _ in range(1000):
            self.steps(1)
            if not self.pipeline._flight and not self.pipeline._spooling.waiting:
                return self
        pytest.fail('it never ends')

    def until_all_taken_are_confirmed(self, *numbers: int) -> None:
        self.give(*numbers)
        for _ in range(1000):
            self.steps(1)
            if not self.source.waiting:
                break
        else:
            pytest.fail('the robots are held back for ever')
        self.until_all_confirmed()

    def check_balance(self) -> None:
        self.pipeline._take_snapshot()
        snapshot = self.pipeline.snapshot
        assert snapshot.balanced, snapshot
        flights.check(self.pipeline._flight)
        assert all(count >= 0 for count in snapshot if isinstance(count, int)), snapshot

    def crash(self) -> None:
        """Leave everything as a SIGKILL would."""
        self.spool.is_open = False
        self.spool._close_database()
        self.spool._lock.release()

    def drain(self, *, limited: bool = True) -> None:
        stop = Stop()
        stop.ask(limited=limited)
        self.pipeline._drain(stop)
        self.check_balance()
        self._opened.__exit__(None, None, None)

    def numbers(self) -> list[int]:
        return [int(record.value or b'0') for record in self.sink.records]

    def count(self, name: str) -> int:
        self.pipeline._take_snapshot()
        return int(getattr(self.pipeline.snapshot, name))

    def on_disk(self) -> list[int]:
        return [row.number for row in self.spool.read(0, 1_000_000, 1 << 40)]


def go_away(house: House) -> None:
    house.sink.away, house.sink.answering = 'Kafka is away', False


def come_back(house: House) -> None:
    house.sink.away, house.sink.answering = '', True


def go_on(house: House, *numbers: int) -> None:
    """Let Kafka be back, until all has arrived, and the messages of these numbers."""
    come_back(house)
    house.until_all_confirmed(*numbers)


def refused(rows: Sequence[Row]) -> int:
    del rows
    raise TransportError('the disk is full')


def fill(house: House) -> None:
    """Let the disk take nothing from now on."""
    house.spool.append = refused  # type: ignore[method-assign]


def make_room(house: House) -> None:
    """Let the disk take all again."""
    house.spool.__dict__.pop('append', None)


def fill_while_away(house: House, *numbers: int) -> None:
    """Let the disk fill up while Kafka is away, and the messages of those numbers come then."""
    go_away(house)
    house.take(0)
    fill(house)
    house.take(*numbers)


Make = Callable[..., House]
"""Makes a house with these settings of the spool, and these of the route."""
