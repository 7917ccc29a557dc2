"""The pipeline ROS -> Kafka, driven step by step with ends in memory."""

import math
import time
from typing import Any

import pytest
from support.worlds.pipeline_to_kafka import House

from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import RecordTooLargeError, RouteError, TransportError
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.testing.memory import MemoryRecordSink
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop


def test_messages_arrive_once_in_order_with_key_and_headers() -> None:
    house = House()
    house.take(b'a', b'b')
    assert house.values() == [b'a', b'b']
    assert house.sink.records[1].key == b'key'
    assert house.sink.records[1].headers == [('ros.seq', '2')]
    assert house.count('confirmed') == 2


def test_a_message_that_comes_alone_is_sent_at_once() -> None:
    house = House()
    house.take(b'a', steps=1)
    assert house.sink.hurried == 1
    house.steps(3)  # nothing more has come
    assert house.sink.hurried == 1


@pytest.mark.parametrize(('after_s', 'hurried'), [(0.001, 0), (0.1, 1)])
def test_a_few_messages_linger_for_others_only_where_they_come_often(
    after_s: float, hurried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock_s = [100.0]
    monkeypatch.setattr('ros2_kafka_bridge.ros_to_kafka.time.monotonic', lambda: clock_s[0])
    house = House()
    house.take(b'first', steps=1)
    before = house.sink.hurried
    clock_s[0] += after_s
    house.take(*(b'%d' % number for number in range(20)), first=2, steps=1)
    assert house.sink.hurried - before == hurried
    house.steps()
    assert house.count('confirmed') == 21


def test_a_full_window_stops_the_taking() -> None:
    house = House(sink=MemoryRecordSink(answering=False), max_in_flight=3)
    house.take(b'a', b'b', b'c', b'd', b'e')
    assert len(house.source.waiting) == 2
    assert house.count('taken') == 3
    house.sink.answering = True
    house.steps()
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']


def test_where_the_oldest_are_dropped_as_many_wait_as_are_with_the_producer() -> None:
    house = House(when_full='drop_oldest', max_in_flight=600)
    house.sink.room = 600
    house.sink.answering = False
    house.take(*[b'a'] * 5000, steps=20)
    house.pipeline._room()
    house.pipeline._take_snapshot()
    assert house.pipeline.snapshot.in_flight == 1200


def test_the_window_is_bounded_in_bytes() -> None:
    house = House(sink=MemoryRecordSink(answering=False), max_in_flight_bytes=1000)
    for number in range(4):
        house.take(b'x' * 900, first=number + 1, steps=1)
    assert house.count('taken') == 1


def test_a_full_producer_keeps_the_order() -> None:
    house = House(sink=MemoryRecordSink(room=1))
    house.take(b'a', b'b', b'c', steps=8)
    assert house.values() == [b'a', b'b', b'c']


def test_drop_oldest_keeps_the_newest_and_counts_the_rest() -> None:
    house = House(sink=MemoryRecordSink(room=0), when_full='drop_oldest', max_in_flight=2)
    house.take(b'a', b'b', b'c', b'd', b'e')
    house.sink.room = 10
    house.steps()
    assert house.values() == [b'd', b'e']
    assert house.count('dropped') == 3


@pytest.mark.parametrize('most', [5, 500], ids=['messages', 'bytes'])
def test_drop_oldest_keeps_the_newest_of_large_messages_whichever_limit_is_reached_first(
    most: int, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(when_full='drop_oldest', max_in_flight=most, max_in_flight_bytes=5 * 1400)
    house.sink.room, house.sink.answering = 5, False
    for number in range(40):
        house.take(b'%02d' % number + b'x' * 998, first=number + 1, steps=1)
        assert house.pipeline._flight.size_bytes <= 11 * 1400
    assert not house.source.waiting, 'nobody is held back, or loses upstream'
    assert house.pipeline._flight.pushes_out, 'as the status says'
    house.sink.answering = True
    house.steps()
    assert [int((value or b'')[:2]) for value in house.values()] == [*range(5), *range(35, 40)]
    assert house.count('dropped') == 30
    assert 'drop: 1 that waited, to keep newer ones (when_full)' in caplog.text
    assert not house.pipeline._flight.pushes_out


def test_nothing_is_dropped_that_the_producer_has_just_made_room_for() -> None:
    house = House(when_full='drop_oldest', max_in_flight=100)
    house.sink.room, house.sink.answering = 100, False
    house.take(*[b'%d' % number for number in range(200)], steps=1)
    house.sink.answering = True
    house.give(*[b'%d' % number for number in range(200, 300)], first=201)
    house.pipeline.telling._told_s = -math.inf
    house.steps(8)
    assert house.count('dropped') == 0
    assert len(house.values()) == 300


def test_the_newest_waits_also_where_it_is_larger_than_the_window() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=1000)
    house.sink.room, house.sink.answering = 1, False
    for number in range(9):
        house.take(b'%d' % number + b'x' * 4999, first=number + 1, steps=1)
    house.sink.answering = True
    house.steps()
    assert [(value or b'')[:1] for value in house.values()] == [b'0', b'8']


def test_dead_letters_that_wait_take_the_room_of_others_that_do() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=5 * 1400)
    house.sink.room, house.sink.answering, house.letters.answering = 5, False, False
    for kind, many in ((b'sent', 5), (b'bad', 3), (b'new', 10)):
        house.take(*[kind.ljust(1000)] * many, first=house.count('taken') + 1, steps=2)
    assert len(house.pipeline._flight.lane.ready) == 2
    house.sink.answering = house.letters.answering = True
    house.steps()
    assert (house.count('dropped'), house.count('dead_lettered')) == (8, 3)


def test_drop_oldest_takes_nothing_for_dead_letters_that_fill_the_window() -> None:
    house = House(when_full='drop_oldest', max_in_flight_bytes=5 * 1400)
    house.letters.answering = False
    for number in range(40):
        house.take(b'bad' + b'x' * 997, first=number + 1, steps=1)
    assert len(house.source.waiting) == 40 - 6
    house.letters.answering = True
    house.steps(40)
    assert len(house.letters.records) == 40


def test_a_batch_that_the_broker_finds_too_large_is_sent_again_one_by_one() -> None:
    house = House()
    batch = [b'a', b'b', b'large', b'd']
    for value in batch:
        house.sink.errors[value] = [RecordTooLargeError(len(value), None, 'of the topic')]
    house.sink.errors[b'large'].append(RecordTooLargeError(5, None, 'max.message.bytes'))
    house.take(*batch, steps=12)
    assert house.values() == [b'a', b'b', b'd']
    [letter] = house.letters.records
    assert letter.value is None
    assert 'max.message.bytes' in str(dict(letter.headers)['dead_letter.error'])


def test_a_delivery_that_failed_for_now_is_tried_again_in_order() -> None:
    house = House()
    for value in (b'a', b'b'):
        house.sink.errors[value] = [TransportError('timed out')]
    house.take(b'a', b'b')
    assert house.values() == [b'a', b'b']


def test_what_a_failed_run_held_goes_first_in_the_next_one() -> None:
    house = House()
    house.sink.close()
    for value in (b'b', b'c'):
        house.sink.errors[value] = [RouteError('no permission')]
    house.give(b'a', b'b', b'c')
    with pytest.raises(RouteError, match='no permission'), house.pipeline._opened():
        house.steps()
    house.check_balance()
    with house.pipeline._opened():
        house.take(b'd', first=4)
    assert house.values() == [b'a', b'b', b'c', b'd']
    house.check_balance()


def test_what_kafka_holds_from_before_a_restart_is_skipped_and_counted() -> None:
    house = House(seen=frozenset({1, 2}))
    house.take(b'a', b'b', b'c')
    assert house.values() == [b'c']
    assert house.count('skipped') == 2


@pytest.mark.parametrize('paused', [False, True])
def test_guarantee_6_in_flight_is_never_told_above_twice_the_window_where_the_oldest_is_dropped(
    paused: bool,  # noqa: FBT001 (a case)
) -> None:
    house = House(max_in_flight=10, when_full='drop_oldest')
    house.sink.room, house.sink.answering = 10, False
    told = []
    for batch in range(5):
        house.give(*[b'x'] * 500, first=1 + 500 * batch)
        house.pipeline._step()
        house.pipeline.telling._told_s = -math.inf
        house.pipeline._rest() if paused else house.pipeline._step()
        told.append(house.pipeline.snapshot.in_flight)
    assert max(told) <= 20


def test_a_record_sent_alone_that_times_out_is_sent_again() -> None:
    house = House()
    house.sink.errors[b'a'] = [
        RecordTooLargeError(1, None, 'of the topic'),
        TransportError('timed out'),
    ]
    house.sink.errors[b'b'] = [RecordTooLargeError(1, None, 'of the topic')]
    house.take(b'a', b'b', steps=8)
    assert house.values() == [b'a', b'b']


# What is measured


def test_the_measures_of_a_snapshot_fit_its_counters() -> None:
    house = House(seen=frozenset({3}))
    now_ns = time.time_ns()
    for number, cdr in enumerate((b'abc', b'bad', b'seen', b'de'), 1):
        published_ns = now_ns - 3_600_000_000_000 if number == 1 else now_ns
        house.source.waiting.append(Message(cdr, b'gid', number, published_ns))
    house.source.waiting.append(Message(b'no time', b'gid', 5, 0))
    house.steps()
    snapshot = house.shown()
    measures = snapshot.measures
    assert snapshot.confirmed == 3
    assert sum(measures.in_bridge.counts) == sum(measures.round_trip.counts) == 3
    assert measures.bytes_taken == len(b'abcbadseendeno time')
    assert measures.bytes_confirmed == len(b'abcdeno time')
    assert (measures.end_to_end.counts[-1], sum(measures.end_to_end.counts)) == (1, 2)
    assert measures.errors == {'EncodeError': 1}
    assert (measures.matched, measures.queued, measures.queue_limit) == (1, 0, house.sink.room)


def test_a_route_with_nothing_to_send_tells_whether_kafka_was_and_is_there() -> None:
    house = House()
    seen: list[tuple[State, str, bool | None]] = []
    for reached, away in ((False, ''), (False, 'no broker'), (True, ''), (True, 'no broker')):
        house.sink.reached, house.sink.away = reached, away
        house.sink.answers = False if away else reached or None
        house.pipeline.telling._told_s = -math.inf
        house.steps(1)
        snapshot = house.pipeline.snapshot
        seen.append((snapshot.state, snapshot.reason, snapshot.measures.kafka_up))
    assert seen == [
        (State.STARTING, '', None),
        (State.STARTING, 'no broker', False),
        (State.RUNNING, '', True),
        (State.WAITING, 'no broker', False),
    ]


def test_what_is_delivered_while_the_route_ends_is_measured_too() -> None:
    house = House()
    house.give(b'a', b'b')
    house.sink.delivered_at_close = 2
    house.pipeline._take(10, 0.0)
    house.pipeline._producing.produce_ready()
    house.pipeline._close_sinks()
    assert house.shown().confirmed == 2
    assert sum(house.pipeline.snapshot.measures.round_trip.counts) == 2


def test_the_time_in_which_kafka_holds_the_route_back_is_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_report(timeout_s: float) -> Reports[Any]:
        time.sleep(timeout_s)
        return Reports([], [])

    house = House(max_in_flight=1)
    monkeypatch.setattr(house.sink, 'poll', no_report)
    house.take(b'a', b'b')
    assert house.shown().measures.waited_s > 0.01


# Pause


def test_a_paused_route_takes_nothing_and_confirms_what_is_in_flight() -> None:
    house = House(sink=MemoryRecordSink(answering=False))
    house.take(b'a')
    house.pause.asked = True
    house.sink.answering = True
    house.give(b'b', first=2)
    house.rests()
    assert house.values() == [b'a']
    assert len(house.source.waiting) == 1
    assert house.source.looked > 0
    assert house.pipeline.snapshot.state == 'paused'
    assert house.pipeline.snapshot.measures.waited_s == 0
    house.pause.asked = False
    house.steps()
    assert house.values() == [b'a', b'b']
    assert house.pipeline.snapshot.state == 'running'


def test_a_stop_takes_what_a_paused_route_has_left(monkeypatch: pytest.MonkeyPatch) -> None:
    house = House()
    house.give(b'a', b'b')
    stop = Stop()
    monkeypatch.setattr(house.source, 'look', stop.ask)
    house.pipeline.run(stop, Pause(asked=True))
    assert house.values() == [b'a', b'b']
    assert house.pipeline.snapshot.confirmed == 2


def test_what_has_failed_for_now_goes_again_in_order_however_it_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    for value in (b'a', b'b', b'c'):
        house.sink.errors[value] = [TransportError('timed out')]
    house.give(b'a', b'b', b'c')
    poll = house.sink.poll

    def poll_backwards(timeout_s: float) -> Reports[Any]:
        confirmed, failed = poll(timeout_s)
        return Reports(confirmed, failed[::-1])

    monkeypatch.setattr(house.sink, 'poll', poll_backwards)
    house.steps()
    assert house.values() == [b'a', b'b', b'c']
