"""The way to a dead-letter topic."""

import logging

import pytest

from ros2_kafka_bridge.dead_letters import writer
from ros2_kafka_bridge.dead_letters.writer import DeadLetters, OutgoingLetter
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.testing.memory import MemoryRecordSink

LETTER = Outgoing('', None, b'bad', [])


class Clock:
    """A `time` that a test sets."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


def test_a_topic_that_cannot_be_written_is_tried_again_as_often_as_all_that_fails(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(writer, 'time', clock)
    refusals: list[BridgeError] = [RouteError('no permission') for _ in range(6)]
    sink = MemoryRecordSink[OutgoingLetter[int]](errors={b'bad': refusals})
    log = logging.LoggerAdapter(logging.getLogger('test'), {})
    letters = DeadLetters('dead', sink, lambda: None, log)
    letters.add(LETTER, 1)
    for wait_s in (1, 2, 4, 8, 10, 10):
        caplog.clear()
        assert letters.poll() == []
        assert f'no permission; tried again in {wait_s} s' in caplog.text
        clock.now_s += wait_s - 0.1
        assert letters.poll() == []
        clock.now_s += 0.1
    assert refusals == []
    assert letters.poll() == [1]
    sink.errors[b'bad'] = [RouteError('no permission')]
    caplog.clear()
    letters.add(LETTER, 2)
    assert letters.poll() == []
    assert 'tried again in 1 s' in caplog.text
