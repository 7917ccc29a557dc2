"""Readers that a writer knows of before they know of the writer."""

from types import SimpleNamespace

import pytest
from hypothesis import given, settings, strategies

from ros2_kafka_bridge.endpoints import Readers
from ros2_kafka_bridge.route import readiness
from ros2_kafka_bridge.route.readiness import FOREIGN_SETTLE_S, SETTLE_S, SubscriberReadiness


class Topic:
    """Readers that come and go, as a sink tells of them.

    Args:
        needed: How many are waited for.
    """

    def __init__(self, needed: int) -> None:
        self.now_s = 100.0
        self.there: list[float] = []  # when each one came
        self.come = 0
        self.lost = False
        self.misread = ''
        self.foreign = False
        self.lost_with: list[float] = []  # those that were there when the last loss was told
        self.readiness = SubscriberReadiness(needed)

    def enter(self) -> None:
        self.there.append(self.now_s)
        self.come += 1

    def settle(self, readers: int = 1) -> None:
        """So many come, are seen, and are there for long enough."""
        for _ in range(readers):
            self.enter()
        self.look()
        self.now_s += SETTLE_S

    def leave(self, number: int) -> None:
        del self.there[number]
        self.lost = True

    def look(self) -> str | None:
        readers = Readers(
            len(self.there), self.come, lost=self.lost, confirmed=0, acknowledged=True,
            misread=self.misread, foreign=self.foreign,
        )  # fmt: skip
        self.readiness.look(readers)
        if self.lost:
            self.lost_with = list(self.there)
        self.lost = False
        obstacle = self.readiness.obstacle
        return None if obstacle is None else obstacle.reason

    def has_to_wait(self) -> bool:
        """Whether a reader is waited for, and for no longer than one that has just come."""
        waits = self.look() is not None
        self.now_s += SETTLE_S
        return waits and self.look() is None

    def knows(self, came_s: float) -> bool:
        return came_s + SETTLE_S <= self.now_s


@pytest.fixture
def topic(monkeypatch: pytest.MonkeyPatch) -> Topic:
    made = Topic(1)
    monkeypatch.setattr(readiness, 'time', SimpleNamespace(monotonic=lambda: made.now_s))
    return made


def test_a_reader_of_another_vendor_has_to_have_been_there_for_longer(topic: Topic) -> None:
    topic.enter()
    topic.foreign = True
    assert topic.look() is not None
    for until_s, knows in ((SETTLE_S, False), (FOREIGN_SETTLE_S - 0.01, False), (3.0, True)):
        topic.now_s = 100.0 + until_s
        assert (topic.look() is None) == knows, until_s


def test_a_reader_counts_once_it_has_been_there_for_a_while(topic: Topic) -> None:
    assert topic.look() == '0 of 1 subscribers are there'
    topic.enter()
    assert topic.look() == 'a subscriber has come just now, and may not know of the bridge yet'
    topic.now_s += SETTLE_S - 0.01
    assert topic.look() is not None
    topic.now_s += 0.01
    assert topic.look() is None


@pytest.mark.parametrize('needed', [0, 1])
def test_nothing_is_published_while_a_reader_would_misread_it(
    monkeypatch: pytest.MonkeyPatch, needed: int
) -> None:
    topic = Topic(needed)
    monkeypatch.setattr(readiness, 'time', SimpleNamespace(monotonic=lambda: topic.now_s))
    topic.settle()
    assert topic.look() is None
    topic.enter()
    topic.misread = '/picker would misread it'
    assert topic.look() == '/picker would misread it'
    topic.misread = ''
    assert topic.look() is None


def test_it_is_published_all_the_same_where_the_route_says_so() -> None:
    lenient = SubscriberReadiness(0, may_misread=True)
    lenient.look(
        Readers(
            1, 1, lost=False, confirmed=0, acknowledged=True, misread='/picker would misread it'
        )
    )
    assert lenient.obstacle is None


def test_one_that_leaves_does_not_make_those_wait_that_have_long_been_there(topic: Topic) -> None:
    topic.settle(2)
    topic.leave(0)
    assert topic.look() is None


def test_one_that_comes_does_not_make_those_wait_that_have_long_been_there(topic: Topic) -> None:
    topic.settle()
    topic.enter()
    assert topic.look() is None


def test_one_that_has_taken_the_place_of_another_between_two_looks_counts_as_new(
    topic: Topic,
) -> None:
    topic.settle()
    topic.leave(0)
    topic.enter()
    assert topic.has_to_wait()


def test_one_that_came_in_the_place_of_another_gets_what_is_published_again(topic: Topic) -> None:
    topic.settle(2)
    topic.enter()  # beside one that was killed, and is matched until its lease ends
    assert topic.look() is None
    topic.now_s += 0.3
    topic.leave(0)
    assert topic.has_to_wait()


def test_the_one_that_is_left_may_be_the_one_that_came_last(topic: Topic) -> None:
    topic.settle()
    topic.enter()
    topic.look()
    topic.now_s += 0.1
    topic.leave(0)
    assert topic.has_to_wait()


def test_nobody_is_waited_for_where_none_is_needed() -> None:
    assert SubscriberReadiness(0).obstacle is None


EVENTS = strategies.lists(
    strategies.tuples(
        strategies.sampled_from(['enter', 'leave first', 'leave last', 'a moment', 'a while']),
        strategies.booleans(),  # whether the sink is looked at behind it
    ),
    min_size=4,
    max_size=20,
)


@settings(max_examples=500)
@given(strategies.integers(1, 2), EVENTS)
def test_guarantee_1_nothing_is_published_before_enough_readers_know_of_their_match(
    needed: int, events: list[tuple[str, bool]]
) -> None:
    topic = Topic(needed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(readiness, 'time', SimpleNamespace(monotonic=lambda: topic.now_s))
        for event, is_seen in events:
            if event == 'enter':
                topic.enter()
            elif event == 'a moment':
                topic.now_s += 0.3 * SETTLE_S
            elif event == 'a while':
                topic.now_s += SETTLE_S
            elif topic.there:
                topic.leave(0 if event == 'leave first' else -1)
            if is_seen and topic.look() is None:
                assert sum(map(topic.knows, topic.there)) >= needed
                # What is published again after a loss is for all that were there then.
                assert all(map(topic.knows, topic.lost_with))
        topic.look()
        topic.now_s += SETTLE_S
        assert (topic.look() is None) == (len(topic.there) >= needed)
