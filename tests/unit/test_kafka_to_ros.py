"""The direction Kafka -> ROS, driven step by step with ends in memory."""

import logging
import re
import time
import traceback
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from random import Random
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings, strategies

from ros2_kafka_bridge import kafka_to_ros
from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.dead_letters.writer import DeadLetters
from ros2_kafka_bridge.endpoints import Record
from ros2_kafka_bridge.errors import DecodeError, RouteError
from ros2_kafka_bridge.formats import guarded
from ros2_kafka_bridge.kafka_to_ros import BATCH, KafkaToRos
from ros2_kafka_bridge.route import obstacle, settling
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.route.type_hash import make_hash_check
from ros2_kafka_bridge.testing.memory import (
    MemoryMessageSink,
    MemoryRecord,
    MemoryRecordSink,
    MemoryRecordSource,
)
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.route.record_window import RecordEntry

HASH = 'RIHS01_' + '1' * 64
LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


BUGS: dict[bytes, tuple[type[BaseException], str]] = {
    b'bug of the bridge': (AttributeError, "'NoneType' object has no attribute 'get'"),
    b'bug that asserts': (AssertionError, ''),
    b'bug that takes all memory': (MemoryError, ''),
    b'bug without end': (RecursionError, 'maximum recursion depth exceeded'),
    b'bug, said the user': (KeyboardInterrupt, ''),
}


def decode(value: bytes | None) -> bytes:
    if value is None or value.startswith(b'bad'):
        raise DecodeError('not what it should be')
    if value.startswith(b'bug'):
        kind, text = BUGS[value]
        raise kind(text)
    if value.startswith(b'away'):
        raise RouteError('the Schema Registry does not answer')
    return b'cdr:' + value


class House:
    """A direction with its ends."""

    def __init__(self, **settings: Any) -> None:
        self.source = MemoryRecordSource()
        self.sink = MemoryMessageSink()
        self.letters: MemoryRecordSink[Any] = MemoryRecordSink()
        route = KafkaToRosRoute.model_validate(
            {
                'name': 'orders',
                'from': {'kafka': 'orders'},
                'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
                'format': 'text',
                **settings,
            }
        )
        dead: DeadLetters[RecordEntry] = DeadLetters(
            'orders.dead', self.letters, lambda: None, LOG
        )
        self.direction = KafkaToRos(
            route,
            'me',
            self.source,
            self.sink,
            make_hash_check('std_msgs/msg/String', HASH),
            guarded(decode, route.max_message_bytes, DecodeError),
            dead,
            LOG,
        )
        self.pause = self.direction._pause
        self.source.open(self.direction)

    def give(self, *values: bytes | None, partition: int = 0, first: int = 0, **more: Any) -> None:
        for number, value in enumerate(values):
            self.source.waiting.append(MemoryRecord(value, first + number, partition, **more))

    def steps(self, count: int = 6) -> None:
        for _ in range(count):
            self.direction._step()
            self.check_balance()

    def rests(self, count: int = 3) -> None:
        for _ in range(count):
            self.direction._rest()
            self.check_balance()

    def check_balance(self) -> None:
        snapshot = self.direction.counters.snapshot(len(self.direction._window))
        assert snapshot.balanced, snapshot

    def positions(self) -> dict[int, int]:
        self.direction._settle()
        return self.source.positions

    def confirmed(self) -> int:
        return self.direction.counters.snapshot(0).confirmed


@pytest.fixture(autouse=True)
def _no_settle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settling, 'SETTLE_S', 0.0)


@pytest.mark.parametrize('how', ['revoke', 'lose'])
def test_guarantee_1_a_hand_over_ends_also_where_the_readers_cannot_be_asked(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b')
    house.steps()

    def fail() -> None:
        raise RouteError('publisher of /orders: no')

    monkeypatch.setattr(house.sink, 'readers', fail)
    getattr(house.source, how)(frozenset({0}))
    house.check_balance()
    assert house.direction.counters.snapshot(0).returned == 2
    assert house.positions() == {}
    with pytest.raises(RouteError, match='publisher of /orders: no'):
        house.steps()


def test_a_position_moves_on_only_when_its_message_is_confirmed() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b', b'c')
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']
    assert house.positions() == {0: 0}
    house.sink.acknowledge(2)
    house.steps(1)
    assert house.positions() == {0: 2}
    assert house.confirmed() == 2


def test_offsets_with_gaps_move_on_in_order_of_consumption() -> None:
    house = House()
    house.give(b'a', first=5)
    house.give(b'b', first=1000)
    house.steps()
    assert house.positions() == {0: 1001}


def test_a_full_history_waits_and_the_same_message_goes_next() -> None:
    house = House()
    house.sink.acknowledging = False
    house.sink.room = 2
    house.give(b'a', b'b', b'c')
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    house.sink.acknowledge(1)
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']


@pytest.mark.parametrize(
    ('holders', 'who'),
    [
        (['/picker'], '/picker, '),
        (['/a', '/b'], 'one of /a, /b, '),
        (['/a', '/b', '/c', '/d', '/e'], 'one of /a, /b, /c and 2 more, '),
        ([], ''),
    ],
)
def test_a_route_that_is_held_says_by_whom_and_since_when(
    holders: list[str], who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(obstacle, 'SAID_AFTER_S', 0.0)
    house = House()
    house.sink.acknowledging, house.sink.room, house.sink.holders = False, 1, holders
    house.give(b'a', b'b')
    house.steps(2)
    house.direction._blocked._since_s = time.monotonic() - 3600
    before = datetime.now().astimezone() - timedelta(seconds=3600)
    house.direction._telling._at_s = 0.0
    house.steps(1)
    reason = house.direction.snapshot.reason
    said = re.fullmatch(
        r'the history is full: a subscriber does not take \((.*)since (\d\d:\d\d:\d\d)\)', reason
    )
    assert said, reason
    assert said[1] == who
    times = {f'{before + timedelta(seconds=late_s):%H:%M:%S}' for late_s in range(30)}
    assert said[2] in times


def test_nothing_is_read_while_a_message_waits() -> None:
    house = House()
    house.sink.acknowledging = False
    house.sink.room = 1
    house.give(b'a', b'b')
    house.steps()
    house.give(b'c', first=2)
    house.steps()
    assert len(house.source.waiting) == 1


def test_a_bad_record_becomes_a_dead_letter_and_those_behind_it_wait_for_its_confirmation() -> (
    None
):
    house = House()
    house.letters.answering = False
    house.give(b'a', b'bad', b'c')
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:c']
    assert house.positions() == {0: 1}
    house.letters.answering = True
    house.steps()
    assert house.positions() == {0: 3}
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert (letter.topic, letter.value) == ('orders.dead', b'bad')
    assert told['dead_letter.error'] == 'DecodeError: not what it should be'
    assert (told['dead_letter.topic'], told['dead_letter.partition']) == ('orders', '0')
    assert (told['dead_letter.route'], told['dead_letter.offset']) == ('orders', '1')


BROKEN = [
    (b'bug of the bridge', "AttributeError: 'NoneType' object has no attribute 'get'"),
    (b'bug that asserts', 'AssertionError'),
    (b'bug that takes all memory', 'MemoryError'),
    (b'bug without end', 'RecursionError: maximum recursion depth exceeded'),
]


@pytest.mark.parametrize(('value', 'what'), BROKEN)
def test_a_record_that_meets_a_bug_of_the_decoder_becomes_a_dead_letter(
    value: bytes, what: str
) -> None:
    house = House()
    house.give(b'a', value, b'c')
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:c']
    assert house.positions() == {0: 3}
    [letter] = house.letters.records
    assert letter.value == value
    assert dict(letter.headers)['dead_letter.error'] == (
        f"DecodeError: the bridge's own decoder failed: {what}: a bug of the bridge, report it "
        'with the traceback of its log'
    )


@pytest.mark.parametrize('on_error', ['dead_letter', 'drop', 'stop'])
def test_a_bug_of_the_decoder_is_told_with_its_traceback_whatever_the_route_does_about_it(
    caplog: pytest.LogCaptureFixture, on_error: str
) -> None:
    house = House(on_error=on_error)
    house.give(b'bug of the bridge')
    with suppress(RouteError):
        house.steps()
    [line] = [one for one in caplog.records if one.levelname == 'ERROR']
    assert line.getMessage().startswith("orders[0]@0: the bridge's own decoder failed: Attribut")
    assert line.exc_info is not None
    (told,) = traceback.extract_tb(line.exc_info[2])[-1:]
    assert (told.name, told.line) == ('decode', 'raise kind(text)')


def test_a_bug_of_the_decoder_drops_no_record() -> None:
    house = House(on_error='drop')
    house.give(b'bad', b'bug of the bridge')
    house.steps()
    assert [letter.value for letter in house.letters.records] == [b'bug of the bridge']
    assert house.direction.counters.snapshot(0).dropped == 1


def test_many_bugs_of_the_decoder_flood_no_log(caplog: pytest.LogCaptureFixture) -> None:
    house = House()
    house.give(*[b'bug of the bridge'] * 200)
    house.steps()
    assert len(house.letters.records) == 200
    assert len([one for one in caplog.records if one.exc_info]) == 5
    house.direction._occasional.close()
    last = [one for one in caplog.records if one.exc_info][-1]
    assert last.getMessage().endswith(' (195 times more)')


def test_a_user_who_ends_the_bridge_while_it_decodes_is_no_bug_of_it() -> None:
    house = House()
    house.give(b'bug, said the user')
    with pytest.raises(KeyboardInterrupt):
        house.steps()


def test_the_client_of_the_dead_letters_is_polled_also_while_there_are_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    house.give(b'bad')
    house.steps()
    assert house.positions() == {0: 1}
    polled: list[float] = []
    monkeypatch.setattr(house.letters, 'poll', polled.append)
    house.steps()
    assert polled


def test_what_was_confirmed_of_a_partition_that_is_lost_is_told_before_it_goes() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b', b'c')
    house.give(b'd', partition=1)
    house.steps()
    house.sink.acknowledge(2)
    house.direction.lost(frozenset({0}))
    assert house.source.positions == {0: 2, 1: 0}
    house.check_balance()


def test_a_dead_letter_too_large_goes_without_its_value() -> None:
    house = House()
    house.letters.limit_bytes = 5
    house.give(b'bad and long', key_bytes=b'k', header_list=[('mine', b'1')])
    house.steps()
    [letter] = house.letters.records
    assert letter.value is None
    assert letter.key == b'k'
    assert dict(letter.headers)['mine'] == b'1'
    assert dict(letter.headers)['dead_letter.value_bytes'] == '12'


def test_a_dead_letter_topic_that_refuses_stops_the_reading_and_nothing_is_lost() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('no permission')]
    house.give(b'a', b'bad', b'c')
    house.steps()
    house.give(b'd', first=3)
    house.steps(2)
    house.direction._show('')
    assert house.direction.snapshot.state == State.FAILED
    assert 'no permission' in house.direction.snapshot.reason
    assert len(house.source.waiting) == 1
    house.direction._dead_letters._again_at_s = 0.0
    house.steps()
    assert [letter.value for letter in house.letters.records] == [b'bad']
    assert house.sink.published == [b'cdr:a', b'cdr:c', b'cdr:d']
    assert house.positions() == {0: 4}


def test_on_error_drop_counts_and_goes_on() -> None:
    house = House(on_error='drop')
    house.give(b'bad', b'b')
    house.steps()
    assert house.direction.counters.snapshot(0).dropped == 1
    assert house.positions() == {0: 2}


@pytest.mark.parametrize(
    ('settings', 'value'), [({}, b'away'), ({'on_error': 'stop'}, b'bad')], ids=['away', 'stop']
)
@pytest.mark.parametrize('other', [0, 1])
def test_a_route_goes_on_where_what_was_to_end_it_is_handed_over(
    settings: dict[str, Any], value: bytes, other: int
) -> None:
    """Whoever reads that partition next finds out by itself."""
    house = House(**settings)
    house.sink.acknowledging = False
    house.give(b'a', partition=other)
    house.give(value, first=1)
    house.steps(2)
    house.source.lose(frozenset({0}))
    house.sink.acknowledging = True
    house.give(b'c', b'd')
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:c', b'cdr:d']
    assert house.positions()[0] == 2


def test_on_error_stop_ends_the_route_before_the_bad_record() -> None:
    house = House(on_error='stop')
    house.give(b'a')
    house.steps()
    house.give(b'bad', first=1)
    with pytest.raises(RouteError, match=r'orders\[0\]@1: not what it should be') as raised:
        house.steps()
    assert raised.value.final
    assert house.positions() == {0: 1}


def test_records_of_this_bridge_are_skipped_and_counted() -> None:
    house = House()
    house.give(b'mine', header_list=[('bridge.origin', b'me')])
    house.give(b'other', first=1, header_list=[('bridge.origin', b'you')])
    house.steps()
    assert house.sink.published == [b'cdr:other']
    assert house.direction.counters.snapshot(0).skipped == 1


def test_when_a_reader_goes_the_unconfirmed_are_published_again_in_order() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b', b'c')
    house.steps()
    house.sink.acknowledge(1)
    house.steps(1)
    house.sink.lose_reader()
    house.steps()
    assert house.sink.published[3:] == [b'cdr:b', b'cdr:c']
    assert house.positions() == {0: 1}
    assert house.direction.counters.repeated == 2
    house.sink.acknowledging = True
    house.steps()
    assert house.positions() == {0: 3}


def test_revoked_partitions_are_committed_and_the_rest_is_given_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kafka_to_ros, 'REVOKE_S', 0.05)
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b', partition=0)
    house.give(b'x', b'y', partition=1)
    house.steps()
    house.sink.acknowledge(3)
    house.source.revoke(frozenset({1}))
    assert house.source.committed == {0: 2, 1: 1}
    assert house.positions() == {0: 2}
    assert house.direction.counters.snapshot(0).returned == 1
    house.check_balance()
    house.sink.acknowledging = True
    house.give(b'c', partition=0, first=2)
    house.steps()
    assert house.positions() == {0: 3}


def test_lost_partitions_are_not_committed() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a')
    house.steps()
    house.source.lose(frozenset({0}))
    assert house.positions() == {}
    assert house.direction.counters.snapshot(0).returned == 1


def test_without_enough_subscribers_nothing_is_published() -> None:
    house = House(min_subscribers=2)
    house.give(b'a')
    house.steps()
    assert house.sink.published == []
    house.sink.matched = 2
    house.steps()
    assert house.sink.published == [b'cdr:a']


def test_min_subscribers_0_publishes_to_nobody() -> None:
    house = House(min_subscribers=0)
    house.sink.matched = 0
    house.give(b'a')
    house.steps()
    assert house.sink.published == [b'cdr:a']


def test_old_records_are_dropped_and_counted_where_the_route_says_so() -> None:
    house = House(max_age_s=60)
    now_ms = int(time.time() * 1000)
    house.give(b'old', time_ms=now_ms - 61_000)
    house.give(b'new', first=1, time_ms=now_ms)
    house.give(b'no time', first=2)
    house.steps()
    assert house.sink.published == [b'cdr:new', b'cdr:no time']
    assert house.direction.counters.snapshot(0).dropped == 1
    assert house.positions() == {0: 3}


def test_a_value_above_max_message_bytes_is_a_dead_letter_that_names_both_sizes() -> None:
    house = House(max_message_bytes=3)
    house.give(b'four', b'abc')
    house.steps()
    assert house.sink.published == [b'cdr:abc']
    [letter] = house.letters.records
    reason = dict(letter.headers)['dead_letter.error']
    assert reason == (
        'RecordTooLargeError: 4 bytes, more than max_message_bytes of the route (3 bytes)'
    )


def test_drop_oldest_keeps_the_newest_and_counts_the_rest() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2)
    house.sink.room = 0
    house.give(b'a', b'b', b'c', b'd', b'e')
    house.steps()
    house.sink.room = 10
    house.steps()
    assert house.sink.published == [b'cdr:d', b'cdr:e']
    assert house.direction.counters.snapshot(0).dropped == 3
    assert house.positions() == {0: 5}


def test_what_drop_oldest_drops_behind_an_unconfirmed_head_takes_no_memory() -> None:
    house = House(when_full='drop_oldest', max_in_flight=10, max_in_flight_bytes=50_000)
    house.sink.acknowledging, house.sink.room = False, 10
    window = house.direction._window
    for first in range(0, 5000, 50):
        house.give(*[b'%05d' % n + b'x' * 995 for n in range(first, first + 50)], first=first)
        house.steps(1)
    assert len(window) <= 3 * 10 + 50
    assert window.size_bytes <= 50_000 + 50 * 1_400
    assert house.source.waiting == deque()
    house.sink.acknowledging, house.sink.room = True, 100
    house.steps()
    assert house.sink.published[-1].startswith(b'cdr:04999')
    assert len(house.sink.published) == 20
    assert house.direction.counters.snapshot(0).dropped == 4980
    assert house.positions() == {0: 5000}


def test_drop_oldest_reads_nothing_while_it_could_drop_only_what_it_reads() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=1000)
    house.sink.acknowledging = False
    house.give(b'x' * 900)
    house.steps(2)
    house.give(b'newer', first=1)
    house.steps()
    assert len(house.source.waiting) == 1
    assert house.direction.counters.snapshot(0).dropped == 0
    house.sink.acknowledging = True
    house.steps()
    assert house.sink.published[-1] == b'cdr:newer'


def test_drop_oldest_drops_nothing_for_a_record_that_ends_the_route() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2, on_error='stop')
    house.sink.acknowledging, house.sink.room = False, 1
    house.give(b'a', b'b', b'bad')
    house.steps(1)
    house.give(b'c', b'd', first=3)
    house.steps()
    assert len(house.source.waiting) == 2
    assert house.direction.counters.snapshot(0).dropped == 0
    house.sink.acknowledging = True
    with pytest.raises(RouteError, match='@2'):
        house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b']


def test_the_window_is_bounded_in_bytes() -> None:
    house = House(max_in_flight_bytes=1000)
    house.sink.acknowledging = False
    for number in range(5):
        house.give(b'x' * 900, first=number)
        house.steps(2)
    assert len(house.sink.published) == 1
    assert len(house.source.waiting) == 4


def test_what_is_in_flight_to_ros_is_bounded_by_bytes_and_a_batch() -> None:
    house = House(max_in_flight=2, max_in_flight_bytes=401_000)  # 1000 of one byte
    house.sink.room = 10_000  # most of it acknowledged, and too young to be confirmed
    house.sink.acknowledging = False
    house.give(*[b'a'] * 5000)
    house.steps(20)
    house.direction._take_snapshot(None)
    assert house.direction.snapshot.in_flight == 1000 + BATCH


def test_where_the_oldest_are_dropped_as_many_wait_as_are_not_acknowledged() -> None:
    house = House(when_full='drop_oldest', max_in_flight=600)
    house.sink.room = 600
    house.sink.acknowledging = False
    house.give(*[b'a'] * 5000)
    house.steps(20)
    house.direction._take_snapshot(None)
    assert house.direction.snapshot.in_flight == 1200
    assert house.direction._window.size_bytes == 1200 * 401
    assert house.positions() == {0: 0}
    house.sink.acknowledge(599)
    house.direction._confirm()
    assert house.positions() == {0: 599}
    house.sink.acknowledging = True
    house.steps(3)
    assert house.positions() == {0: 5000}
    assert len(house.sink.published) == 1200
    assert house.direction.counters.snapshot(0).dropped == 3800


def test_what_is_dropped_takes_no_room_from_the_newest() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2, max_in_flight_bytes=2000)
    house.sink.room = 2
    house.sink.acknowledging = False
    house.give(*[b'%d' % number for number in range(2000)])
    house.steps(8)
    house.sink.acknowledging = True
    house.steps(3)
    assert house.sink.published == [b'cdr:0', b'cdr:1', b'cdr:1998', b'cdr:1999']


def test_the_newest_waits_also_where_what_is_published_fills_the_window_alone() -> None:
    house = House(when_full='drop_oldest', max_in_flight=5, max_in_flight_bytes=5000)
    house.sink.room = 5
    house.sink.acknowledging = False
    house.give(*[b'%03d' % number + b'x' * 997 for number in range(20)])
    house.steps(5)
    house.sink.acknowledging, house.sink.room = True, 100
    house.steps(5)
    assert house.sink.published[-1].startswith(b'cdr:019')


def test_what_is_dropped_moves_on_its_own_partition_only() -> None:
    house = House(when_full='drop_oldest', max_in_flight=1)
    house.sink.room = 1
    house.sink.acknowledging = False
    house.give(b'a', b'b', first=7)
    house.give(b'c', b'd', b'e', partition=1, first=3)
    house.steps()
    assert house.positions() == {0: 7, 1: 5}
    house.sink.acknowledging = True
    house.steps(2)
    assert house.positions() == {0: 9, 1: 6}


def test_a_drain_confirms_what_is_in_flight_and_gives_back_what_was_not_published() -> None:
    house = House(drain_s=1)
    house.sink.acknowledging = False
    house.sink.room = 2
    house.give(b'a', b'b', b'c')
    house.steps()
    house.sink.acknowledging = True
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert house.source.committed == {0: 2}
    snapshot = house.direction.snapshot
    assert snapshot.balanced
    assert (snapshot.confirmed, snapshot.returned, snapshot.in_flight) == (2, 1, 0)


def test_a_drain_skips_nothing_that_it_has_given_back_behind_an_end_that_was_reached() -> None:
    house = House(drain_s=1)
    house.sink.acknowledging = False
    house.sink.room = 1
    house.give(b'a', b'b', b'c')
    house.give(b'x', partition=1)
    house.source.ends |= {0: 3, 1: 2}  # a mark of a transaction comes behind the last one
    house.steps()
    house.sink.acknowledging = True
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert house.sink.published == [b'cdr:a']
    assert house.source.committed.get(0) == 1
    assert house.source.committed.get(1, 0) == 0


def test_a_long_drain_stays_in_the_group_and_commits_as_it_goes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(drain_s=0.6)
    house.sink.acknowledging = False
    house.give(b'a', b'b')
    house.steps()
    holds: list[float] = []
    before_the_end: list[dict[int, int]] = []

    def stay() -> tuple[()]:
        holds.append(time.monotonic())
        house.sink.acknowledge(1 if len(holds) == 1 else 0)
        return ()

    def commit_now(timeout_s: float) -> bool:
        before_the_end.append(dict(house.source.committed))
        return MemoryRecordSource.commit_now(house.source, timeout_s)

    monkeypatch.setattr(house.source, 'stay', stay)
    monkeypatch.setattr(house.source, 'commit_now', commit_now)
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert before_the_end[0] == {0: 1}
    assert len(holds) > 2
    assert holds[-1] - holds[0] > 0.3


def test_guarantee_7_a_drain_waits_for_what_is_in_flight_also_where_kafka_fails_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(drain_s=5)
    house.sink.acknowledging = False
    house.give(b'a', b'b')
    house.steps()

    def stay() -> tuple[()]:
        house.sink.acknowledging = True  # a moment later
        raise RouteError('topic orders: shut out')

    monkeypatch.setattr(house.source, 'stay', stay)
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert house.confirmed() == 2
    assert house.source.committed == {0: 2}
    assert 'topic orders: shut out' in caplog.messages


def test_what_still_comes_in_a_drain_is_given_back_unseen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(drain_s=5)
    house.sink.acknowledging = False
    house.give(b'a')
    house.steps()
    late = [[MemoryRecord(b'bad', 1)], [MemoryRecord(b'x', 0, 1), MemoryRecord(b'away', 2)]]

    def stay() -> Sequence[Record]:
        house.source.ends |= {0: 3, 1: 1}
        house.sink.acknowledging = not late
        house.source.waiting.extend(late.pop(0) if late else [])
        return house.source.hand_out(500)

    monkeypatch.setattr(house.source, 'stay', stay)
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert late == []
    assert house.sink.published == [b'cdr:a']
    assert house.letters.records == []
    assert house.source.committed == {0: 1, 1: 0}
    snapshot = house.direction.snapshot
    assert snapshot.balanced
    assert (snapshot.taken, snapshot.confirmed, snapshot.returned) == (4, 1, 3)


def test_after_a_failure_the_same_records_come_again_and_the_count_still_balances() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b')
    house.steps()
    with pytest.raises(RouteError), house.direction._opened():
        raise RouteError('no permission')
    house.check_balance()
    house.sink.acknowledging = True
    house.source.open(house.direction)
    house.give(b'a', b'b')
    house.steps()
    assert house.positions() == {0: 2}
    assert house.confirmed() == 2


@pytest.mark.parametrize('between', ['dead letter', 'skipped', 'too old'])
def test_a_drain_commits_nothing_behind_a_record_that_was_not_published(between: str) -> None:
    house = House(drain_s=0.1, max_age_s=60)
    house.sink.matched = 0
    house.give(b'a', b'b')
    if between == 'dead letter':
        house.give(b'bad', first=2)
    elif between == 'skipped':
        house.give(b'mine', first=2, header_list=[('bridge.origin', b'me')])
    else:
        house.give(b'old', first=2, time_ms=1)
    house.give(b'c', first=3)
    house.steps()
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert house.source.committed.get(0, 0) == 0
    assert house.direction.snapshot.balanced


def test_letters_that_arrived_count_though_another_of_the_same_report_failed() -> None:
    house = House()
    house.letters.errors[b'bad2'] = [RouteError('no permission')]
    house.give(b'bad1', b'bad2', b'bad3')
    house.steps()
    house.direction._dead_letters._again_at_s = 0.0
    house.steps()
    assert sorted(letter.value or b'' for letter in house.letters.records) == [
        b'bad1', b'bad2', b'bad3',
    ]  # fmt: skip
    assert house.positions() == {0: 3}


def test_the_first_record_does_not_wait_for_readers_that_have_long_been_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settling, 'SETTLE_S', 0.05)
    house = House()
    house.sink.acknowledging = False
    house.steps(1)
    time.sleep(0.06)
    house.give(b'a')
    house.steps(1)
    assert house.sink.published == [b'cdr:a']
    house.sink.matched = 2
    house.steps(1)
    time.sleep(0.06)
    house.sink.lose_reader()
    house.sink.matched = 1
    house.steps(1)
    assert house.sink.published == [b'cdr:a', b'cdr:a']


def test_readers_that_come_while_a_route_is_paused_need_not_be_waited_for_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settling, 'SETTLE_S', 0.05)
    house = House()
    house.give(b'a')
    house.rests(1)
    time.sleep(0.06)
    house.steps(1)
    assert house.sink.published == [b'cdr:a']


def test_a_reader_that_took_the_place_of_another_gets_time_to_know_of_the_match(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a')
    house.steps()
    monkeypatch.setattr(settling, 'SETTLE_S', 60.0)
    house.sink.lose_reader()
    house.steps()
    assert house.sink.published == [b'cdr:a']
    monkeypatch.setattr(settling, 'SETTLE_S', 0.0)
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:a']


EVENTS = strategies.lists(
    strategies.sampled_from(
        ['good', 'bad', 'mine', 'old', 'step', 'acknowledge', 'lose', 'leave', 'come', 'letters']
    ),
    max_size=60,
)


@settings(max_examples=300)
@given(EVENTS)
def test_guarantee_1_no_offset_is_committed_before_all_up_to_it_have_ended(
    events: list[str],
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settling, 'SETTLE_S', 0.0)
        patch.setattr(time, 'sleep', lambda _: None)
        house = House(drain_s=0.005, max_age_s=60)
        house.sink.matched = 0
        house.sink.acknowledging = house.letters.answering = False
        good: dict[int, bytes] = {}
        for event in events:
            offset = len(house.source.waiting) + house.direction.counters.taken
            if event == 'good':
                good[offset] = b'cdr:%d' % offset
                house.give(b'%d' % offset, first=offset)
            elif event == 'bad':
                house.give(b'bad %d' % offset, first=offset)
            elif event == 'mine':
                house.give(b'm', first=offset, header_list=[('bridge.origin', b'me')])
            elif event == 'old':
                house.give(b'o', first=offset, time_ms=1)
            elif event == 'step':
                house.steps(1)
            elif event == 'acknowledge':
                house.sink.acknowledge(2)
            elif event == 'lose':
                house.sink.lose_reader()
            elif event in {'leave', 'come'}:
                house.sink.matched = int(event == 'come')
            else:
                house.letters.answering = True
        house.check_balance()
        stop = Stop()
        stop.ask()
        house.direction.run(stop)
        committed = house.source.committed.get(0, 0)
        assert {b for o, b in good.items() if o < committed} <= set(house.sink.published)
        assert house.direction.snapshot.balanced
        confirmed = house.direction.snapshot.confirmed
        assert sum(o < committed for o in good) <= confirmed


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
        patch.setattr(settling, 'SETTLE_S', 0.0)
        patch.setattr(time, 'sleep', lambda _: None)
        house = House(when_full='drop_oldest', max_in_flight=1)
        house.sink.room = 1
        house.sink.acknowledging = house.letters.answering = False
        window, given = house.direction._window, Counter[int]()
        for event in events:
            partition = random.choice([0, 0, 1])
            value = b'bad' if event == 'bad' else b'x'
            headers = [('bridge.origin', b'me')] if event == 'mine' else None
            if event in {'good', 'bad', 'mine'}:
                first = given[partition]
                house.give(value, first=first, partition=partition, header_list=headers)
                given[partition] += 1
            elif event == 'acknowledge':
                house.sink.acknowledge(1)
            elif event == 'lose':
                house.sink.lose_reader()
            house.steps(random.choice([0, 1, 2]))
            assert all(e.offset >= house.source.positions[e.partition] for e in window.entries)
        house.sink.acknowledging = house.letters.answering = True
        house.steps(len(events) + 3)
        assert house.positions() == dict(given)
        assert not window.size_bytes


def test_who_is_asked_by_the_format_and_is_away_costs_nothing() -> None:
    """What comes before the record is confirmed, it and what comes behind it are read again."""
    house = House()
    house.give(b'a', b'bad', b'b')
    house.give(b'away', b'c', first=3)
    house.give(b'd', partition=1)
    with pytest.raises(RouteError, match='does not answer') as caught:
        house.steps()
    assert not caught.value.final
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert house.positions() == {0: 3, 1: 0}
    house.direction._give_back(list(house.direction._window.entries))
    house.check_balance()
    snapshot = house.direction.counters.snapshot(0)
    assert (snapshot.taken, snapshot.confirmed, snapshot.dead_lettered) == (6, 2, 1)
    assert snapshot.returned == 3


def test_what_is_read_after_such_a_failure_is_never_published_undecoded() -> None:
    house = House()
    house.give(b'away')
    house.give(b'b', partition=1)
    house.direction._poll(0.0)
    house.source.lose(frozenset({0}))
    house.give(b'c', partition=1, first=1)
    with pytest.raises(RouteError):
        house.steps()
    assert house.sink.published == []


def test_a_route_runs_again_once_the_one_it_asks_is_back() -> None:
    house = House()
    house.give(b'a', b'away')
    with pytest.raises(RouteError):
        house.direction.run(Stop())
    assert house.source.committed == {0: 1}
    with house.direction._opened():
        house.give(b'back', first=1)
        house.steps()
        assert house.positions() == {0: 2}
    assert house.sink.published[-1] == b'cdr:back'


def test_a_message_that_is_larger_than_its_value_counts_with_its_own_size() -> None:
    house = House(max_in_flight_bytes=100_000)
    house.sink.acknowledging = False
    house.direction._decode = lambda value: (value or b'') * 50_000
    for first in range(4):
        house.give(b'x', first=first)
        house.steps(1)
    assert len(house.source.waiting) == 1
    assert house.direction._window.size_bytes == 3 * 50_000


@pytest.mark.parametrize(
    'headers',
    [
        [],
        [('ros.type_hash', HASH.encode())],
        [('other', b'x'), ('ros.type_hash', b'')],
        [('ros.type_hash', None), ('ros.type', b'std_msgs/msg/String')],
        [('ros.type_hash', b'INVALID')],
    ],
)
def test_a_record_of_the_same_type_or_of_none_told_passes(headers: Any) -> None:
    house = House()
    house.give(b'a', header_list=headers)
    house.steps()
    assert house.sink.published == [b'cdr:a']


def test_a_record_of_another_version_of_the_type_is_a_dead_letter_with_both_hashes() -> None:
    house = House()
    other = 'RIHS01_' + '2' * 64
    told = [('ros.type', b'other_msgs/msg/String'), ('ros.type_hash', other.encode())]
    house.give(b'a', header_list=told)
    house.give(b'b', first=1)
    house.steps()
    assert house.sink.published == [b'cdr:b']
    [letter] = house.letters.records
    error = str(dict(letter.headers)['dead_letter.error'])
    assert f'written with other_msgs/msg/String {other}' in error
    assert f'publishes std_msgs/msg/String {HASH}' in error
    assert 'check_type_hash: false' in error


# What is measured


def test_the_measures_of_a_snapshot_fit_its_counters() -> None:
    house = House()
    hour_ago_ms = int(time.time() * 1000) - 3_600_000
    house.give(b'abc', b'bad one', b'defg', time_ms=hour_ago_ms)
    now_ns = b'%d' % time.time_ns()
    house.give(b'hi', first=3, time_ms=hour_ago_ms, header_list=[('ros.source_time_ns', now_ns)])
    house.give(b'timeless', first=4)
    house.source.rebalances, house.sink.mismatched = 2, 1
    house.steps()
    house.direction._show('')
    snapshot = house.direction.snapshot
    measures = snapshot.measures
    assert snapshot.confirmed == sum(measures.in_bridge.counts) == 4
    assert measures.bytes_taken == len(b'abcbad onedefghitimeless')
    assert measures.bytes_confirmed == len(b'abcdefghitimeless')
    assert measures.end_to_end.counts[-1] == 2
    assert sum(measures.end_to_end.counts) == 3
    assert measures.errors == {'DecodeError': 1}
    assert [(t.error, t.text, t.times) for t in measures.troubles] == [
        ('DecodeError', 'orders[0]@1: not what it should be', 1)
    ]
    assert (measures.rebalances, measures.matched, measures.mismatched) == (2, 1, 1)
    assert (measures.queued, measures.queue_limit) == (0, house.sink.room)
    assert snapshot.made_s > 0


def test_bytes_that_are_in_flight_are_taken_and_those_given_back_stay_so() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'abc', b'de')
    house.steps()
    house.sink.acknowledge(1)
    house.steps(1)
    house.direction._show('')
    measures = house.direction.snapshot.measures
    assert (measures.bytes_taken, measures.bytes_confirmed, measures.queued) == (5, 3, 1)
    house.source.lose(frozenset({0}))
    house.direction._show('')
    assert house.direction.snapshot.measures.bytes_taken == 5


def test_the_time_in_which_a_subscriber_holds_the_route_back_is_measured() -> None:
    house = House()
    house.sink.room, house.sink.acknowledging = 1, False
    house.give(b'a', b'b')
    house.steps(20)
    house.direction._show('')
    waited_s = house.direction.snapshot.measures.waited_s
    assert waited_s > 0.01
    house.sink.acknowledging = True
    house.steps()
    house.direction._show('')
    assert house.direction.snapshot.measures.waited_s < waited_s + 0.05


def test_max_rate_is_no_back_pressure() -> None:
    house = House(max_rate=100)
    house.give(b'a', b'b', b'c')
    house.steps()
    house.direction._show('')
    assert house.direction.snapshot.measures.waited_s == 0


def test_a_dead_letter_topic_that_cannot_be_written_is_an_error() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('may not be written')]
    house.give(b'bad')
    house.steps()
    house.direction._show('')
    [_, trouble] = house.direction.snapshot.measures.troubles
    assert 'may not be written' in trouble.text
    assert house.direction.snapshot.measures.errors == {'DecodeError': 1, 'RouteError': 1}


def test_kafka_that_is_away_is_told_among_the_errors() -> None:
    house = House()
    house.source.away = 'Kafka is away: no answer'
    house.direction._show('')
    house.direction._show('')
    [trouble] = house.direction.snapshot.measures.troubles
    assert trouble[1:] == ('TransportError', 'Kafka is away: no answer', 1)


# Pause


def test_a_paused_route_publishes_nothing_and_confirms_what_is_in_flight() -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a', b'b')
    house.steps()
    house.pause.asked = True
    house.give(b'c', first=2)
    house.rests()
    assert house.source.held
    assert house.direction.snapshot.state == 'paused'
    assert house.direction.snapshot.reason == 'paused by an operator'
    house.sink.acknowledging = True
    house.rests()
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert house.positions() == {0: 2}
    house.pause.asked = False
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']
    assert house.direction.snapshot.state == 'running'


def test_what_was_read_and_not_published_waits_in_its_order_for_the_end_of_a_pause() -> None:
    house = House()
    house.sink.room, house.sink.acknowledging = 1, False
    house.give(b'a', b'b', b'c')
    house.steps(3)
    house.pause.asked = True
    house.sink.acknowledging = True
    house.rests()
    assert house.sink.published == [b'cdr:a']
    assert house.positions() == {0: 1}
    house.pause.asked = False
    house.steps(12)
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']


def test_a_stop_drains_a_paused_route(monkeypatch: pytest.MonkeyPatch) -> None:
    house = House()
    house.give(b'a')
    stop = Stop()

    def stay() -> tuple[()]:
        stop.ask()
        return ()

    monkeypatch.setattr(house.source, 'stay', stay)
    house.direction.run(stop, Pause(asked=True))
    assert house.sink.published == []
    assert house.direction.snapshot.state == 'stopped'
    assert house.direction.snapshot.balanced
