"""What is in Kafka already is found, however far back it lies, and not looked for without need."""

import logging
import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge import produced as under_test
from ros2_kafka_bridge.dedup import Numbers
from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.produced import Produced
from ros2_kafka_bridge.ros.subscription import Offer

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


def looked(tail: MemoryTail) -> Produced:
    found = Produced(tail, LOG)
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
    found = Produced(tail, LOG)
    found.look(Offer('reliable', 'volatile'))
    assert not found.contains(message(10))
    assert tail.reads == 0


def test_what_a_spool_holds_counts_as_produced() -> None:
    found = Produced(MemoryTail([]), LOG)
    found.also({(ROBOT, 7)})
    found.also({(ROBOT, 8)})
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
