"""Counting the messages of topics."""

from typing import Any
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.ros import rates
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.types import load_type


def test_readers_are_made_and_destroyed_while_no_other_thread_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = RosNode(MagicMock(), None)
    locked: list[bool] = []

    def note(*_: Any, **__: Any) -> MagicMock:
        locked.append(node.endpoint_lock.locked())
        return MagicMock()

    node.handle.create_subscription.side_effect = note
    node.handle.destroy_subscription.side_effect = note
    monkeypatch.setattr(rates, '_count', lambda made, _: (dict.fromkeys(made, 3), 2.0))
    topics = dict.fromkeys(['/a', '/b'], load_type('std_msgs/msg/String'))
    assert rates.count(node, topics, 2.0) == {'/a': 1.5, '/b': 1.5}
    assert locked == [True] * 4
