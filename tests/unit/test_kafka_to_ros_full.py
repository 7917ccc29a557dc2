"""What the pipeline Kafka -> ROS holds and drops where readers are slow, driven step by step."""

import math
import re
import time
from collections import Counter, deque
from collections.abc import Iterable
from datetime import datetime, timedelta
from itertools import takewhile
from random import Random

import pytest
from hypothesis import given, settings, strategies
from support.worlds.clocks import Clock
from support.worlds.pipeline_to_ros import MINE, House

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route import obstacle, publishing, readiness
from ros2_kafka_bridge.route.pieces import PIECE
from ros2_kafka_bridge.testing.memory import MemoryMessageSink

pytestmark = pytest.mark.usefixtures('no_settle_time')

ONE_BYTES = 1400  # of a message of 1000 bytes in flight


@pytest.fixture(autouse=True)
def no_time_to_acknowledge(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever does not take at once does not keep up, unless a test has a clock."""
    monkeypatch.setattr(publishing, '_ACKNOWLEDGED_BY_S', -1.0)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Time for readers that keep up, which does not pass by itself."""
    monkeypatch.setattr(publishing, '_ACKNOWLEDGED_BY_S', 0.2)
    monkeypatch.setattr(publishing, 'time', clock := Clock())
    return clock


def large(*numbers: int) -> list[bytes]:
    return [b'%03d' % number + b'x' * 997 for number in numbers]


def published(house: House) -> list[int]:
    return [int(cdr[4:7]) for cdr in house.sink.published]


def test_a_full_history_waits_and_the_same_message_goes_next() -> None:
    house = House(MemoryMessageSink(acknowledging=False, room=2))
    house.take(b'a', b'b', b'c')
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    house.sink.acknowledge(1)
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']


@pytest.mark.parametrize(
    ('nodes', 'who'),
    [
        (['/picker'], '/picker, '),
        (['/a', '/b'], 'one of /a, /b, '),
        (['/a', '/b', '/c', '/d', '/e'], 'one of /a, /b, /c and 2 more, '),
        ([], ''),
    ],
)
def test_a_route_that_is_held_says_by_whom_and_since_when(
    nodes: list[str], who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(obstacle, 'SAID_AFTER_S', 0.0)
    house = House(MemoryMessageSink(acknowledging=False, room=1, reliable_subscribers=nodes))
    house.take(b'a', b'b', steps=2)
    blocked = house.pipeline._blocked
    blocked._since_s = blocked._moved_s = time.monotonic() - 3600
    before = datetime.now().astimezone() - timedelta(seconds=3600)
    house.pipeline.telling._told_s = -math.inf
    house.steps(1)
    reason = house.pipeline.snapshot.reason
    said = re.fullmatch(
        r'the history is full: a subscriber does not take \((.*)since (\d\d:\d\d:\d\d)\)', reason
    )
    assert said, reason
    assert said[1] == who
    times = {f'{before + timedelta(seconds=late_s):%H:%M:%S}' for late_s in range(30)}
    assert said[2] in times


def test_who_does_not_take_is_not_blamed_for_the_time_of_one_that_has_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The one acknowledges nothing and goes, nobody is there for long, and another comes."""
    monkeypatch.setattr(obstacle, 'SAID_AFTER_S', 0.0)
    house = House(MemoryMessageSink(acknowledging=False, room=1, reliable_subscribers=['/gone']))
    house.take(b'a', b'b', steps=2)
    blocked = house.pipeline._blocked
    blocked._since_s = blocked._moved_s = time.monotonic() - 3600
    house.sink.lose_reader()
    house.sink.reliable_subscribers = ['/picker']
    house.steps(3)
    house.pipeline.telling._told_s = -math.inf
    came = datetime.now().astimezone()
    house.steps(1)
    since = re.search(r'/picker, since (\d\d:\d\d:\d\d)', house.pipeline.snapshot.reason)
    assert since, house.pipeline.snapshot.reason
    assert since[1] in {f'{came - timedelta(seconds=ago_s):%H:%M:%S}' for ago_s in range(30)}


def test_nothing_is_read_while_a_message_waits() -> None:
    house = House(MemoryMessageSink(acknowledging=False, room=1))
    house.take(b'a', b'b')
    house.take(b'c', first=2)
    assert len(house.source.waiting) == 1


def test_drop_oldest_keeps_the_newest_and_counts_the_rest() -> None:
    house = House(MemoryMessageSink(room=0), when_full='drop_oldest', max_in_flight=2)
    house.take(b'a', b'b', b'c', b'd', b'e')
    house.sink.room = 10
    house.steps()
    assert house.sink.published == [b'cdr:d', b'cdr:e']
    assert house.pipeline.counters.snapshot(0).dropped == 3
    assert house.positions() == {0: 5}


def test_what_drop_oldest_drops_behind_an_unconfirmed_head_takes_no_memory() -> None:
    house = House(when_full='drop_oldest', max_in_flight=10, max_in_flight_bytes=50_000)
    house.sink.acknowledging, house.sink.room = False, 10
    flight = house.pipeline._flight
    for first in range(0, 5000, 50):
        house.take(
            *[b'%05d' % n + b'x' * 995 for n in range(first, first + 50)], first=first, steps=1
        )
    house.steps(1)
    assert len(flight) <= 3 * 10 + 50
    assert flight.size_bytes <= 50_000 + 50 * 1_400
    assert house.source.waiting == deque()
    house.sink.acknowledging, house.sink.room = True, 100
    house.steps()
    assert house.sink.published[-1].startswith(b'cdr:04999')
    assert len(house.sink.published) == 20
    assert house.pipeline.counters.snapshot(0).dropped == 4980
    assert house.positions() == {0: 5000}


def test_what_is_delivered_behind_a_letter_that_nobody_takes_has_a_bound() -> None:
    """It would come again after a crash."""
    house = House(max_in_flight_bytes=100_000)
    house.letters.answering = False
    house.take(b'bad', *[b'x' * 1_000] * 1_000, steps=30)
    assert 70 < house.confirmed() < 100_000 / 1_400 + 500
    assert house.positions() == {0: 0}
    house.letters.answering = True
    house.steps(30)
    assert house.positions() == {0: 1_001}
    assert not house.pipeline._flight.size_bytes


@pytest.mark.parametrize('most', [5, 500], ids=['messages', 'bytes'])
def test_drop_oldest_keeps_the_newest_of_large_records_whichever_limit_is_reached_first(
    most: int, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(when_full='drop_oldest', max_in_flight=most, max_in_flight_bytes=5 * ONE_BYTES)
    house.sink.acknowledging, house.sink.room = False, most
    house.take(*large(*range(12)), steps=1)
    assert published(house) == [*range(5)], 'no more than the window holds'
    for number in range(12, 40):
        house.take(*large(number), first=number, steps=2)
    assert not house.source.waiting, 'it reads on'
    assert house.pipeline._flight.size_bytes <= 2 * 5 * ONE_BYTES
    house.sink.acknowledging = True
    house.steps()
    assert published(house) == [*range(5), *range(35, 40)]
    assert house.pipeline.counters.snapshot(0).dropped == 30
    assert house.positions() == {0: 40}
    assert 'drop: 1 that waited, to keep newer ones (when_full)' in caplog.text


def test_behind_a_full_window_no_more_than_a_piece_is_read_at_once() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=5 * ONE_BYTES)
    house.sink.acknowledging = False
    house.give(*large(*range(500)))
    house.steps(1)
    assert len(house.source.waiting) == 500 - PIECE
    house.steps(1)
    assert len(house.source.waiting) == 500 - 2 * PIECE


@pytest.mark.parametrize('room', [5, 500], ids=['history', 'window'])
def test_drop_oldest_drops_nothing_while_readers_keep_up(room: int, clock: Clock) -> None:
    house = House(when_full='drop_oldest', max_in_flight=5, max_in_flight_bytes=5 * ONE_BYTES)
    house.sink.acknowledging, house.sink.room = False, room
    house.give(*large(*range(100)))
    for got in range(5, 100, 5):
        clock.now_s += 0.15
        house.steps(2)
        house.sink.acknowledge(got)
    house.steps(2)
    assert published(house) == [*range(100)]
    assert house.pipeline.counters.snapshot(0).dropped == 0


@pytest.mark.parametrize('room', [5, 500], ids=['history', 'window'])
def test_drop_oldest_keeps_the_newest_for_a_reader_that_takes_slowly_but_steadily(
    room: int, clock: Clock
) -> None:
    house = House(when_full='drop_oldest', max_in_flight=5, max_in_flight_bytes=5 * ONE_BYTES)
    house.sink.acknowledging, house.sink.room = False, room
    for turn in range(100):
        clock.now_s += 0.15
        house.take(*large(*range(turn * 5, turn * 5 + 5)), first=turn * 5, steps=2)
        house.sink.acknowledge(1)
    assert not house.source.waiting
    assert published(house)[-1] >= 500 - 4 * 5
    assert house.pipeline.counters.snapshot(0).dropped > 300


def test_drop_oldest_reads_nothing_for_dead_letters_that_fill_the_window() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=5 * ONE_BYTES)
    house.letters.answering = False
    for number in range(40):
        house.take(b'bad' + b'x' * 997, first=number, steps=1)
    assert len(house.source.waiting) == 40 - 6
    house.letters.answering = True
    house.steps(40)
    assert len(house.letters.records) == 40


def test_drop_oldest_drops_nothing_for_a_record_that_ends_the_route() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2, on_error='stop')
    house.sink.acknowledging, house.sink.room = False, 1
    house.take(b'a', b'b', b'bad', steps=1)
    house.take(b'c', b'd', first=3)
    assert len(house.source.waiting) == 2
    assert house.pipeline.counters.snapshot(0).dropped == 0
    house.sink.acknowledging = True
    with pytest.raises(RouteError, match='@2'):
        house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b']


def test_the_window_is_bounded_in_bytes() -> None:
    house = House(MemoryMessageSink(acknowledging=False), max_in_flight_bytes=1000)
    for number in range(5):
        house.take(b'x' * 900, first=number, steps=2)
    assert len(house.sink.published) == 1
    assert len(house.source.waiting) == 4


def test_what_is_in_flight_to_ros_is_bounded_by_bytes_and_a_piece() -> None:
    house = House(max_in_flight=2, max_in_flight_bytes=401_000)  # 1000 of one byte
    house.sink.room = 10_000  # most of it acknowledged, and too young to be confirmed
    house.sink.acknowledging = False
    house.take(*[b'a'] * 5000, steps=20)
    house.pipeline._take_snapshot(None)
    assert house.pipeline.snapshot.in_flight == 1000 + PIECE


def test_where_the_oldest_are_dropped_as_many_wait_as_are_not_acknowledged() -> None:
    house = House(when_full='drop_oldest', max_in_flight=600)
    house.sink.room = 600
    house.sink.acknowledging = False
    house.take(*[b'a'] * 5000, steps=20)
    house.pipeline._take_snapshot(None)
    assert house.pipeline.snapshot.in_flight == 1200
    assert house.pipeline._flight.size_bytes == 1200 * 401
    assert house.positions() == {0: 0}
    house.sink.acknowledge(599)
    house.pipeline._confirm()
    assert house.positions() == {0: 599}
    house.sink.acknowledging = True
    house.steps(3)
    assert house.positions() == {0: 5000}
    assert len(house.sink.published) == 1200
    assert house.pipeline.counters.snapshot(0).dropped == 3800


def test_what_is_dropped_takes_no_room_from_the_newest() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2, max_in_flight_bytes=2000)
    house.sink.room = 2
    house.sink.acknowledging = False
    house.take(*[b'%d' % number for number in range(2000)], steps=60)
    house.sink.acknowledging = True
    house.steps(3)
    assert house.sink.published == [b'cdr:0', b'cdr:1', b'cdr:1998', b'cdr:1999']


def test_the_newest_waits_also_where_what_is_published_fills_the_window_alone() -> None:
    house = House(when_full='drop_oldest', max_in_flight=5, max_in_flight_bytes=5000)
    house.sink.room = 5
    house.sink.acknowledging = False
    house.take(*[b'%03d' % number + b'x' * 997 for number in range(20)], steps=5)
    house.sink.acknowledging, house.sink.room = True, 100
    house.steps(5)
    assert house.sink.published[-1].startswith(b'cdr:019')


def test_what_is_dropped_moves_on_its_own_partition_only() -> None:
    house = House(when_full='drop_oldest', max_in_flight=1)
    house.sink.room = 1
    house.sink.acknowledging = False
    house.give(b'a', b'b', first=7)
    house.take(b'c', b'd', b'e', partition=1, first=3)
    assert house.positions() == {0: 7, 1: 5}
    house.sink.acknowledging = True
    house.steps(2)
    assert house.positions() == {0: 9, 1: 6}


@settings(max_examples=300)
@given(
    strategies.lists(
        strategies.sampled_from(['good', 'good', 'bad', 'mine', 'acknowledge', 'lose', 'look']),
        max_size=60,
    ),
    strategies.randoms(use_true_random=False),
)
def test_what_is_dropped_in_between_moves_no_position_past_what_has_not_ended(
    events: list[str], random: Random
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(readiness, 'SETTLE_S', 0.0)
        patch.setattr(time, 'sleep', lambda _: None)
        house = House(when_full='drop_oldest', max_in_flight=1, skip_own=True)
        house.sink.room = 1
        house.sink.acknowledging = house.letters.answering = False
        flight, given = house.pipeline._flight, Counter[int]()
        for event in events:
            partition = random.choice([0, 0, 1])
            value = b'bad' if event == 'bad' else b'x'
            headers = MINE if event == 'mine' else None
            if event in {'good', 'bad', 'mine'}:
                first = given[partition]
                house.give(value, first=first, partition=partition, header_list=headers)
                given[partition] += 1
            elif event == 'acknowledge':
                house.sink.acknowledge(1)
            elif event == 'lose':
                house.sink.lose_reader()
            house.steps(random.choice([0, 1, 2]))
            assert all(e.offset >= house.source.positions[e.partition] for e in flight)
        house.sink.acknowledging = house.letters.answering = True
        house.steps(len(events) + 3)
        assert house.positions() == dict(given)
        assert not flight.size_bytes


def test_a_message_that_is_larger_than_its_value_counts_with_its_own_size() -> None:
    house = House(MemoryMessageSink(acknowledging=False), max_in_flight_bytes=100_000)
    house.pipeline._decode = lambda value: (value or b'') * 50_000
    for first in range(4):
        house.take(b'x', first=first, steps=1)
    assert len(house.source.waiting) == 1
    assert house.pipeline._flight.size_bytes == 3 * 50_000


class Broken(MemoryMessageSink):
    """A sink of which ROS takes a message, and then fails."""

    failing = b''

    def publish(self, messages: Iterable[bytes]) -> int:
        return super().publish(takewhile(lambda cdr: cdr != self.failing, messages))

    def raise_failure(self) -> None:
        if self.failing:
            raise RouteError('publisher is invalid')


def test_drop_oldest_drops_nothing_for_a_publisher_that_has_failed() -> None:
    sink = Broken(room=0)
    house = House(sink, when_full='drop_oldest', max_in_flight=3)
    house.take(b'a', b'b', b'c', steps=1)
    sink.room, sink.failing = 100, b'cdr:c'
    house.give(*[b'%d' % number for number in range(20)], first=3)
    with pytest.raises(RouteError, match='publisher is invalid'):
        house.steps(1)
    assert sink.published == [b'cdr:a', b'cdr:b']
    assert house.pipeline.counters.snapshot(0).dropped == 0
    sink.failing = b''
    house.steps()
    assert sink.published[:3] == [b'cdr:a', b'cdr:b', b'cdr:c']
