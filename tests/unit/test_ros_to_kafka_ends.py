"""How the pipeline ROS -> Kafka drains and hands over, driven step by step."""

from typing import Any

import pytest
from support.worlds.pipeline_to_kafka import House

from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.threads.stop import Stop


def test_a_drain_takes_until_the_source_is_empty_and_waits_for_the_reports() -> None:
    house = House(max_in_flight=2)
    house.sink.close()
    house.give(b'a', b'b', b'c', b'd', b'e')
    house.stop()
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']
    assert house.pipeline.snapshot.in_flight == 0


def test_a_drain_that_runs_out_of_time_says_how_many_it_gave_up() -> None:
    house = House(drain_s=0.1)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b')
    with pytest.raises(RouteError, match='gave up 2 messages'):
        house.stop()
    assert house.pipeline.snapshot.balanced
    assert house.pipeline.snapshot.in_flight == 2
    assert house.source.closed, 'a publisher is held back by a reader that takes no more'


def test_guarantee_1_a_hand_over_waits_for_kafka_as_long_as_the_bridge_lives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What DDS has handed over is nowhere else: a slow Kafka is waited for, and not given up."""
    house = House(drain_s=0.0, max_in_flight=2)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b', b'c', b'd', b'e')
    stop, polls = Stop(), 0
    stop.ask(limited=False)  # as where another bridge goes on with the route, and this one lives
    poll = house.sink.poll

    def answer_late(timeout_s: float) -> Reports[Any]:
        nonlocal polls
        polls += 1
        house.sink.answering = polls > 20
        return poll(timeout_s)

    monkeypatch.setattr(house.sink, 'poll', answer_late)
    house.pipeline.run(stop)
    assert house.values() == [b'a', b'b', b'c', b'd', b'e']
    assert house.pipeline.snapshot.in_flight == 0


def test_guarantee_1_a_hand_over_ends_also_where_the_publishers_never_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The next bridge reads by then: what this one leaves, that one has."""
    monkeypatch.setattr('ros2_kafka_bridge.ros_to_kafka._REST_S', 0.3)
    house = House(max_in_flight=10)
    house.sink.close()
    stop, taken = Stop(), 0
    stop.ask(limited=False)

    def take(limit: int, timeout_s: float) -> list[Message]:
        nonlocal taken
        assert not house.source.closed, 'a reader that is idle holds the next bridge back'
        del timeout_s
        taken += limit
        house.give(b'more')  # it is never found empty
        return [Message(b'a', b'gid', taken + n, 0) for n in range(limit)]

    monkeypatch.setattr(house.source, 'take', take)
    house.pipeline.run(stop)
    assert taken > 100
    assert house.source.closed
    assert len(house.values()) == taken
    assert house.pipeline.snapshot.in_flight == 0


def test_a_hand_over_that_waits_for_kafka_ends_in_time_once_the_bridge_stops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(drain_s=0.1)
    house.sink.close()
    house.sink.answering = False
    house.give(b'a', b'b')
    stop, polls = Stop(), 0
    stop.ask(limited=False)  # as where another bridge goes on with the route, and this one lives
    poll = house.sink.poll

    def look(timeout_s: float) -> Reports[Any]:
        nonlocal polls
        polls += 1
        if polls == 20:
            stop.ask()
        return poll(timeout_s)

    monkeypatch.setattr(house.sink, 'poll', look)
    with pytest.raises(RouteError, match='gave up 2 messages'):
        house.pipeline.run(stop)
    assert polls > 20


def test_a_drain_that_owes_nothing_to_kafka_is_well_also_where_kafka_lets_nobody_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_timeout_s: float) -> None:
        raise RouteError('not let in')

    house = House()
    house.sink.close()
    monkeypatch.setattr(house.sink, 'poll', refuse)
    house.stop()
    house.give(b'a')
    with pytest.raises(RouteError, match='not let in'):
        house.stop()
    assert house.pipeline.snapshot.in_flight == 1
