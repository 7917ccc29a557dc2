"""Where partitions stand: what may be committed, and what a loss leaves."""

from collections.abc import Callable
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError
from hypothesis import given, strategies
from support.kafka.source_stubs import NO_IDS

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.partition import Committed
from ros2_kafka_bridge.kafka.topic_id import TopicId
from ros2_kafka_bridge.testing.memory import MemoryRecord

HERE = frozenset({0, 1})

Make = Callable[..., KafkaSource]
"""Makes a source whose client reads what is given."""


def having(*numbers: int) -> Offsets:
    offsets = Offsets('t', MagicMock())
    offsets.assign(numbers)
    return offsets


def records(*offsets: int, partition: int = 0) -> list[MemoryRecord]:
    return [MemoryRecord(b'', offset, partition) for offset in offsets]


def test_the_first_record_is_the_first_position_and_no_position_is_known_before() -> None:
    offsets = having(0, 1)
    assert offsets.positions == {}
    offsets.hand_out([*records(7, 8), *records(3, partition=1), *records(12)])
    assert offsets.positions == {0: 7, 1: 3}


def test_what_was_deleted_before_it_was_read_is_not_passed_over_until_it_was_counted() -> None:
    """The reading may fail of another partition first; the next run meets the gap again."""
    offsets = having(0)
    offsets.note_committed({0: 2})
    offsets[0].wanted = 2
    offsets.hand_out(records(5, 6))
    assert (offsets.uncommitted, offsets.positions) == ({}, {0: 2})
    offsets[0].wanted = None
    offsets.advance({0: 6})
    assert offsets.uncommitted == {0: 6}


def test_guarantee_1_an_end_is_passed_only_when_all_before_it_have_ended() -> None:
    offsets = having(0)
    offsets.hand_out(records(4, 5))
    offsets.reach_end(0, 9)
    offsets.advance({0: 5})
    assert offsets.positions == {0: 5}
    offsets.advance({0: 6})
    assert offsets.positions == {0: 9}
    offsets.hand_out(records(9))
    assert offsets.positions == {0: 9}


def test_an_end_before_which_no_record_was_is_passed_and_the_group_is_told() -> None:
    """Marks and aborted records at the end of a partition are no lag for ever."""
    offsets = having(0)
    offsets.reach_end(0, 111)
    assert offsets.uncommitted == {0: 111}
    offsets.note_committed({0: 111})
    offsets.hand_out(records(111))
    offsets.reach_end(0, 112)
    assert offsets.uncommitted == {}, 'that record has not ended'


def test_an_end_that_comes_later_is_passed_at_once() -> None:
    offsets = having(0)
    offsets.hand_out(records(4))
    offsets.advance({0: 5})
    offsets.reach_end(0, 6)
    assert offsets.positions == {0: 6}


@given(strategies.lists(strategies.sampled_from(['read', 'mark', 'end', 'settle', 'commit'])))
def test_guarantee_1_a_position_is_never_behind_a_record_that_has_not_ended(
    events: list[str],
) -> None:
    offsets = having(0)
    offset, in_flight = 0, list[int]()
    for event in events:
        if event == 'read':
            offsets.hand_out(records(offset))
            in_flight.append(offset)
            offset += 1
        elif event == 'mark':
            offset += 1
        elif event == 'end':
            offsets.reach_end(0, offset)
        elif event == 'settle' and in_flight:
            offsets.advance({0: in_flight.pop(0) + 1})
        elif event == 'commit':
            offsets.note_committed(offsets.uncommitted)
            assert offsets.uncommitted == {}
        if in_flight:
            assert offsets.positions[0] <= in_flight[0]
        elif event == 'end':
            assert offsets.positions.get(0, offset) == offset


def test_of_a_topic_made_anew_nothing_is_known_but_which_it_is() -> None:
    offsets = having(0)
    offsets.hand_out(records(99))
    offsets.advance({0: 100})
    offsets.note_committed({0: 100})
    client = MagicMock()
    offsets.use(client)
    offsets.begin_anew(ANOTHER)
    _, [place] = client.commit.call_args.args
    assert (place.partition, place.offset, place.metadata) == (0, 0, ANOTHER.metadata)
    assert len(offsets) == 0
    offsets.assign({0})
    offsets.hand_out(records(3))
    assert offsets.uncommitted == {0: 3}


def test_an_end_is_passed_where_nothing_was_read_since_a_loss() -> None:
    offsets = having(0)
    offsets.advance({0: 5})
    offsets.reach_end(0, 7)
    assert offsets.positions == {0: 7}


def test_what_is_heard_of_partitions_that_others_have_counts_for_nothing() -> None:
    offsets = having(0)
    offsets.forget({0})
    offsets.advance({0: 3})
    offsets.note_committed({0: 3})
    offsets.reach_end(0, 4)
    offsets.hand_out(records(1))
    assert (offsets.positions, offsets.reached, len(offsets)) == ({}, {}, 0)


def test_a_loss_leaves_how_far_the_route_had_come_and_only_once() -> None:
    offsets = having(0, 1)
    offsets.hand_out(records(4))
    offsets.note_committed({0: 4})
    offsets.advance({0: 5})
    offsets.lose({0, 1})
    assert (len(offsets), offsets.are_lost, offsets.owe_lost) == (0, True, True)
    offsets.assign({0, 1})
    told = {0: Committed(4, None), 1: Committed(0, None)}
    assert offsets.resume({0, 1}, told) == offsets.positions == {0: 5}
    assert not offsets.are_lost
    assert offsets.resume({0, 1}, told) == {}


ANOTHER = TopicId('cluster', 'another')


@pytest.mark.parametrize(('offset', 'now'), [(3, None), (5, None), (4, ANOTHER)])
def test_a_loss_is_forgotten_where_others_have_committed_or_the_topic_is_another(
    offset: int, now: TopicId | None
) -> None:
    offsets = having(0)
    offsets.hand_out(records(4))
    offsets.note_committed({0: 4})
    offsets.advance({0: 5})
    offsets.lose({0})
    offsets.assign({0})
    offsets[0].of = now
    assert offsets.resume({0}, {0: Committed(offset, None)}) == offsets.positions == {}
    assert not offsets.are_lost


def test_what_is_committed_says_of_which_topic_it_is() -> None:
    offsets = having(0, 1)
    assert offsets.metadata(0) == ''
    offsets[0].of, offsets[1].of = TopicId('cluster', 'old'), ANOTHER
    for number, of in ((0, offsets[0].of), (1, ANOTHER), (7, offsets[0].of)):
        assert TopicId.of_metadata(offsets.metadata(number)) == of
    offsets.begin_at(1, 3)
    assert (offsets[1].of, offsets.uncommitted) == (ANOTHER, {1: 3})


def test_what_was_lost_with_all_committed_is_owed_to_nobody() -> None:
    """As where Kafka is away for longer than the session, at a stop: nothing is repeated."""
    offsets = having(0, 1)
    offsets.hand_out(records(4))
    offsets.advance({0: 5})
    offsets.note_committed({0: 5})
    offsets.lose({0, 1})
    assert (offsets.are_lost, offsets.owe_lost) == (True, False)


def told(code: int, offset: int, partition: int = 0) -> MagicMock:
    message = MagicMock()
    message.error.return_value = KafkaError(code)
    message.partition.return_value, message.offset.return_value = partition, offset
    return message


class _Record(MemoryRecord):
    def error(self) -> None:
        pass


@pytest.fixture
def source(monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes a source whose client reads what is given, with the partitions 0 and 1."""

    def make(*batch: Any) -> KafkaSource:
        client = MagicMock()
        client.poll.return_value, client.consume.return_value = batch[0], list(batch[1:])
        monkeypatch.setattr(group_client, 'Consumer', lambda *_, **__: client)
        made = KafkaSource({'group.id': 'g'}, 't', 'earliest', NO_IDS, MagicMock())
        made.open(MagicMock())
        made._offsets.assign(HERE)
        return made

    return make


def test_an_end_behind_records_of_the_same_batch_commits_none_of_them(source: Make) -> None:
    reads = source(_Record(b'', 3), _Record(b'', 4), told(KafkaError._PARTITION_EOF, 6))
    assert len(reads.poll(10, 0.0)) == 2
    assert reads._offsets.positions == {0: 3}
    reads.advance({0: 5})
    assert reads._offsets.positions == {0: 6}


def test_what_was_handed_over_in_the_middle_of_a_batch_is_not_given_to_the_route(
    source: Make,
) -> None:
    reads = source(_Record(b'mine no more', 3, 0))

    def handed_over(*_: object) -> list[object]:
        reads._offsets.forget({0})
        return [_Record(b'mine', 7, 1)]

    reads._member.consumer.consume = handed_over  # type: ignore[method-assign, assignment]
    assert [record.value() for record in reads.poll(10, 0.0)] == [b'mine']
    assert reads._offsets.positions == {1: 7}


def test_what_was_read_before_a_partition_was_lost_and_given_back_counts_for_nothing(
    source: Make,
) -> None:
    """The client calls back in the middle of a read, behind the first that it has told."""
    reads = source(told(KafkaError._PARTITION_EOF, 100))

    def lost_and_back(*_: object) -> list[object]:
        reads._offsets.lose({0})
        reads._offsets.assign({0})
        reads._offsets.advance({0: 50})
        return []

    reads._member.consumer.consume = lost_and_back  # type: ignore[method-assign, assignment]
    assert reads.poll(10, 0.0) == []
    assert reads._offsets.positions == {0: 50}


def test_how_far_a_reader_is_behind_is_not_known_without_a_place_in_its_group(
    source: Make,
) -> None:
    reads = source(told(KafkaError._PARTITION_EOF, 100))
    watchdog = reads._member._watchdog
    watchdog.begin()
    assert reads.lag() is None
    watchdog.on_assign()
    reads._offsets.clear()
    assert reads.lag() == 0, 'it has none of the partitions'
    watchdog.on_lost()
    assert reads.lag() is None
    assert reads.answers is None, 'nothing was heard'
    watchdog.is_there = False
    assert reads.answers is False


def test_an_end_of_which_the_offset_is_not_told_is_not_the_beginning(source: Make) -> None:
    end = told(KafkaError._PARTITION_EOF, 0)
    end.offset.return_value = None
    reads = source(end)
    reads.poll(10, 0.0)
    assert reads._offsets.uncommitted == {}


def test_an_error_that_names_no_partition_of_its_own_counts(source: Make) -> None:
    reads = source(told(KafkaError._ALL_BROKERS_DOWN, -1, -1))
    assert reads.poll(10, 0.0) == []
    assert 'Kafka is away' in reads.away


def test_the_lag_is_not_known_while_kafka_is_away(source: Make) -> None:
    """What its client was told before may be hours old."""
    reads = source(told(KafkaError._PARTITION_EOF, 100))
    reads._member._watchdog.on_assign()
    reads.poll(10, 0.0)
    reads.poll(10, 0.0)
    reads._offsets.forget({1})
    reads._member.consumer.get_watermark_offsets.return_value = (0, 120)  # type: ignore[attr-defined]
    assert reads.lag() == 20
    reads._health.on_error(KafkaError(KafkaError._ALL_BROKERS_DOWN))
    assert (reads.lag(), reads.answers) == (None, False)


def test_a_client_that_a_quota_lets_wait_says_so_and_is_not_taken_for_a_stuck_one(
    source: Make,
) -> None:
    reads = source(None)
    member = reads._member
    member._watchdog.on_assign()
    looks = MagicMock()
    member._watchdog.look_whether_stuck = looks  # type: ignore[method-assign]
    reads.poll(10, 0.0)
    looks.assert_called_once()
    member._held_back.on_throttle(30.0)
    reads.poll(10, 0.0)
    looks.assert_called_once()
    assert 'a quota of the broker' in reads.held_back
    assert reads.away == '', 'no error: Kafka is there'
    assert reads.answers is not False, 'Kafka is there'
    assert reads.lag() is None, 'what its client was told last may be old'
    reads.stay()
    assert reads.held_back == '', 'nothing is asked for meanwhile'


def test_a_report_of_a_broker_that_is_there_brings_kafka_back(source: Make) -> None:
    reads = source(None)
    reads._health.on_error(KafkaError(KafkaError._ALL_BROKERS_DOWN))
    report = reads._member.client._on_statistics
    report('{"brokers": {"x": {"source": "configured", "state": "UP"}}}')
    assert (bool(reads.away), reads.answers) == (True, False)
    report('{"brokers": {"x": {"nodeid": 1, "state": "UP"}}}')
    assert (bool(reads.away), reads.answers) == (False, True)
