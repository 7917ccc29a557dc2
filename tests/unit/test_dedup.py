"""Repeated records are told from new ones: checked against a plain set."""

import json
import random
from itertools import pairwise

import pytest
from confluent_kafka import Message
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.dedup import Deduplicator, Numbers, place_of, without_repeats
from ros2_kafka_bridge.endpoints import HeaderList

ROBOT, CAMERA = bytes(range(16)), bytes(range(16, 32))

seqs = st.integers(1, 60)
events = st.lists(st.tuples(st.sampled_from([ROBOT, CAMERA, b'third']), seqs), max_size=200)


def record(seq: int, gid: bytes = ROBOT) -> Message:
    told: HeaderList = [('ros.gid', gid.hex().encode()), ('ros.seq', b'%d' % seq)]
    return Message(value=b'%d' % seq, headers=told)


@given(events)
def test_a_number_is_new_once_in_whatever_order_they_come(found: list[tuple[bytes, int]]) -> None:
    dedup, plain = Deduplicator(), set()
    for one in found:
        assert dedup.is_new_number(*one) == (one not in plain)
        plain.add(one)


@given(st.lists(seqs, max_size=200))
def test_the_set_of_numbers_is_a_set_and_its_gaps_are_what_is_missing(found: list[int]) -> None:
    numbers, plain = Numbers(), set()
    for one in found:
        numbers.add(one)
        plain.add(one)
    assert [n for n in range(62) if n in numbers] == sorted(plain)
    assert numbers.first == min(plain, default=0)
    between = set(range(min(plain, default=0), max(plain, default=0))) - plain
    assert {n for gap in numbers.gaps() for n in gap} == between
    assert all(a.stop < b.start for a, b in pairwise(numbers.runs())), 'runs touch'


@given(events, st.integers(0, 200))
def test_a_restart_forgets_nothing(found: list[tuple[bytes, int]], at: int) -> None:
    dedup, plain = Deduplicator(), set(found[:at])
    for one in found[:at]:
        dedup.is_new_number(*one)
    again = Deduplicator.from_json(dedup.to_json())
    assert again.gaps() == dedup.gaps()
    for one in found[at:]:
        assert again.is_new_number(*one) == (one not in plain)
        plain.add(one)


@given(st.lists(seqs, max_size=200), st.integers(0, 3))
def test_at_its_limit_of_gaps_it_never_takes_a_new_one_for_a_repeat(
    found: list[int], max_gaps: int
) -> None:
    dedup, plain = Deduplicator(max_gaps=max_gaps), set()
    for one in found:
        new = dedup.is_new_number(ROBOT, one)
        assert new or one in plain
        plain.add(one)
        assert len(dedup.gaps().get(ROBOT, [])) <= max_gaps


def test_the_publisher_heard_least_recently_is_forgotten_first() -> None:
    dedup = Deduplicator(max_publishers=2)
    assert dedup.is_new_number(ROBOT, 1)
    assert dedup.is_new_number(CAMERA, 1)
    assert not dedup.is_new_number(ROBOT, 1)
    assert dedup.is_new_number(b'third', 1)
    assert not dedup.is_new_number(ROBOT, 1)
    assert dedup.is_new_number(CAMERA, 1), 'it was forgotten, and is new again'


def test_a_million_numbers_without_a_gap_take_no_memory() -> None:
    dedup = Deduplicator()
    for seq in range(1, 1_000_001):
        dedup.is_new_number(ROBOT, seq)
    assert len(dedup.to_json()) < 120


def test_records_are_filtered_one_by_one_in_their_order() -> None:
    found = without_repeats(record(seq) for seq in (1, 2, 2, 5, 1, 4, 5, 6))
    assert [one.value() for one in found] == [b'1', b'2', b'5', b'4', b'6']


def test_what_is_missing_is_told_until_it_comes_late() -> None:
    dedup = Deduplicator()
    list(dedup.without_repeats(record(seq) for seq in (3, 4, 8)))
    assert dedup.gaps() == {ROBOT: [range(5, 8)]}
    assert [dedup.is_new(record(seq)) for seq in (5, 6, 7, 6)] == [True, True, True, False]
    assert dedup.gaps() == {}


@pytest.mark.parametrize(
    'headers',
    [
        None,
        [],
        [('ros.gid', ROBOT.hex().encode())],
        [('ros.gid', b'\xff\x00'), ('ros.seq', b'1')],
        [('ros.gid', b'xyz'), ('ros.seq', b'1')],
        [('ros.gid', ROBOT.hex().encode()), ('ros.seq', b'one')],
        [('ros.gid', ROBOT.hex().encode()), ('ros.seq', None)],
    ],
)
def test_records_that_do_not_tell_their_place_pass_every_time(headers: HeaderList | None) -> None:
    other = Message(value=b'x', headers=headers)
    assert place_of(other) is None
    assert list(without_repeats([other, other])) == [other, other]


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        '{"version": 2, "publishers": []}',
        '{"version": 1}',
        json.dumps({'version': 1, 'publishers': [{'gid': 'no', 'seen': []}]}),
        json.dumps({'version': 1, 'publishers': [{'gid': '00', 'seen': [[5, 6], [1, 2]]}]}),
        json.dumps({'version': 1, 'publishers': [{'gid': '00', 'seen': [[5, 1]]}]}),
    ],
)
def test_a_state_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='not the state of a Deduplicator'):
        Deduplicator.from_json(text)


def test_two_streams_of_one_publisher_come_out_in_order_however_they_mix() -> None:
    """What two bridges write of one publisher while one takes over from the other."""
    mixed = random.Random(7)  # noqa: S311 (to be repeated)
    for _ in range(50):
        streams = [iter(range(1, 100)), iter(range(mixed.randint(1, 60), 101))]
        first = [next(streams[0]) for _ in range(60)]  # those before the other began
        written = list(first)
        while streams:
            stream = mixed.choice(streams)
            if (seq := next(stream, None)) is None:
                streams.remove(stream)
            else:
                written.append(seq)
        found = [int(one.value() or 0) for one in without_repeats(map(record, written))]
        assert found == list(range(1, 101))
