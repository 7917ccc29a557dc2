"""What the pipeline Kafka -> ROS tells of itself, driven step by step."""

import time

import pytest
from support.worlds.pipeline_to_ros import House

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.testing.memory import MemoryMessageSink

pytestmark = pytest.mark.usefixtures('no_settle_time')


def test_the_measures_of_a_snapshot_fit_its_counters() -> None:
    house = House()
    hour_ago_ms = int(time.time() * 1000) - 3_600_000
    house.give(b'abc', b'bad one', b'defg', time_ms=hour_ago_ms)
    now_ns = b'%d' % time.time_ns()
    house.give(b'hi', first=3, time_ms=hour_ago_ms, header_list=[('ros.source_time_ns', now_ns)])
    house.give(b'timeless', first=4)
    house.source.rebalances, house.sink.mismatched = 2, 1
    house.steps()
    snapshot = house.shown()
    measures = snapshot.measures
    assert snapshot.confirmed == sum(measures.in_bridge.counts) == 4
    assert sum(measures.published.counts) == 4
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


def test_the_delay_ends_with_the_publication_however_late_it_is_seen_to_have_come() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'abc', b'de', time_ms=int(time.time() * 1000))
    first = house.shown().measures
    assert sum(first.delay.counts) == sum(first.end_to_end.counts) == 2
    assert sum(first.in_bridge.counts) == 0
    house.sink.acknowledge(2)
    house.steps(1)
    last = house.shown().measures
    assert (last.delay, last.end_to_end) == (first.delay, first.end_to_end)
    assert sum(last.in_bridge.counts) == 2


def test_bytes_that_are_in_flight_are_taken_and_those_given_back_stay_so() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'abc', b'de')
    house.sink.acknowledge(1)
    house.steps(1)
    measures = house.shown().measures
    assert (measures.bytes_taken, measures.bytes_confirmed, measures.queued) == (5, 3, 1)
    house.source.lose(frozenset({0}))
    assert house.shown().measures.bytes_taken == 5


def test_the_time_in_which_a_subscriber_holds_the_route_back_is_measured() -> None:
    house = House(MemoryMessageSink(room=1, acknowledging=False))
    house.take(b'a', b'b', steps=20)
    waited_s = house.shown().measures.waited_s
    assert waited_s > 0.01
    house.sink.acknowledging = True
    house.steps()
    assert house.shown().measures.waited_s < waited_s + 0.05


def test_max_rate_is_no_back_pressure() -> None:
    house = House(max_rate=100)
    house.take(b'a', b'b', b'c')
    assert house.shown().measures.waited_s == 0


def test_a_dead_letter_topic_that_cannot_be_written_is_an_error() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('may not be written')]
    house.take(b'bad')
    [_, trouble] = house.shown().measures.troubles
    assert 'may not be written' in trouble.text
    assert house.pipeline.snapshot.measures.errors == {'DecodeError': 1, 'RouteError': 1}


def test_a_route_begins_until_kafka_has_answered_and_is_up_while_it_does() -> None:
    house = House()
    seen: list[tuple[State, str, bool | None]] = []
    for reached, answers, away in (
        (False, False, 'no broker'),
        (True, True, ''),
        (True, False, 'no broker'),
        (True, True, 'not let into the group'),
    ):
        house.source.reached, house.source.answers, house.source.away = reached, answers, away
        house.pipeline._show(away)
        snapshot = house.pipeline.snapshot
        seen.append((snapshot.state, snapshot.reason, snapshot.measures.kafka_up))
    assert seen == [
        (State.STARTING, 'no broker', False),
        (State.RUNNING, '', True),
        (State.WAITING, 'no broker', False),
        (State.WAITING, 'not let into the group', True),
    ]


def test_kafka_that_is_away_is_told_among_the_errors() -> None:
    house = House()
    house.source.away = 'Kafka is away: no answer'
    house.pipeline._show('')
    [trouble] = house.shown().measures.troubles
    assert trouble[1:] == ('TransportError', 'Kafka is away: no answer', 1)
