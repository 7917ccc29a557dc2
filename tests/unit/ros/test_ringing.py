"""A topic rings only while its reader has nothing to take: a ring costs what is unread."""

from unittest.mock import MagicMock

import pytest
from support.ros.ends import end_of, still_node

from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros import take as inner
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.types import MessageType
from ros2_kafka_bridge.threads.wakeup import Wakeup

TYPE = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)


def test_a_topic_rings_for_what_comes_and_not_for_what_is_taken_anyway(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rings: list[bool] = []
    left = iter([True, True, True, False, False, True, False])

    def ring(*reader_and_wakeup: object) -> bool:
        rings.append(len(reader_and_wakeup) > 1)
        return True

    monkeypatch.setattr(rcl, 'notify', ring)
    monkeypatch.setattr(rcl, 'notify_nobody', ring)
    monkeypatch.setattr(inner, 'take', lambda *_: ([], not next(left)))
    handle = MagicMock()
    handle.get_publishers_info_by_topic.return_value = []
    arrivals = Arrivals(Wakeup())
    reader = TopicReader(end_of(still_node(handle), TYPE), arrivals)
    reader.open()
    assert rings == [True]
    seen = []
    for _ in range(7):
        reader.take(10)
        seen.append(rings[-1])
        assert reader.exhausted is rings[-1]
    assert seen == [False, False, False, True, True, False, True]
    assert rings == [True, False, True, False, True], 'each once'
    assert arrivals._limit.taken(20) <= 0.01, 'what has come in between rings perhaps not'
    reader.close()
    assert rings[-1] is False
