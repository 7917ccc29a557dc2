"""The direction ROS -> Kafka, driven step by step with ends in memory."""

import logging
import time
import traceback
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.writer import DeadLetters
from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import (
    EncodeError,
    RecordTooLargeError,
    RouteError,
    TransportError,
)
from ros2_kafka_bridge.formats import Encode, guarded
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.route.type_hash import check_nothing, make_publisher_check
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.testing.memory import MemoryMessageSource, MemoryRecordSink
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.route.message_window import MessageEntry

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


def encode(cdr: bytes) -> bytes:
    if cdr.startswith(b'bad'):
        raise EncodeError('not what it should be')
    if cdr.startswith(b'bug'):
        raise AttributeError("'NoneType' object has no attribute 'get'")
    return cdr


class InKafka:
    """Kafka holds the messages and the dead letters of these numbers, whoever published them."""

    def __init__(self, numbers: frozenset[int], letters: frozenset[int]) -> None:
        self.numbers = set(numbers)
        self.letters = letters

    def contains(self, message: Message) -> bool:
        return message.seq in self.numbers

    def add(self, numbers: Iterable[tuple[bytes, int]]) -> None:
        self.numbers |= {seq for _, seq in numbers}

    def look_at_end(self) -> None:
        pass

    def holds(self, _gid: bytes, _seq: int) -> bool:
        return False

    def holds_letter(self, _gid: bytes, seq: int, _made_ns: int) -> bool:
        return seq in self.letters


class House:
    """A direction with its ends."""

    def __init__(
        self,
        seen: frozenset[int] = frozenset(),
        refused: frozenset[int] = frozenset(),
        **settings: Any,
    ) -> None:
        self.source = MemoryMessageSource()
        self.sink: MemoryRecordSink[MessageEntry] = MemoryRecordSink()
        self.letters: MemoryRecordSink[Any] = MemoryRecordSink()
        route = RosToKafkaRoute.model_validate(
            {
                'name': 'orders',
                'from': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
                'to': {'kafka': 'orders'},
                'format': 'text',
                **settings,
            }
        )
        dead: DeadLetters[MessageEntry] = DeadLetters(
            'orders.dead', self.letters, lambda: None, LOG
        )
        self.direction = RosToKafka(
            route,
            self.source,
            InKafka(seen, refused),
            self.sink,
            lambda: guarded(encode, route.max_message_bytes, EncodeError),
            lambda _: b'key',
            lambda message: [('ros.seq', str(message.seq))],
            check_nothing,
            dead,
            Backlog(None, None, LOG),
            LOG,
        )
        self.pause = self.direction._pause
        self.direction._prepare()
        self.sink.open()

    def give(self, *cdr: bytes, first: int = 1) -> None:
        for number, one in enumerate(cdr):
            self.source.waiting.append(Message(one, b'gid', first + number, 0))

    def steps(self, count: int = 4) -> None:
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

    def values(self) -> list[bytes | None]:
        return [record.value for record in self.sink.records]

    def count(self, name: str) -> int:
        return int(getattr(self.direction.counters.snapshot(0), name))


def test_messages_arrive_once_in_order_with_key_and_headers() -> None:
    house = House()
    house.give(b'a', b'b')
    house.steps()
    assert house.values() == [b'a', b'b']
    assert house.sink.records[1].key == b'key'
    assert house.sink.records[1].headers == [('ros.seq', '2')]
    assert house.count('confirmed') == 2


def test_a_message_that_comes_alone_is_sent_at_once() -> None:
    house = House()
    house.give(b'a')
    house.steps(1)
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
    house.give(b'first')
    house.steps(1)
    before = house.sink.hurried
    clock_s[0] += after_s
    house.give(*(b'%d' % number for number in range(20)), first=2)
    house.steps(1)
    assert house.sink.hurried - before == hurried
    house.steps()
    assert house.count('confirmed') == 21


def test_a_full_window_stops_the_taking() -> None:
    house = House(max_in_flight=3)
    house.sink.answering = False
    house.give(b'a', b'b', b'c', b'd', b'e')
    house.steps()
    assert len(house.source.waiting) == 2
    assert house.count('taken') == 3
    house.sink.answering = True
    house.steps()
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']


def test_where_the_oldest_are_dropped_as_many_wait_as_are_with_the_producer() -> None:
    house = House(when_full='drop_oldest', max_in_flight=600)
    house.sink.room = 600
    house.sink.answering = False
    house.give(*[b'a'] * 5000)
    house.steps(20)
    house.direction._room()
    house.direction._take_snapshot()
    assert house.direction.snapshot.in_flight == 1200


def test_the_window_is_bounded_in_bytes() -> None:
    house = House(max_in_flight_bytes=1000)
    house.sink.answering = False
    for number in range(4):
        house.give(b'x' * 900, first=number + 1)
        house.steps(1)
    assert house.count('taken') == 1


def test_a_full_producer_keeps_the_order() -> None:
    house = House()
    house.sink.room = 1
    house.give(b'a', b'b', b'c')
    house.steps(8)
    assert house.values() == [b'a', b'b', b'c']


def test_drop_oldest_keeps_the_newest_and_counts_the_rest() -> None:
    house = House(when_full='drop_oldest', max_in_flight=2)
    house.sink.room = 0
    house.give(b'a', b'b', b'c', b'd', b'e')
    house.steps()
    house.sink.room = 10
    house.steps()
    assert house.values() == [b'd', b'e']
    assert house.count('dropped') == 3


def test_a_message_that_cannot_be_encoded_becomes_a_dead_letter_and_the_next_one_goes() -> None:
    house = House()
    house.give(b'a', b'bad', b'c')
    house.steps()
    assert house.values() == [b'a', b'c']
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert (letter.topic, letter.value) == ('orders.dead', b'bad')
    assert told['dead_letter.error'] == 'EncodeError: not what it should be'
    assert (told['dead_letter.source'], told['ros.seq']) == ('/orders', '2')
    assert house.count('dead_lettered') == 1


@pytest.mark.parametrize('on_error', ['dead_letter', 'drop', 'stop'])
def test_a_bug_of_the_encoder_is_told_with_its_traceback_whatever_the_route_does_about_it(
    caplog: pytest.LogCaptureFixture, on_error: str
) -> None:
    house = House(on_error=on_error)
    house.give(b'bug')
    with suppress(RouteError):
        house.steps()
    [line] = [one for one in caplog.records if one.levelname == 'ERROR']
    assert line.getMessage().startswith("/orders -> orders: the bridge's own encoder failed: ")
    assert line.exc_info is not None
    assert traceback.extract_tb(line.exc_info[2])[-1].name == 'encode'


def test_a_message_that_meets_a_bug_of_the_encoder_becomes_a_dead_letter() -> None:
    house = House()
    house.give(b'a', b'bug', b'c')
    house.steps()
    assert house.values() == [b'a', b'c']
    [letter] = house.letters.records
    assert letter.value == b'bug'
    assert dict(letter.headers)['dead_letter.error'] == (
        "EncodeError: the bridge's own encoder failed: AttributeError: 'NoneType' object has no "
        "attribute 'get': a bug of the bridge, report it with the traceback of its log"
    )


def test_a_message_above_max_message_bytes_goes_to_the_dead_letters_without_its_value() -> None:
    house = House(max_message_bytes=3)
    house.give(b'four', b'abc')
    house.steps()
    assert house.values() == [b'abc']
    [letter] = house.letters.records
    assert letter.value is None
    assert dict(letter.headers)['dead_letter.value_bytes'] == '4'


def test_a_batch_that_the_broker_finds_too_large_is_sent_again_one_by_one() -> None:
    house = House()
    batch = [b'a', b'b', b'large', b'd']
    for value in batch:
        house.sink.errors[value] = [RecordTooLargeError(len(value), None, 'of the topic')]
    house.sink.errors[b'large'].append(RecordTooLargeError(5, None, 'max.message.bytes'))
    house.give(*batch)
    house.steps(12)
    assert house.values() == [b'a', b'b', b'd']
    [letter] = house.letters.records
    assert letter.value is None
    assert 'max.message.bytes' in str(dict(letter.headers)['dead_letter.error'])


def test_a_delivery_that_failed_for_now_is_tried_again_in_order() -> None:
    house = House()
    for value in (b'a', b'b'):
        house.sink.errors[value] = [TransportError('timed out')]
    house.give(b'a', b'b')
    house.steps()
    assert house.values() == [b'a', b'b']


def test_what_a_failed_run_held_goes_first_in_the_next_one() -> None:
    house = House()
    house.sink.close()
    for value in (b'b', b'c'):
        house.sink.errors[value] = [RouteError('no permission')]
    house.give(b'a', b'b', b'c')
    with pytest.raises(RouteError, match='no permission'), house.direction._opened():
        house.steps()
    house.check_balance()
    with house.direction._opened():
        house.give(b'd', first=4)
        house.steps()
    assert house.values() == [b'a', b'b', b'c', b'd']
    house.check_balance()


def test_what_kafka_holds_from_before_a_restart_is_skipped_and_counted() -> None:
    house = House(seen=frozenset({1, 2}))
    house.give(b'a', b'b', b'c')
    house.steps()
    assert house.values() == [b'c']
    assert house.count('skipped') == 2


def test_what_was_a_dead_letter_before_a_restart_is_no_second_one() -> None:
    house = House(refused=frozenset({1, 2}), max_message_bytes=5)
    house.give(b'bad 1', b'longer', b'bad 3')
    house.steps()
    [letter] = house.letters.records
    assert letter.value == b'bad 3'
    assert (house.count('skipped'), house.count('dead_lettered')) == (2, 1)


def test_what_was_a_dead_letter_before_a_restart_goes_to_kafka_once_it_can() -> None:
    house = House(refused=frozenset({1}))
    house.give(b'mended')
    house.steps()
    assert house.values() == [b'mended']


def test_on_error_drop_looks_at_no_letters_and_drops_nothing_for_a_bug() -> None:
    house = House(refused=frozenset({1}), on_error='drop')
    house.give(b'bad', b'bug')
    house.steps()
    assert [letter.value for letter in house.letters.records] == [b'bug']
    assert (house.count('dropped'), house.count('skipped')) == (1, 0)


def test_on_error_drop_counts_and_goes_on() -> None:
    house = House(on_error='drop')
    house.give(b'bad', b'b')
    house.steps()
    assert house.values() == [b'b']
    assert house.count('dropped') == 1


def test_on_error_stop_ends_the_route() -> None:
    house = House(on_error='stop')
    house.give(b'bad')
    with pytest.raises(RouteError, match='/orders -> orders: not what') as raised:
        house.steps()
    assert raised.value.final


def test_on_error_stop_delivers_all_before_the_bad_message_and_says_what_it_gives_up() -> None:
    house = House(on_error='stop')
    house.sink.answering = False
    house.give(b'a', b'b', b'bad', b'c', b'd')
    house.steps()
    house.sink.answering = True
    with pytest.raises(RouteError, match='2 messages behind it are given up'):
        house.steps()
    assert house.values() == [b'a', b'b']
    assert house.count('taken') == 5


def test_on_error_stop_sends_nothing_that_waits_behind_what_the_producer_refuses() -> None:
    house = House(on_error='stop')
    house.sink.limit_bytes = 5
    house.give(b'a', b'much too large', b'c', b'd')
    with pytest.raises(RouteError, match='2 messages behind it are given up'):
        house.steps()
    assert house.values() == [b'a']


def test_on_error_stop_sends_nothing_again_that_was_sent_with_what_the_broker_refuses() -> None:
    """What the producer has by then may arrive; what it cannot deliver is not sent again."""
    house = House(on_error='stop')
    for value in (b'a', b'large', b'c'):
        house.sink.errors[value] = [RecordTooLargeError(1, None, 'of the topic')]
    house.sink.errors[b'large'].append(RecordTooLargeError(1, None, 'of the topic'))
    house.give(b'a', b'large', b'c', b'd')
    with pytest.raises(RouteError, match='behind it are given up'):
        house.steps(10)
    assert house.values() == [b'd', b'a']


@pytest.mark.parametrize('paused', [False, True])
def test_guarantee_6_in_flight_is_never_told_above_twice_the_window_where_the_oldest_is_dropped(
    paused: bool,  # noqa: FBT001 (a case)
) -> None:
    house = House(max_in_flight=10, when_full='drop_oldest')
    house.sink.room, house.sink.answering = 10, False
    told = []
    for batch in range(5):
        house.give(*[b'x'] * 500, first=1 + 500 * batch)
        house.direction._step()
        house.direction._telling._at_s = 0.0
        house.direction._rest() if paused else house.direction._step()
        told.append(house.direction.snapshot.in_flight)
    assert max(told) <= 20


def test_a_record_sent_alone_that_times_out_is_sent_again() -> None:
    house = House()
    house.sink.errors[b'a'] = [
        RecordTooLargeError(1, None, 'of the topic'),
        TransportError('timed out'),
    ]
    house.sink.errors[b'b'] = [RecordTooLargeError(1, None, 'of the topic')]
    house.give(b'a', b'b')
    house.steps(8)
    assert house.values() == [b'a', b'b']


def test_a_dead_letter_topic_that_refuses_stops_the_taking() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('no permission')]
    house.give(b'bad')
    house.steps()
    house.give(b'b', first=2)
    house.steps()
    house.direction._show('')
    assert house.direction.snapshot.state == State.FAILED
    assert house.values() == []
    house.direction._dead_letters._again_at_s = 0.0
    house.steps()
    assert house.values() == [b'b']
    assert [letter.value for letter in house.letters.records] == [b'bad']


def test_a_drain_takes_until_the_source_is_empty_and_waits_for_the_reports() -> None:
    house = House(max_in_flight=2)
    house.sink.close()
    house.give(b'a', b'b', b'c', b'd', b'e')
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']
    assert house.direction.snapshot.in_flight == 0


def test_a_drain_that_runs_out_of_time_says_how_many_it_gave_up() -> None:
    house = House(drain_s=0.1)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b')
    stop = Stop()
    stop.ask()
    with pytest.raises(RouteError, match='gave up 2 messages'):
        house.direction.run(stop)
    assert house.direction.snapshot.balanced
    assert house.direction.snapshot.in_flight == 2


class HandOver(Stop):
    """Another bridge goes on with the route, and this one lives."""

    is_end = False


def test_guarantee_1_a_hand_over_waits_for_kafka_as_long_as_the_bridge_lives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What DDS has handed over is nowhere else: a slow Kafka is waited for, and not given up."""
    house = House(drain_s=0.0, max_in_flight=2)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b', b'c', b'd', b'e')
    stop, polls = HandOver(), 0
    stop.ask()
    poll = house.sink.poll

    def answer_late(timeout_s: float) -> Reports[Any]:
        nonlocal polls
        polls += 1
        house.sink.answering = polls > 20
        return poll(timeout_s)

    monkeypatch.setattr(house.sink, 'poll', answer_late)
    house.direction.run(stop)
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']
    assert house.direction.snapshot.in_flight == 0


def test_guarantee_1_a_hand_over_ends_also_where_the_publishers_never_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The next bridge reads by then: what this one leaves, that one has."""
    monkeypatch.setattr('ros2_kafka_bridge.ros_to_kafka._REST_S', 0.3)
    house = House(max_in_flight=10)
    house.sink.close()
    stop, taken = HandOver(), 0
    stop.ask()

    def take(limit: int, timeout_s: float) -> list[Message]:
        nonlocal taken
        assert not house.source.closed, 'a reader that is idle holds the next bridge back'
        del timeout_s
        taken += limit
        house.give(b'more')  # it is never found empty
        return [Message(b'a', b'gid', taken + n, 0) for n in range(limit)]

    monkeypatch.setattr(house.source, 'take', take)
    house.direction.run(stop)
    assert taken > 100
    assert house.source.closed
    assert len(house.values()) == taken
    assert house.direction.snapshot.in_flight == 0


def test_a_hand_over_that_waits_for_kafka_ends_in_time_once_the_bridge_stops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(drain_s=0.1)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b')
    stop, polls = HandOver(), 0
    stop.ask()
    poll = house.sink.poll

    def look(timeout_s: float) -> Reports[Any]:
        nonlocal polls
        polls += 1
        monkeypatch.setattr(HandOver, 'is_end', polls > 20)
        return poll(timeout_s)

    monkeypatch.setattr(house.sink, 'poll', look)
    with pytest.raises(RouteError, match='gave up 2 messages'):
        house.direction.run(stop)
    assert polls > 20


def test_a_drain_that_owes_nothing_to_kafka_is_well_also_where_kafka_lets_nobody_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_timeout_s: float) -> None:
        raise RouteError('not let in')

    house = House()
    house.sink.close()
    monkeypatch.setattr(house.sink, 'poll', refuse)
    stop = Stop()
    stop.ask()
    house.direction.run(stop)
    house.give(b'a')
    with pytest.raises(RouteError, match='not let in'):
        house.direction.run(stop)
    assert house.direction.snapshot.in_flight == 1


def test_a_message_of_another_version_of_its_type_is_a_dead_letter_that_keeps_its_bytes() -> None:
    ours, theirs = ('RIHS01_' + digit * 64 for digit in '12')
    house = House()
    house.direction._check_headers = make_publisher_check('std_msgs/msg/String', ours)
    hashes = {1: ours, 2: theirs, 3: ''}
    house.direction._make_headers = lambda message: [
        ('ros.type_hash', hashes[message.seq].encode())
    ]
    house.give(b'a', b'b', b'c')
    house.steps()
    assert [record.value for record in house.sink.records] == [encode(b'a'), encode(b'c')]
    [letter] = house.letters.records
    assert letter.value == b'b'
    error = str(dict(letter.headers)['dead_letter.error'])
    assert error.startswith('EncodeError: ros.type_hash: the publisher sends std_msgs/msg/String')
    assert ours in error
    assert theirs in error


def test_a_registry_that_is_away_at_the_start_is_asked_again_and_nothing_is_taken_meanwhile() -> (
    None
):
    house = House()
    answers: list[Exception | None] = [RouteError('away'), None]

    def make_encode() -> Encode:
        if (error := answers.pop(0)) is not None:
            raise error
        return encode

    house.direction._encode, house.direction._make_encode = None, make_encode
    house.give(b'a')
    stop = Stop()
    stop.ask()
    with pytest.raises(RouteError, match='away'):
        house.direction.run(stop)
    assert len(house.source.waiting) == 1
    house.sink.close()
    house.direction.run(stop)
    assert [record.value for record in house.sink.records] == [encode(b'a')]


# What is measured


def test_the_measures_of_a_snapshot_fit_its_counters() -> None:
    house = House(seen=frozenset({3}))
    now_ns = time.time_ns()
    for number, cdr in enumerate((b'abc', b'bad', b'seen', b'de'), 1):
        published_ns = now_ns - 3_600_000_000_000 if number == 1 else now_ns
        house.source.waiting.append(Message(cdr, b'gid', number, published_ns))
    house.source.waiting.append(Message(b'no time', b'gid', 5, 0))
    house.steps()
    house.direction._show('')
    snapshot = house.direction.snapshot
    measures = snapshot.measures
    assert snapshot.confirmed == 3
    assert sum(measures.in_bridge.counts) == sum(measures.round_trip.counts) == 3
    assert measures.bytes_taken == len(b'abcbadseendeno time')
    assert measures.bytes_confirmed == len(b'abcdeno time')
    assert (measures.end_to_end.counts[-1], sum(measures.end_to_end.counts)) == (1, 2)
    assert measures.errors == {'EncodeError': 1}
    assert (measures.matched, measures.queued, measures.queue_limit) == (1, 0, house.sink.room)


def test_what_is_delivered_while_the_route_ends_is_measured_too() -> None:
    house = House()
    house.give(b'a', b'b')
    house.sink.delivered_at_close = 2
    house.direction._take(10, 0.0)
    house.direction._producing.produce_pending()
    house.direction._close_sinks()
    house.direction._show('')
    assert house.direction.snapshot.confirmed == 2
    assert sum(house.direction.snapshot.measures.round_trip.counts) == 2


def test_the_time_in_which_kafka_holds_the_route_back_is_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_report(timeout_s: float) -> Reports[Any]:
        time.sleep(timeout_s)
        return Reports([], [])

    house = House(max_in_flight=1)
    monkeypatch.setattr(house.sink, 'poll', no_report)
    house.give(b'a', b'b')
    house.steps()
    house.direction._show('')
    assert house.direction.snapshot.measures.waited_s > 0.01


# Pause


def test_a_paused_route_takes_nothing_and_confirms_what_is_in_flight() -> None:
    house = House()
    house.sink.answering = False
    house.give(b'a')
    house.steps()
    house.pause.asked = True
    house.sink.answering = True
    house.give(b'b', first=2)
    house.rests()
    assert house.values() == [b'a']
    assert len(house.source.waiting) == 1
    assert house.source.looked > 0
    assert house.direction.snapshot.state == 'paused'
    assert house.direction.snapshot.measures.waited_s == 0
    house.pause.asked = False
    house.steps()
    assert house.values() == [b'a', b'b']
    assert house.direction.snapshot.state == 'running'


def test_a_stop_takes_what_a_paused_route_has_left(monkeypatch: pytest.MonkeyPatch) -> None:
    house = House()
    house.give(b'a', b'b')
    stop = Stop()
    monkeypatch.setattr(house.source, 'look', stop.ask)
    house.direction.run(stop, Pause(asked=True))
    assert house.values() == [b'a', b'b']
    assert house.direction.snapshot.confirmed == 2
