"""An end of a route in ROS is a set of topics."""

from typing import Any
from unittest.mock import MagicMock

import pytest
from support.ros.ends import end_of, still_node, writer_of

from ros2_kafka_bridge.endpoints import Load, Matches, Message
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros.sink import RosSink
from ros2_kafka_bridge.ros.source import RosSource
from ros2_kafka_bridge.ros.topic_end import OwnPublisher
from ros2_kafka_bridge.ros.types import load_type


class Reader:
    """One topic that is read, with what waits there."""

    def __init__(self, *numbers: int) -> None:
        self.waiting = [Message(b'', b'', number, 0) for number in numbers]
        self.matches, self.lost_upstream = Matches(1, 2), 3
        self.exhausted = False
        self.failure: Exception | None = None
        self.fails: Exception | None = None  # each take does, behind what it brings
        self.calls: list[str] = []

    def open(self) -> None:
        self.calls.append('open')

    def close(self) -> None:
        self.calls.append('close')

    def look(self) -> None:
        self.calls.append('look')

    def take(self, limit: int) -> list[Message]:
        taken, self.waiting = self.waiting[:limit], self.waiting[limit:]
        self.exhausted = len(taken) < limit and self.fails is None
        self.failure = self.fails
        return taken

    def raise_failure(self) -> None:
        failure, self.failure = self.failure, None
        if failure is not None:
            raise failure


class Arrivals:
    """Waits for nothing, and names the topics on which something is to have come.

    Args:
        ready: Those topics.
    """

    def __init__(self, *ready: str) -> None:
        self.ready = [*ready]
        self.waits: list[float] = []

    def wait(self, timeout_s: float) -> list[str]:
        self.waits.append(timeout_s)
        return self.ready


def source_of(arrivals: Arrivals, **readers: Any) -> RosSource:
    told: Any = arrivals
    source = RosSource(told, readers)
    source.open()
    return source


def test_all_topics_are_taken_from_and_none_takes_the_place_of_another() -> None:
    a, b = Reader(*range(1, 9)), Reader(11, 12)
    arrivals = Arrivals('a', 'b')
    source = source_of(arrivals, a=a, b=b)
    assert not source.exhausted, 'nothing was taken yet'
    assert sorted(message.seq for message in source.take(4, 1.0)) == [1, 2, 11, 12]
    assert not source.exhausted
    assert [message.seq for message in source.take(20, 1.0)] == [3, 4, 5, 6, 7, 8]
    assert source.exhausted
    assert (source.matches, source.lost_upstream) == ((2, 4), 6)
    assert arrivals.waits == [1.0, 0.0], 'it waits only where nothing was left'
    source.close()
    assert a.calls == b.calls == ['open', 'look', 'look', 'close']


def test_one_topic_that_has_more_is_reason_enough_to_go_on() -> None:
    a, b = Reader(), Reader(1, 2)
    arrivals = Arrivals('b')
    source = source_of(arrivals, a=a, b=b)
    source.take(2, 0.0)
    assert not source.exhausted
    assert [message.seq for message in source.take(2, 1.0)] == [2]
    arrivals.ready.clear()
    assert source.take(2, 1.0) == []
    assert source.exhausted
    assert arrivals.waits == [0.0, 1.0]


def test_only_topics_on_which_something_came_or_was_left_are_taken_from() -> None:
    a, b, c = Reader(), Reader(), Reader()
    arrivals = Arrivals()
    source = source_of(arrivals, a=a, b=b, c=c)
    source.take(30, 0.0)
    for reader in (a, b, c):
        reader.waiting = [Message(b'', b'', number, 0) for number in range(4)]
    arrivals.ready = ['b']
    assert [len(source.take(3, 1.0)), len(b.waiting)] == [3, 1], 'the whole limit is for it'
    arrivals.ready = ['c']
    source.take(20, 1.0)
    assert [len(reader.waiting) for reader in (a, b, c)] == [4, 0, 0]
    arrivals.ready = []
    assert len(source.take(20, 1.0)) == 4, 'who was told of nothing looks at all'


def test_what_one_topic_has_brought_comes_before_the_failure_of_another() -> None:
    a, b = Reader(), Reader(1)
    arrivals = Arrivals('a', 'b')
    source = source_of(arrivals, a=a, b=b)
    b.fails = RouteError('no')
    assert [message.seq for message in source.take(10, 1.0)] == [1]
    for timeout_s in (1.0, 0.0):
        with pytest.raises(RouteError):
            source.take(10, timeout_s)
    assert arrivals.waits == [1.0, 0.0], 'nobody waits for what has failed'


@pytest.mark.parametrize('timeout_s', [0.0, 1.0])
def test_a_failure_is_told_by_the_take_that_has_met_it_where_it_has_nothing_else(
    timeout_s: float,
) -> None:
    a = Reader()
    source = source_of(Arrivals('a'), a=a)
    a.fails = RouteError('no')
    with pytest.raises(RouteError):
        source.take(10, timeout_s)


def test_a_sink_tells_of_all_its_topics() -> None:
    handle = MagicMock()
    kind = load_type('std_msgs/msg/String')
    ends = [end_of(still_node(handle), kind, topic) for topic in ('/a', '/b')]
    writers = {end.topic: writer_of(end, room) for end, room in zip(ends, (5, 7), strict=True)}
    sink = RosSink(writers)
    for number, writer in enumerate(writers.values(), 1):
        writer._matched, writer._history.published = number, number
        writer._subscribers.reliable = [f'/robot_{number}', '/logger']
    assert sink.load == Load(3, 12)
    assert sink.matches == Matches(3, 0)
    assert sink.reliable_subscribers == ['/logger', '/robot_1', '/robot_2']
    assert sink.writer('/b') is writers['/b']
    for writer in writers.values():
        writer._publisher = OwnPublisher(MagicMock(), MagicMock())
    sink.close()
    assert handle.destroy_publisher.call_count == 2
    unbounded = writer_of(ends[0], asks=False, bounded=False)
    assert RosSink({'/a': unbounded, '/b': writers['/b']}).load.limit is None
