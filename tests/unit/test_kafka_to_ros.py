"""The pipeline Kafka -> ROS, driven step by step with ends in memory."""

import time
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings, strategies
from support.worlds.pipeline_to_ros import IN_2001_MS, MINE, House

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route import readiness
from ros2_kafka_bridge.testing.memory import MemoryMessageSink
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.endpoints import HeaderList

pytestmark = pytest.mark.usefixtures('no_settle_time')


def test_a_position_moves_on_only_when_its_message_is_confirmed() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a', b'b', b'c')
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']
    assert house.positions() == {0: 0}
    house.sink.acknowledge(2)
    house.steps(1)
    assert house.positions() == {0: 2}
    assert house.confirmed() == 2


def test_offsets_with_gaps_move_on_in_order_of_consumption() -> None:
    house = House()
    house.give(b'a', first=5)
    house.take(b'b', first=1000)
    assert house.positions() == {0: 1001}


def test_what_would_go_round_is_a_dead_letter_and_no_other_record_of_this_bridge(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A processor copies the headers of what it has read into the commands that it writes."""
    copied: list[HeaderList] = [
        [('ros.topic', b'/status'), ('bridge.origin', b'me'), ('bridge.route', b'status')],
        [('ros.topic', b'/orders'), ('bridge.origin', b'you')],
        [('bridge.origin', b'me')],
        [('ros.topic', b'/orders')],
        [('ros.topic', b'/orders/'), ('bridge.origin', b'me'), ('origin', b'/orders')],
    ]
    house = House()
    for offset, headers in enumerate(copied):
        house.give(b'%d' % offset, first=offset, header_list=headers)
    for offset in range(5, 55):
        house.give(b'round', first=offset, header_list=[*MINE, ('extra', b'x')])
    house.steps()
    assert house.sink.published == [b'cdr:%d' % offset for offset in range(5)]
    assert house.pipeline.counters.snapshot(0).dead_lettered == 50
    letter = house.letters.records[0]
    assert (letter.value, letter.headers[:3]) == (b'round', [*MINE, ('extra', b'x')])
    assert str(dict(letter.headers)['dead_letter.error']).startswith('LoopError: it came from /or')
    warnings = [line for line in caplog.messages if 'LoopError' in line or 'it came from' in line]
    assert len(warnings) == 1, 'it says so once, not 50 times'
    assert 'skip_own: true' in warnings[0]


def test_what_would_go_round_is_skipped_and_counted_where_the_route_says_so() -> None:
    house = House(skip_own=True, on_error='stop')
    house.give(b'mine', header_list=MINE)
    house.take(b'other', first=1, header_list=[MINE[0]])
    assert house.sink.published == [b'cdr:other']
    assert house.pipeline.counters.snapshot(0).skipped == 1
    assert house.letters.records == []


@pytest.mark.parametrize(
    ('on_error', 'ended'), [('drop', {'dropped': 1}), ('stop', {'dropped': 0})]
)
def test_what_would_go_round_follows_on_error_as_any_other_bad_record(
    on_error: str, ended: dict[str, int]
) -> None:
    house = House(on_error=on_error)
    house.give(b'mine', header_list=MINE)
    if on_error == 'stop':
        with pytest.raises(RouteError, match='it came from /orders by this bridge') as failed:
            house.steps()
        assert failed.value.final
    else:
        house.steps()
    counts = house.pipeline.counters.snapshot(0)
    assert {name: getattr(counts, name) for name in ended} == ended
    assert house.sink.published == []
    assert house.letters.records == []


def test_when_a_reader_goes_the_unconfirmed_are_published_again_in_order() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a', b'b', b'c')
    house.sink.acknowledge(1)
    house.steps(1)
    house.sink.lose_reader()
    house.steps()
    assert house.sink.published[3:] == [b'cdr:b', b'cdr:c']
    assert house.positions() == {0: 1}
    assert house.pipeline.counters.repeated == 2
    house.sink.acknowledging = True
    house.steps()
    assert house.positions() == {0: 3}


def test_without_enough_subscribers_nothing_is_published() -> None:
    house = House(min_subscribers=2)
    house.take(b'a')
    assert house.sink.published == []
    house.sink.matched = 2
    house.steps()
    assert house.sink.published == [b'cdr:a']


def test_min_subscribers_0_publishes_to_nobody() -> None:
    house = House(MemoryMessageSink(matched=0), min_subscribers=0)
    house.take(b'a')
    assert house.sink.published == [b'cdr:a']


def test_guarantee_6c_what_nothing_confirms_is_published_and_its_offset_follows() -> None:
    house = House(MemoryMessageSink(tells=False))
    house.take(b'a', b'bad', b'ccc')
    assert house.positions() == {0: 3}
    house.sink.tells = True
    house.take(b'd', first=3)
    counters, meter = house.pipeline.counters.snapshot(0), house.pipeline._meter
    assert (counters.published, counters.confirmed, counters.dead_lettered) == (2, 1, 1)
    assert counters.carried == 3
    assert (meter.bytes_published, meter.bytes_confirmed, meter.bytes_taken) == (4, 1, 8)
    assert sum(meter.in_bridge.distribution().counts) == 1, 'the time to a confirmation'


@pytest.mark.parametrize(('reaction', 'out'), [('wait', 0), ('publish', 1)])
def test_what_would_be_misread_waits_or_not_as_the_route_says(reaction: str, out: int) -> None:
    house = House(MemoryMessageSink(misread='/old would misread it'), when_misread=reaction)
    house.take(b'a')
    assert len(house.sink.published) == out
    house.sink.misread = ''
    house.steps()
    assert house.sink.published == [b'cdr:a']


def test_old_records_are_dropped_and_counted_where_the_route_says_so() -> None:
    house = House(max_age_s=60)
    now_ms = int(time.time() * 1000)
    house.give(b'old', time_ms=now_ms - 61_000)
    house.give(b'new', first=1, time_ms=now_ms)
    house.take(b'no time', first=2)
    assert house.sink.published == [b'cdr:new', b'cdr:no time']
    assert house.pipeline.counters.snapshot(0).dropped == 1
    assert house.positions() == {0: 3}


def test_the_first_record_does_not_wait_for_readers_that_have_long_been_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(readiness, 'SETTLE_S', 0.05)
    house = House(MemoryMessageSink(acknowledging=False))
    house.steps(1)
    time.sleep(0.06)
    house.take(b'a', steps=1)
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
    monkeypatch.setattr(readiness, 'SETTLE_S', 0.05)
    house = House()
    house.give(b'a')
    house.rests(1)
    time.sleep(0.06)
    house.steps(1)
    assert house.sink.published == [b'cdr:a']


def test_a_reader_that_took_the_place_of_another_gets_time_to_know_of_the_match(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a')
    monkeypatch.setattr(readiness, 'SETTLE_S', 60.0)
    house.sink.lose_reader()
    house.steps()
    assert house.sink.published == [b'cdr:a']
    monkeypatch.setattr(readiness, 'SETTLE_S', 0.0)
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
        patch.setattr(readiness, 'SETTLE_S', 0.0)
        patch.setattr(time, 'sleep', lambda _: None)
        house = House(drain_s=0.005, max_age_s=60, skip_own=True)
        house.sink.matched = 0
        house.sink.acknowledging = house.letters.answering = False
        good: dict[int, bytes] = {}
        for event in events:
            offset = len(house.source.waiting) + house.pipeline.counters.taken
            if event == 'good':
                good[offset] = b'cdr:%d' % offset
                house.give(b'%d' % offset, first=offset)
            elif event == 'bad':
                house.give(b'bad %d' % offset, first=offset)
            elif event == 'mine':
                house.give(b'm', first=offset, header_list=MINE)
            elif event == 'old':
                house.give(b'o', first=offset, time_ms=IN_2001_MS)
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
        house.stop()
        committed = house.source.committed.get(0, 0)
        assert {b for o, b in good.items() if o < committed} <= set(house.sink.published)
        assert house.pipeline.snapshot.balanced
        confirmed = house.pipeline.snapshot.confirmed
        assert sum(o < committed for o in good) <= confirmed


# Pause


def test_a_paused_route_publishes_nothing_and_confirms_what_is_in_flight() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a', b'b')
    house.pause.asked = True
    house.give(b'c', first=2)
    house.rests()
    assert house.source.held
    assert house.pipeline.snapshot.state == 'paused'
    assert house.pipeline.snapshot.reason == 'paused by an operator'
    house.sink.acknowledging = True
    house.rests()
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert house.positions() == {0: 2}
    house.pause.asked = False
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c']
    assert house.pipeline.snapshot.state == 'running'


def test_what_was_read_and_not_published_waits_in_its_order_for_the_end_of_a_pause() -> None:
    house = House(MemoryMessageSink(room=1, acknowledging=False))
    house.take(b'a', b'b', b'c', steps=3)
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
    house.pipeline.run(stop, Pause(asked=True))
    assert house.sink.published == []
    assert house.pipeline.snapshot.state == 'stopped'
    assert house.pipeline.snapshot.balanced
