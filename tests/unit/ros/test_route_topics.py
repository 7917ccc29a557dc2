"""An end of a route in ROS is a set of topics."""

from typing import Any
from unittest.mock import MagicMock

import pytest
from ros_ends import end_of, writer_of

from ros2_kafka_bridge.endpoints import Load, Matches, Message
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros import take
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.sink import RosSink
from ros2_kafka_bridge.ros.source import RosSource
from ros2_kafka_bridge.ros.topic_end import OwnPublisher
from ros2_kafka_bridge.ros.types import load_type


class Reader:
    """One topic that is read, with what waits there."""

    def __init__(self, *numbers: int) -> None:
        self.waiting = [Message(b'', b'', number, 0) for number in numbers]
        self.handles = [object()]
        self.matches, self.lost_upstream = Matches(1, 2), 3
        self.exhausted = False
        self.failure: Exception | None = None
        self.calls: list[str] = []

    def open(self) -> None:
        self.calls.append('open')

    def close(self) -> None:
        self.calls.append('close')

    def look(self) -> None:
        self.calls.append('look')

    def take(self, limit: int) -> list[Message]:
        taken, self.waiting = self.waiting[:limit], self.waiting[limit:]
        self.exhausted = len(taken) < limit
        return taken

    def raise_failure(self) -> None:
        failure, self.failure = self.failure, None
        if failure is not None:
            raise failure


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    waiter = MagicMock()
    monkeypatch.setattr(take, 'Waiter', lambda _: waiter)
    return waiter


def source_of(**readers: Any) -> RosSource:
    source = RosSource(RosNode(None, None), readers)
    source.open()
    return source


def test_all_topics_are_taken_from_and_none_takes_the_place_of_another(waited: MagicMock) -> None:
    a, b = Reader(*range(1, 9)), Reader(11, 12)
    source = source_of(a=a, b=b)
    assert [message.seq for message in source.take(4, 1.0)] == [1, 2, 11, 12]
    assert not source.exhausted
    assert [message.seq for message in source.take(20, 1.0)] == [3, 4, 5, 6, 7, 8]
    assert source.exhausted
    assert (source.matches, source.lost_upstream) == ((2, 4), 6)
    waited.wait.assert_not_called()
    source.close()
    assert a.calls == b.calls == ['open', 'look', 'look', 'close']


def test_one_topic_that_has_more_is_reason_enough_to_go_on(waited: MagicMock) -> None:
    a, b = Reader(), Reader()
    source = source_of(a=a, b=b)
    a.take(1)
    assert not source.exhausted
    assert source.take(2, 1.0) == []
    [call] = waited.wait.call_args_list
    assert call.args == ([*a.handles, *b.handles], 1.0), 'all of them are waited for'


def test_what_one_topic_has_brought_comes_before_the_failure_of_another(
    waited: MagicMock,
) -> None:
    a, b = Reader(), Reader(1)
    source = source_of(a=a, b=b)
    failing = b.take

    def take_and_fail(limit: int) -> list[Message]:
        b.failure = RouteError('no')
        return failing(limit)

    b.take = take_and_fail  # type: ignore[method-assign]
    assert [message.seq for message in source.take(10, 1.0)] == [1]
    with pytest.raises(RouteError):
        source.take(10, 1.0)
    waited.wait.assert_not_called()


def test_a_sink_tells_of_all_its_topics() -> None:
    handle = MagicMock()
    kind = load_type('std_msgs/msg/String')
    ends = [end_of(RosNode(handle, None), kind, topic) for topic in ('/a', '/b')]
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
