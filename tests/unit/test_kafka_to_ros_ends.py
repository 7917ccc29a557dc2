"""How the pipeline Kafka -> ROS hands over, drains and fails, driven step by step."""

import time
from collections.abc import Sequence
from typing import Any

import pytest
from support.worlds.pipeline_to_ros import IN_2001_MS, MINE, House

from ros2_kafka_bridge import kafka_to_ros
from ros2_kafka_bridge.endpoints import Record, Reports
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.testing.memory import MemoryMessageSink, MemoryRecord, MemoryRecordSource

pytestmark = pytest.mark.usefixtures('no_settle_time')


@pytest.mark.parametrize('how', ['revoke', 'lose'])
def test_guarantee_1_a_hand_over_ends_also_where_the_readers_cannot_be_asked(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a', b'b')

    def fail() -> None:
        raise RouteError('publisher of /orders: no')

    monkeypatch.setattr(house.sink, 'readers', fail)
    getattr(house.source, how)(frozenset({0}))
    house.check_balance()
    assert house.pipeline.counters.snapshot(0).returned == 2
    assert house.positions() == {}
    with pytest.raises(RouteError, match='publisher of /orders: no'):
        house.steps()


def test_what_was_confirmed_of_a_partition_that_is_lost_is_told_before_it_goes() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.give(b'a', b'b', b'c')
    house.take(b'd', partition=1)
    house.sink.acknowledge(2)
    house.pipeline.lost(frozenset({0}))
    assert house.source.positions == {0: 2, 1: 0}
    house.check_balance()


@pytest.mark.parametrize(
    ('settings', 'value'), [({}, b'away'), ({'on_error': 'stop'}, b'bad')], ids=['away', 'stop']
)
@pytest.mark.parametrize('other', [0, 1])
def test_a_route_goes_on_where_what_was_to_end_it_is_handed_over(
    settings: dict[str, Any], value: bytes, other: int
) -> None:
    """Whoever reads that partition next finds out by itself."""
    house = House(MemoryMessageSink(acknowledging=False), **settings)
    house.give(b'a', partition=other)
    house.take(value, first=1, steps=2)
    house.source.lose(frozenset({0}))
    house.sink.acknowledging = True
    house.take(b'c', b'd')
    assert house.sink.published == [b'cdr:a', b'cdr:c', b'cdr:d']
    assert house.positions()[0] == 2


def test_revoked_partitions_are_committed_and_the_rest_is_given_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kafka_to_ros, 'REVOKE_S', 0.05)
    house = House(MemoryMessageSink(acknowledging=False))
    house.give(b'a', b'b', partition=0)
    house.take(b'x', b'y', partition=1)
    house.sink.acknowledge(3)
    house.source.revoke(frozenset({1}))
    assert house.source.committed == {0: 2, 1: 1}
    assert house.positions() == {0: 2}
    assert house.pipeline.counters.snapshot(0).returned == 1
    house.check_balance()
    house.sink.acknowledging = True
    house.take(b'c', partition=0, first=2)
    assert house.positions() == {0: 3}


def test_lost_partitions_are_not_committed() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a')
    house.source.lose(frozenset({0}))
    assert house.positions() == {}
    assert house.pipeline.counters.snapshot(0).returned == 1


def test_a_drain_confirms_what_is_in_flight_and_gives_back_what_was_not_published() -> None:
    house = House(MemoryMessageSink(acknowledging=False, room=2), drain_s=1)
    house.take(b'a', b'b', b'c')
    house.sink.acknowledging = True
    house.stop()
    assert house.source.committed == {0: 2}
    snapshot = house.pipeline.snapshot
    assert snapshot.balanced
    assert (snapshot.confirmed, snapshot.returned, snapshot.in_flight) == (2, 1, 0)


def test_a_drain_skips_nothing_that_it_has_given_back_behind_an_end_that_was_reached() -> None:
    house = House(MemoryMessageSink(acknowledging=False, room=1), drain_s=1)
    house.give(b'a', b'b', b'c')
    house.give(b'x', partition=1)
    house.source.ends |= {0: 3, 1: 2}  # a mark of a transaction comes behind the last one
    house.steps()
    house.sink.acknowledging = True
    house.stop()
    assert house.sink.published == [b'cdr:a']
    assert house.source.committed.get(0) == 1
    assert house.source.committed.get(1, 0) == 0


def test_a_long_drain_stays_in_the_group_and_commits_as_it_goes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(MemoryMessageSink(acknowledging=False), drain_s=0.6)
    house.take(b'a', b'b')
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
    house.stop()
    assert before_the_end[0] == {0: 1}
    assert len(holds) > 2
    assert holds[-1] - holds[0] > 0.3


def test_guarantee_7_a_drain_waits_for_what_is_in_flight_also_where_kafka_fails_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(MemoryMessageSink(acknowledging=False), drain_s=5)
    house.take(b'a', b'b')

    def stay() -> tuple[()]:
        house.sink.acknowledging = True  # a moment later
        raise RouteError('topic orders: shut out')

    monkeypatch.setattr(house.source, 'stay', stay)
    house.stop()
    assert house.confirmed() == 2
    assert house.source.committed == {0: 2}
    assert 'topic orders: shut out' in caplog.messages


def test_what_still_comes_in_a_drain_is_given_back_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    house = House(MemoryMessageSink(acknowledging=False), drain_s=5)
    house.take(b'a')
    late = [[MemoryRecord(b'bad', 1)], [MemoryRecord(b'x', 0, 1), MemoryRecord(b'away', 2)]]

    def stay() -> Sequence[Record]:
        house.source.ends |= {0: 3, 1: 1}
        house.sink.acknowledging = not late
        house.source.waiting.extend(late.pop(0) if late else [])
        return house.source.hand_out(500)

    monkeypatch.setattr(house.source, 'stay', stay)
    house.stop()
    assert late == []
    assert house.sink.published == [b'cdr:a']
    assert house.letters.records == []
    assert house.source.committed == {0: 1, 1: 0}
    snapshot = house.pipeline.snapshot
    assert snapshot.balanced
    assert (snapshot.taken, snapshot.confirmed, snapshot.returned) == (4, 1, 3)


def test_after_a_failure_the_same_records_come_again_and_the_count_still_balances() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a', b'b')
    with pytest.raises(RouteError), house.pipeline._opened():
        raise RouteError('no permission')
    house.check_balance()
    house.sink.acknowledging = True
    house.source.open(house.pipeline)
    house.take(b'a', b'b')
    assert house.positions() == {0: 2}
    assert house.confirmed() == 2


@pytest.mark.parametrize('between', ['dead letter', 'skipped', 'too old'])
def test_a_drain_commits_nothing_behind_a_record_that_was_not_published(between: str) -> None:
    house = House(MemoryMessageSink(matched=0), drain_s=0.1, max_age_s=60, skip_own=True)
    house.give(b'a', b'b')
    if between == 'dead letter':
        house.give(b'bad', first=2)
    elif between == 'skipped':
        house.give(b'mine', first=2, header_list=MINE)
    else:
        house.give(b'old', first=2, time_ms=IN_2001_MS)
    house.take(b'c', first=3)
    house.stop()
    assert house.source.committed.get(0, 0) == 0
    assert house.pipeline.snapshot.balanced


def test_what_was_taken_of_a_topic_that_is_gone_still_goes_out_and_moves_no_position() -> None:
    house = House(MemoryMessageSink(matched=0))
    house.give(b'a', b'b')
    house.take(b'c', partition=1)
    house.source.make_anew(frozenset({0, 1}))
    house.give(b'new', b'last')
    house.sink.matched = 1
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b', b'cdr:c', b'cdr:new', b'cdr:last']
    assert house.positions() == {0: 2}
    assert house.confirmed() == 5


def test_what_was_taken_of_a_topic_that_is_gone_is_given_up_at_a_stop(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Nobody can read it again: what was published of it is waited for, as always."""
    house = House(MemoryMessageSink(acknowledging=False), drain_s=0.1)
    house.take(b'published')
    house.sink.room = 0
    house.take(b'a', b'b', first=1)
    house.source.make_anew(frozenset({0}))
    house.sink.acknowledge(1)
    house.stop()
    snapshot = house.pipeline.snapshot
    assert (snapshot.confirmed, snapshot.given_up, snapshot.returned) == (1, 2, 0)
    assert snapshot.balanced
    assert '2 records of a topic that is gone: given up' in caplog.text
    assert house.source.committed == {0: 0}


def test_what_has_ended_of_a_topic_that_is_gone_is_not_given_up() -> None:
    house = House(MemoryMessageSink(acknowledging=False), drain_s=0.1)
    house.take(b'a', b'bad', b'b')
    house.source.make_anew(frozenset({0}))
    with pytest.raises(RouteError), house.pipeline._opened():
        raise RouteError('no permission')
    snapshot = house.pipeline.counters.snapshot(0)
    assert (snapshot.dead_lettered, snapshot.given_up) == (1, 2)
    assert snapshot.balanced


def test_what_is_dropped_of_a_topic_that_is_gone_moves_no_position_and_holds_back_none() -> None:
    house = House(MemoryMessageSink(matched=0), when_full='drop_oldest', max_in_flight=2)
    house.take(*(b'old' for _ in range(4)))
    house.source.make_anew(frozenset({0}))
    house.take(*(b'%d' % number for number in range(6)), steps=20)
    house.sink.matched = 1
    house.steps()
    assert house.sink.published == [b'cdr:4', b'cdr:5']
    assert house.positions() == {0: 6}
    assert house.pipeline.counters.snapshot(0).balanced


def test_a_hand_over_does_not_wait_for_what_is_of_a_topic_that_is_gone() -> None:
    house = House(MemoryMessageSink(acknowledging=False))
    house.take(b'a')
    house.source.make_anew(frozenset({0}))
    began_s = time.monotonic()
    house.pipeline.revoked(frozenset({0}))
    assert time.monotonic() - began_s < kafka_to_ros.REVOKE_S / 2
    house.sink.acknowledging = True
    house.steps()
    assert house.confirmed() == 1


def test_a_partition_that_comes_back_is_committed_anew() -> None:
    house = House()
    for _ in range(2):
        house.take(b'a', b'b')
        assert house.positions() == {0: 2}
        house.source.lose(frozenset({0}))


def test_a_run_commits_anew_what_it_reads_again() -> None:
    house = House()
    for _ in range(2):
        with house.pipeline._opened():
            house.take(b'a', b'b')
            assert house.positions() == {0: 2}


def test_a_drain_waits_for_a_dead_letter() -> None:
    house = House()
    house.letters.room = 0
    house.take(b'bad')
    poll = house.letters.poll

    def answer(timeout_s: float) -> Reports[Any]:
        house.letters.room = 1
        return poll(timeout_s)

    house.letters.poll = answer  # type: ignore[method-assign]
    house.stop()
    assert house.source.committed == {0: 1}


def test_a_drain_gives_back_what_is_behind_a_record_that_waits() -> None:
    house = House(MemoryMessageSink(room=0))
    house.letters.answering = False
    house.take(b'a', b'bad')
    house.letters.answering = True
    house.stop()
    assert house.source.committed.get(0, 0) == 0
    assert house.pipeline.counters.snapshot(0).returned == 2


def test_a_letter_of_a_record_that_was_given_back_is_not_sent_again() -> None:
    house = House()
    house.letters.errors[b'bad'] = [TransportError('timed out')]
    house.letters.answering = False
    house.take(b'bad')
    house.source.lose(frozenset({0}))
    house.letters.answering = True
    house.steps()
    assert house.letters.records == []
    assert house.pipeline.counters.snapshot(0).returned == 1
