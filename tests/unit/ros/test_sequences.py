"""Which messages count when two subscriptions match one publisher."""

import logging

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ros2_kafka_bridge.endpoints import Message, Offer
from ros2_kafka_bridge.ros.sequences import Sequences

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
VOLATILE = Offer('reliable', 'volatile')
LATCHED = Offer('reliable', 'transient_local')
ONE, TWO = b'1' * 16, b'2' * 16


@pytest.fixture
def sequences() -> Sequences:
    return Sequences(LOG, '/orders')


def accepted(sequences: Sequences, gid: bytes, numbers: list[int], offer: Offer) -> list[int]:
    return [seq for seq in numbers if sequences.accept(gid, seq, offer)]


def test_no_message_counts_twice(sequences: Sequences) -> None:
    sequences.offers({ONE: VOLATILE})
    assert accepted(sequences, ONE, [1, 2, 2, 1, 3], VOLATILE) == [1, 2, 3]
    assert sequences.lost == 0


def test_a_gap_is_counted_once(sequences: Sequences) -> None:
    sequences.offers({ONE: VOLATILE})
    assert accepted(sequences, ONE, [1, 5, 6], VOLATILE) == [1, 5, 6]
    assert sequences.lost == 3


def test_what_came_before_the_first_message_is_no_gap_and_is_said(
    sequences: Sequences, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    sequences.offers({ONE: VOLATILE, TWO: VOLATILE})
    assert accepted(sequences, ONE, [7, 8], VOLATILE) == [7, 8]
    assert accepted(sequences, TWO, [1, 2], VOLATILE) == [1, 2]
    assert sequences.lost == 0
    [said] = caplog.records
    text = f'publisher {ONE.hex()} of /orders is read from its message number 7 on'
    assert said.message.startswith(text)
    assert 'none before it counts as lost' in said.message
    assert said.levelno == logging.INFO


def test_a_loss_of_ours_is_blamed_for_no_gap_behind_what_came_in_order(
    sequences: Sequences, caplog: pytest.LogCaptureFixture
) -> None:
    sequences.offers({ONE: VOLATILE})
    assert accepted(sequences, ONE, [1], VOLATILE) == [1]
    sequences.expect_loss(VOLATILE)
    assert accepted(sequences, ONE, [2, 9], VOLATILE) == [2, 9]
    [said] = caplog.messages
    assert 'could not read any more' not in said


def test_publishers_are_counted_apart(sequences: Sequences) -> None:
    sequences.offers({ONE: VOLATILE, TWO: VOLATILE})
    assert accepted(sequences, ONE, [1, 2], VOLATILE) == [1, 2]
    assert accepted(sequences, TWO, [1, 2], VOLATILE) == [1, 2]


def test_a_latched_history_comes_whole_though_another_subscription_saw_its_end(
    sequences: Sequences,
) -> None:
    sequences.offers({ONE: LATCHED})
    assert accepted(sequences, ONE, [4, 5], VOLATILE) == []
    assert accepted(sequences, ONE, [1, 2, 3, 4, 5], LATCHED) == [1, 2, 3, 4, 5]


def test_a_latched_publisher_seen_from_its_first_message_needs_no_other_subscription(
    sequences: Sequences,
) -> None:
    sequences.offers({ONE: LATCHED})
    assert accepted(sequences, ONE, [1, 2, 3], VOLATILE) == [1, 2, 3]
    assert accepted(sequences, ONE, [2, 3, 4], LATCHED) == [4]


def test_a_publisher_of_unknown_offer_is_heard(sequences: Sequences) -> None:
    assert accepted(sequences, ONE, [3, 4], VOLATILE) == [3, 4]


def test_a_publisher_that_comes_back_is_remembered(sequences: Sequences) -> None:
    sequences.offers({ONE: LATCHED})
    accepted(sequences, ONE, [1, 2], LATCHED)
    sequences.offers({})
    sequences.offers({ONE: LATCHED})
    assert accepted(sequences, ONE, [1, 2, 3], LATCHED) == [3]


def test_the_memory_of_publishers_that_have_gone_is_bounded(sequences: Sequences) -> None:
    for number in range(5000):
        gid = number.to_bytes(16, 'big')
        sequences.offers({gid: VOLATILE})
        sequences.accept(gid, 1, VOLATILE)
    assert len(sequences._publishers) < 1100


@given(
    before=st.lists(st.tuples(st.sampled_from([ONE, TWO]), st.integers(1, 12)), max_size=8),
    batch=st.lists(st.tuples(st.sampled_from([ONE, TWO]), st.integers(1, 14)), max_size=6),
    known=st.booleans(),
    loses=st.booleans(),
)
@example(before=[(ONE, 1)], batch=[(ONE, 2), (ONE, 3)], known=True, loses=True)
@example(before=[(ONE, 1)], batch=[(ONE, 2), (TWO, 3)], known=True, loses=False)
def test_guarantee_8_what_is_accepted_at_once_is_what_would_be_one_by_one(
    *, before: list[tuple[bytes, int]], batch: list[tuple[bytes, int]], known: bool, loses: bool
) -> None:
    at_once, one_by_one = Sequences(LOG, '/orders'), Sequences(LOG, '/orders')
    for sequences in (at_once, one_by_one):
        if known:
            sequences.offers({ONE: VOLATILE, TWO: LATCHED})
        for gid, seq in before:
            sequences.accept(gid, seq, VOLATILE)
        if loses:
            sequences.expect_loss(VOLATILE)
    messages = [Message(b'', gid, seq, 0) for gid, seq in batch]
    state = vars_of(at_once)
    if at_once.accept_all(messages):
        assert all(one_by_one.accept(gid, seq, VOLATILE) for gid, seq in batch)
        assert vars_of(at_once) == vars_of(one_by_one)
    else:
        assert vars_of(at_once) == state, 'nothing was noted'


def vars_of(sequences: Sequences) -> object:
    """All that it knows."""
    known = {gid: (one.offer, one.last, one.loses) for gid, one in sequences._publishers.items()}
    return known, sequences.lost


def test_what_follows_without_a_gap_is_accepted_at_once(sequences: Sequences) -> None:
    sequences.offers({ONE: VOLATILE})
    assert sequences.accept_all([Message(b'', ONE, seq, 0) for seq in (1, 2, 3)])
    assert not sequences.accept_all([Message(b'', ONE, seq, 0) for seq in (4, 6)])
    assert accepted(sequences, ONE, [3, 4], VOLATILE) == [4]
    assert sequences.accept_all([])
