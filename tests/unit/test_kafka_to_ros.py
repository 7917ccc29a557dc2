"""The direction Kafka -> ROS, driven step by step with ends in memory."""

import logging
import time
from typing import Any

import pytest
from hypothesis import given, settings, strategies

from ros2_kafka_bridge import kafka_to_ros
from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.dead_letters import DeadLetters
from ros2_kafka_bridge.errors import DecodeError, RouteError
from ros2_kafka_bridge.formats import limited
from ros2_kafka_bridge.kafka_to_ros import Entry, KafkaToRos
from ros2_kafka_bridge.metrics import State
from ros2_kafka_bridge.stop import Stop
from ros2_kafka_bridge.testing.memory import (
    MemoryMessageSink,
    MemoryRecord,
    MemoryRecordSink,
    MemoryRecordSource,
)

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


def decode(value: bytes | None) -> bytes:
    if value is None or value.startswith(b'bad'):
        raise DecodeError('not what it should be')
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
        dead: DeadLetters[Entry] = DeadLetters('orders.dead', self.letters, lambda: None, LOG)
        self.direction = KafkaToRos(
            route,
            'me',
            self.source,
            self.sink,
            limited(decode, route.max_message_bytes),
            dead,
            LOG,
        )
        self.source.open(self.direction)

    def give(self, *values: bytes | None, partition: int = 0, first: int = 0, **more: Any) -> None:
        for number, value in enumerate(values):
            self.source.waiting.append(MemoryRecord(value, first + number, partition, **more))

    def steps(self, count: int = 6) -> None:
        for _ in range(count):
            self.direction._step()
            self.check_balance()

    def check_balance(self) -> None:
        snapshot = self.direction.counters.snapshot(len(self.direction._window))
        assert snapshot.balanced, snapshot

    def positions(self) -> dict[int, int]:
        self.direction._settle()
        return dict(self.direction._positions)

    def confirmed(self) -> int:
        return self.direction.counters.snapshot(0).confirmed


@pytest.fixture(autouse=True)
def _no_settle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kafka_to_ros, 'SETTLE_S', 0.0)


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
    assert house.source.rebalance is not None
    house.source.rebalance.revoked(frozenset({1}))
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
    assert house.source.rebalance is not None
    house.source.rebalance.lost(frozenset({0}))
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


def test_the_window_is_bounded_in_bytes() -> None:
    house = House(max_in_flight_bytes=1000)
    house.sink.acknowledging = False
    for number in range(5):
        house.give(b'x' * 900, first=number)
        house.steps(2)
    assert len(house.sink.published) == 1
    assert len(house.source.waiting) == 4


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


def test_a_reader_that_took_the_place_of_another_gets_time_to_know_of_the_match(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    house.sink.acknowledging = False
    house.give(b'a')
    house.steps()
    monkeypatch.setattr(kafka_to_ros, 'SETTLE_S', 60.0)
    house.sink.lose_reader()
    house.steps()
    assert house.sink.published == [b'cdr:a']
    monkeypatch.setattr(kafka_to_ros, 'SETTLE_S', 0.0)
    house.direction._ready_at_s = 0.0
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:a']


EVENTS = strategies.lists(
    strategies.sampled_from(
        ['good', 'bad', 'mine', 'old', 'step', 'acknowledge', 'lose', 'leave', 'come', 'letters']
    ),
    max_size=60,
)


@settings(max_examples=300, deadline=None)
@given(EVENTS)
def test_guarantee_1_no_offset_is_committed_before_all_up_to_it_have_ended(
    events: list[str],
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kafka_to_ros, 'SETTLE_S', 0.0)
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
