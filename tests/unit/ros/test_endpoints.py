"""Threads of a process make and destroy their endpoints one at a time."""

import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from unittest.mock import MagicMock

import pytest
from support.ros.ends import end_of, source_of, still_node, writer_of

from ros2_kafka_bridge.ros import rcl, take
from ros2_kafka_bridge.ros.types import load_type

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
TYPE = load_type('std_msgs/msg/String')
CALLS = ('create_publisher', 'create_subscription', 'destroy_publisher', 'destroy_subscription')


class Handle(MagicMock):
    """A node of rclpy that counts who is in a call that takes the lock of the middleware."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.inside: list[str] = []
        self.most = 0

    def enter(self, call: str) -> None:
        self.inside.append(call)
        self.most = max(self.most, len(self.inside))
        time.sleep(0.005)
        self.inside.remove(call)


@pytest.fixture
def handle(monkeypatch: pytest.MonkeyPatch) -> Handle:
    monkeypatch.setattr(take, 'MatchEvents', MagicMock())
    monkeypatch.setattr(rcl, 'is_there', lambda: False)
    made = Handle()
    made.get_publishers_info_by_topic.return_value = []
    made.get_subscriptions_info_by_topic.return_value = []
    for call in CALLS:
        getattr(made, call).side_effect = lambda *_, call=call, **__: made.enter(call)
    return made


def test_no_two_threads_are_in_a_call_that_takes_the_lock_of_the_middleware(
    handle: Handle,
) -> None:
    node = still_node(handle, MagicMock())
    begin = threading.Barrier(6)

    def use(number: int) -> None:
        begin.wait()
        end = end_of(node, TYPE, f'/t{number}')
        opened = writer_of(end) if number % 2 else source_of(end)
        for _ in range(3):
            opened.open()
            opened.close()

    with ThreadPoolExecutor(6) as threads:
        list(threads.map(use, range(6)))
    assert handle.create_publisher.call_count == handle.create_subscription.call_count == 9
    assert handle.most == 1
