"""What is in Kafka already is found, however far back it lies, and not looked for without need."""

import logging
import math
import time
from collections.abc import Callable, Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.kafka.identities import AUTHOR, headers_by, identify, record_by

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import HeaderList, Message, Offer, Outgoing, Record
from ros2_kafka_bridge.errors import EncodeError, RouteError, TransportError
from ros2_kafka_bridge.route import produced as under_test
from ros2_kafka_bridge.route.identity import Author, Identity
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.rejections import letter_of_message, message_of_letter
from ros2_kafka_bridge.testing.memory import MemoryRecord

LOG = logging.LoggerAdapter(logging.getLogger('test.produced'), {})
LATCHED = Offer('reliable', 'transient_local')
ROBOT, CAMERA = b'robot' * 3 + b'!', b'camera' * 2 + b'!!!!'
HOUR_NS = 3600 * 10**9
NOW_NS = time.time_ns()

Row = tuple[bytes, int, float]  # publisher, number, time of the record, and of the message


class MemoryTail:
    """A topic in memory: the rows of each partition, oldest first."""

    topic = 'orders'
    is_cut = False

    def __init__(self, *partitions: list[Row]) -> None:
        self._partitions = partitions
        self._read = [0] * len(partitions)
        self.records = 0
        self.reads = 0
        self.clock_ahead_ns = 0  # of the publishers
        self.forged: list[MemoryRecord] = []
        self.failure: Exception | None = None

    @property
    def partitions(self) -> int:
        return len(self._partitions)

    @property
    def complete(self) -> bool:
        return all(n == len(p) for n, p in zip(self._read, self._partitions, strict=True))

    @property
    def since_ns(self) -> float:
        firsts = [
            rows[-count][2] if count else math.inf
            for count, rows in zip(self._read, self._partitions, strict=True)
            if count < len(rows)
        ]
        return max(firsts, default=0.0)

    def read(self, records: int, within_s: float, note: Callable[[Record], None]) -> None:
        assert records > 0
        assert within_s > 0
        self.reads += 1
        for record in self.forged:
            note(record)
        if self.failure is not None:
            raise self.failure
        for number, rows in enumerate(self._partitions):
            end = len(rows) - self._read[number]
            for gid, seq, at_ns in rows[max(0, end - records) : end]:
                note(record_by(gid, seq, int(at_ns) + self.clock_ahead_ns))
                self.records += 1
            self._read[number] += end - max(0, end - records)


class UnreadTail(MemoryTail):
    """A topic that was not read yet: it has partitions once it was."""

    @property
    def partitions(self) -> int:
        return super().partitions if self.reads else 0


@pytest.fixture(autouse=True)
def _small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, 'FIRST_RECORDS', 2)


def message(seq: int, gid: bytes = ROBOT, at_ns: int = NOW_NS) -> Message:
    return Message(b'', gid, seq, at_ns)


def looked(tail: MemoryTail, letters: MemoryTail | None = None) -> Produced:
    found = produced(tail, letters)
    found.look(LATCHED)
    return found


def produced(tail: MemoryTail, letters: MemoryTail | None = None) -> Produced:
    def of_letter(record: Record) -> Identity | None:
        return identify(record.headers() or [])

    return Produced(tail, letters or MemoryTail(), identify, of_letter, LOG)


def identity(seq: int, gid: bytes = ROBOT, at_ns: int = NOW_NS) -> Identity:
    return Identity(gid, seq, at_ns)


def rows(count: int, gid: bytes = ROBOT, at_ns: float = NOW_NS) -> list[Row]:
    return [(gid, seq, at_ns) for seq in range(1, count + 1)]


@given(
    st.lists(st.tuples(st.sampled_from([ROBOT, CAMERA]), st.integers(0, 2)), max_size=60),
    st.lists(st.booleans(), min_size=60, max_size=60),
)
def test_a_message_is_found_exactly_if_it_is_there(
    events: list[tuple[bytes, int]], is_there: list[bool]
) -> None:
    """Two publishers, whose messages go to any of three partitions, one every ten minutes."""
    partitions: list[list[Row]] = [[], [], []]
    history, present, last = [], set(), {ROBOT: 0, CAMERA: 0}
    for number, ((gid, partition), there) in enumerate(zip(events, is_there, strict=False)):
        last[gid] += 1
        at_ns = NOW_NS + (number - len(events)) * HOUR_NS // 6
        history.append(message(last[gid], gid, at_ns))
        if there:
            partitions[partition].append((gid, last[gid], at_ns))
            present.add((gid, last[gid]))
    found = looked(MemoryTail(*partitions))
    for one in history:
        assert found.contains(one) == ((one.gid, one.seq) in present)


def test_a_long_history_of_one_publisher_is_found_to_its_beginning() -> None:
    tail = MemoryTail(rows(1000))
    found = looked(tail)
    assert all(found.contains(message(seq)) for seq in range(1, 1001))
    assert not found.contains(message(1001))
    assert tail.complete
    assert tail.reads <= 11, 'it doubles'


def test_a_new_publisher_is_not_looked_for_among_records_older_than_its_messages() -> None:
    old = rows(1000, CAMERA, NOW_NS - HOUR_NS)
    tail = MemoryTail(old)
    assert not looked(tail).contains(message(1))
    assert tail.reads == 1


def test_a_clock_that_is_ahead_says_nothing() -> None:
    old = [(ROBOT, 1, NOW_NS - 2 * HOUR_NS), *rows(100, CAMERA, NOW_NS - HOUR_NS)]
    tail = MemoryTail(old)
    tail.clock_ahead_ns = 24 * HOUR_NS
    assert looked(tail).contains(message(1, at_ns=NOW_NS + 22 * HOUR_NS))


def test_a_message_not_produced_among_others_of_its_publisher_costs_no_reading() -> None:
    tail = MemoryTail([row for row in rows(1000) if row[1] != 999])
    assert not looked(tail).contains(message(999))
    assert tail.reads == 1


def test_nothing_is_read_for_publishers_that_send_no_history() -> None:
    tail = MemoryTail(rows(10))
    found = produced(tail, tail)
    found.look(Offer('reliable', 'volatile'))
    assert not found.contains(message(10))
    assert not found.holds_letter(identity(10))
    assert tail.reads == 0


def test_what_a_spool_holds_counts_as_produced() -> None:
    found = produced(MemoryTail([]))
    found.add({(ROBOT, 7)})
    found.add({(ROBOT, 8)})
    assert [found.contains(message(seq)) for seq in (6, 7, 8)] == [False, True, True]
    reborn = message(7, at_ns=time.time_ns() + HOUR_NS)
    assert not found.contains(reborn), 'another one that has come back with the gid'


def test_guarantee_6b_a_number_that_somebody_else_has_used_costs_its_message_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Public numbers: a stranger has written those that are still to come."""
    tail = MemoryTail([(ROBOT, seq, NOW_NS) for seq in range(1, 6)])
    tail.forged = [
        MemoryRecord(
            b'', header_list=[('ros.gid', ROBOT.hex().encode()), ('ros.seq', b'%d' % seq)]
        )
        for seq in range(3, 41)
    ]
    found = looked(tail)
    there = [seq for seq in range(1, 36) if found.contains(message(seq))]
    assert there == [1, 2, 3, 4, 5], 'the history is not repeated, the others are sent'
    assert found.unproved == 30
    [told] = [line for line in caplog.messages if 'proves nothing' in line]
    assert f'ros.gid {ROBOT.hex()} and ros.seq 6' in told


def test_a_message_without_a_time_is_sent_and_nothing_is_read_for_it() -> None:
    tail = MemoryTail(rows(1000))
    found = looked(tail)
    assert not found.contains(message(1000, at_ns=0))
    assert not found.contains(Message(b'', b'', 0, NOW_NS)), 'nor one without a publisher'
    assert tail.reads == 0


def test_what_cannot_be_read_in_time_is_gone_on_without(caplog: pytest.LogCaptureFixture) -> None:
    """Else a stranger with records that take long to read would keep a publisher out for ever."""
    tail = UnreadTail(rows(1000))
    tail.is_cut = True
    found = looked(tail)
    assert not found.contains(message(1)), 'it may be repeated, and is not lost'
    assert found.contains(message(1000))
    assert tail.reads == 1
    assert 'the end of orders cannot be read within 60 s' in caplog.text


def test_of_a_publisher_without_a_time_it_is_said_that_its_history_comes_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    found = looked(UnreadTail([(ROBOT, seq, 0) for seq in range(4, 6)]))
    assert not any(found.contains(message(seq, at_ns=0)) for seq in range(1, 6))
    assert found.unproved == 0, 'nobody has forged anything'
    [told] = caplog.messages
    assert f'publisher {ROBOT.hex()} sends no time' in told


def test_it_ends_at_its_bound_and_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(under_test, 'MAX_RECORDS', 100)
    tail = MemoryTail(rows(1000))
    found = looked(tail)
    assert not found.contains(message(1)), 'it may be repeated, and is not lost'
    assert found.contains(message(950))
    assert tail.records < 200
    reads = tail.reads
    assert not found.contains(message(2))
    assert tail.reads == reads
    assert 'looks no further back than' in caplog.text


@pytest.mark.parametrize('error', [RouteError('no right'), TransportError('away')])
def test_a_topic_that_cannot_be_read_any_further_loses_no_message(
    error: Exception, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(under_test, '_FURTHER_S', 0.01)
    tail = MemoryTail(rows(1000))
    found = looked(tail)
    tail.failure = error
    assert not found.contains(message(1))
    assert str(error) in caplog.text


def test_what_a_publisher_sends_again_is_looked_for_among_the_dead_letters_once() -> None:
    letters = MemoryTail([(ROBOT, 2, NOW_NS)])
    found = looked(MemoryTail([]), letters)
    assert letters.reads == 0, 'not before a message is refused'
    assert [found.holds_letter(identity(seq)) for seq in (1, 2, 3)] == [False, True, False]
    assert not found.holds_letter(identity(2, CAMERA))
    assert letters.reads == 1


def test_no_further_than_the_end_of_the_dead_letters_is_read() -> None:
    letters = MemoryTail(rows(1000))
    found = looked(MemoryTail([]), letters)
    assert not found.holds_letter(identity(1)), 'it may be repeated'
    assert found.holds_letter(identity(1000))
    assert letters.records == 2


def test_a_message_published_since_the_start_is_not_looked_for_among_the_dead_letters() -> None:
    letters = MemoryTail(rows(10))
    assert not looked(MemoryTail([]), letters).holds_letter(identity(11, at_ns=NOW_NS + HOUR_NS))
    assert letters.reads == 0


def test_without_a_dead_letter_topic_no_message_is_a_dead_letter() -> None:
    assert not looked(MemoryTail([]), MemoryTail()).holds_letter(identity(1))


@pytest.mark.parametrize('error', [RouteError('no right'), TransportError('away')])
def test_dead_letters_that_cannot_be_read_stop_nothing(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    letters = MemoryTail(rows(10))
    letters.failure = error
    found = looked(MemoryTail([]), letters)
    caplog.set_level(logging.INFO)
    for seq in (9, 10):
        assert not found.holds_letter(identity(seq))
    assert letters.reads == 1, 'each costs seconds'
    assert f'{error}, so a dead letter of before may come again' in caplog.text


ROUTE = validated(
    RosToKafkaRoute,
    {'name': 'orders', 'from': {'ros': '/orders'}, 'to': {'kafka': 'orders'}, 'format': 'text'},
)


def letter_of(
    route: RosToKafkaRoute, author: Author = AUTHOR, more: Mapping[str, str] | None = None
) -> MemoryRecord:
    """A letter of a message of that route, as Kafka's client shows it."""
    refused = Outgoing('orders', None, b'bad', headers_by(ROBOT, 7, NOW_NS, author))
    letter = letter_of_message(route, refused, EncodeError('bad'))
    told = [(name, (more or {}).get(name, value)) for name, value in letter.headers]
    headers: HeaderList = [(n, v.encode() if isinstance(v, str) else v) for n, v in told]
    return MemoryRecord(b'bad', header_list=headers)


def test_a_letter_of_the_route_tells_which_message_it_is() -> None:
    assert message_of_letter(ROUTE, identify, letter_of(ROUTE)) == identity(7)


@pytest.mark.parametrize('name', ['dead_letter.route', 'dead_letter.topic', 'dead_letter.source'])
def test_a_letter_of_another_way_says_nothing_of_this_one(name: str) -> None:
    assert message_of_letter(ROUTE, identify, letter_of(ROUTE, more={name: 'another'})) is None


def test_a_letter_with_the_headers_of_another_writer_proves_nothing() -> None:
    for other in (
        ('/other', 'test', 'orders'),
        ('/orders', 'other', 'orders'),
        ('/orders', 'test', 'x'),
    ):
        found = message_of_letter(ROUTE, identify, letter_of(ROUTE, Author(*other)))
        assert found == identity(7, at_ns=0)


def test_a_record_that_is_no_letter_says_nothing() -> None:
    assert message_of_letter(ROUTE, identify, record_by(ROBOT, 7, NOW_NS)) is None
    assert message_of_letter(ROUTE, identify, MemoryRecord(b'')) is None
