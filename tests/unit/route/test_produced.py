"""What is in Kafka already is found, however far back it lies, and not looked for without need."""

import logging
import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dedup import Numbers
from ros2_kafka_bridge.endpoints import HeaderList, Message, Offer, Outgoing
from ros2_kafka_bridge.errors import EncodeError, RouteError, TransportError
from ros2_kafka_bridge.route import produced as under_test
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.refused import letter_of_message, message_of_letter
from ros2_kafka_bridge.testing.memory import MemoryRecord

LOG = logging.LoggerAdapter(logging.getLogger('test.produced'), {})
LATCHED = Offer('reliable', 'transient_local')
ROBOT, CAMERA = b'robot' * 3 + b'!', b'camera' * 2 + b'!!!!'
HOUR_NS = 3600 * 10**9
NOW_NS = time.time_ns()

Row = tuple[bytes, int, float]  # publisher, number, time of the record


class MemoryTail:
    """A topic in memory: the rows of each partition, oldest first."""

    topic = 'orders'

    def __init__(self, *partitions: list[Row]) -> None:
        self._partitions = partitions
        self._read = [0] * len(partitions)
        self.records = 0
        self.reads = 0
        self.numbers: dict[bytes, Numbers] = {}
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

    def read(self, records: int, within_s: float) -> None:
        assert records > 0
        assert within_s > 0
        self.reads += 1
        if self.failure is not None:
            raise self.failure
        for number, rows in enumerate(self._partitions):
            end = len(rows) - self._read[number]
            for gid, seq, _ in rows[max(0, end - records) : end]:
                self.numbers.setdefault(gid, Numbers()).add(seq)
                self.records += 1
            self._read[number] += end - max(0, end - records)


@pytest.fixture(autouse=True)
def _small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, 'FIRST_RECORDS', 2)


def message(seq: int, gid: bytes = ROBOT, at_ns: int = NOW_NS) -> Message:
    return Message(b'', gid, seq, at_ns)


def looked(tail: MemoryTail, letters: MemoryTail | None = None) -> Produced:
    found = Produced(tail, letters or MemoryTail(), LOG)
    found.look(LATCHED)
    return found


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
    assert looked(MemoryTail(old)).contains(message(1, at_ns=NOW_NS + 24 * HOUR_NS))


def test_a_message_not_produced_among_others_of_its_publisher_costs_no_reading() -> None:
    tail = MemoryTail([row for row in rows(1000) if row[1] != 999])
    assert not looked(tail).contains(message(999))
    assert tail.reads == 1


def test_nothing_is_read_for_publishers_that_send_no_history() -> None:
    tail = MemoryTail(rows(10))
    found = Produced(tail, tail, LOG)
    found.look(Offer('reliable', 'volatile'))
    assert not found.contains(message(10))
    assert not found.holds_letter(ROBOT, 10, NOW_NS)
    assert tail.reads == 0


def test_what_a_spool_holds_counts_as_produced() -> None:
    found = Produced(MemoryTail([]), MemoryTail(), LOG)
    found.add({(ROBOT, 7)})
    found.add({(ROBOT, 8)})
    assert [found.contains(message(seq)) for seq in (6, 7, 8)] == [False, True, True]


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
    assert [found.holds_letter(ROBOT, seq, NOW_NS) for seq in (1, 2, 3)] == [False, True, False]
    assert not found.holds_letter(CAMERA, 2, NOW_NS)
    assert letters.reads == 1


def test_no_further_than_the_end_of_the_dead_letters_is_read() -> None:
    letters = MemoryTail(rows(1000))
    found = looked(MemoryTail([]), letters)
    assert not found.holds_letter(ROBOT, 1, NOW_NS), 'it may be repeated'
    assert found.holds_letter(ROBOT, 1000, NOW_NS)
    assert letters.records == 2


def test_a_message_published_since_the_start_is_not_looked_for_among_the_dead_letters() -> None:
    letters = MemoryTail(rows(10))
    assert not looked(MemoryTail([]), letters).holds_letter(ROBOT, 11, NOW_NS + HOUR_NS)
    assert letters.reads == 0


def test_without_a_dead_letter_topic_no_message_is_a_dead_letter() -> None:
    assert not looked(MemoryTail([]), MemoryTail()).holds_letter(ROBOT, 1, NOW_NS)


@pytest.mark.parametrize('error', [RouteError('no right'), TransportError('away')])
def test_dead_letters_that_cannot_be_read_stop_nothing(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    letters = MemoryTail(rows(10))
    letters.failure = error
    found = looked(MemoryTail([]), letters)
    caplog.set_level(logging.INFO)
    for seq in (9, 10):
        assert not found.holds_letter(ROBOT, seq, NOW_NS)
    assert letters.reads == 1, 'each costs seconds'
    assert f'{error}, so a dead letter of before may come again' in caplog.text


ROUTE = validated(
    RosToKafkaRoute,
    {'name': 'orders', 'from': {'ros': '/orders'}, 'to': {'kafka': 'orders'}, 'format': 'text'},
)


def letter_of(route: RosToKafkaRoute, **more: str) -> MemoryRecord:
    """A letter of a message of that route, as Kafka's client shows it."""
    headers: HeaderList = [('ros.gid', ROBOT.hex()), ('ros.seq', '7')]
    refused = Outgoing('orders', None, b'bad', headers)
    letter = letter_of_message(route, refused, EncodeError('bad'))
    told = [(name, more.get(name, value)) for name, value in letter.headers]
    return MemoryRecord(b'bad', header_list=[(n, str(value).encode()) for n, value in told])


def test_a_letter_of_the_route_tells_which_message_it_is() -> None:
    assert message_of_letter(ROUTE, letter_of(ROUTE)) == (ROBOT, 7)


@pytest.mark.parametrize('name', ['dead_letter.route', 'dead_letter.topic', 'dead_letter.source'])
def test_a_letter_of_another_way_says_nothing_of_this_one(name: str) -> None:
    assert message_of_letter(ROUTE, letter_of(ROUTE, **{name: 'another'})) is None


def test_a_record_that_is_no_letter_says_nothing() -> None:
    headers: HeaderList = [('ros.gid', ROBOT.hex().encode()), ('ros.seq', b'7')]
    assert message_of_letter(ROUTE, MemoryRecord(b'', header_list=headers)) is None
    assert message_of_letter(ROUTE, MemoryRecord(b'')) is None
