"""The way to a dead-letter topic."""

import logging
from typing import NoReturn

import pytest
from support.worlds.clocks import Clock

from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.route import dead_letters
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.messages import LINE, MessageEntry, MessageFlight
from ros2_kafka_bridge.testing.memory import MemoryRecordSink

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
LETTER = Outgoing('', None, b'bad', [])


def test_a_topic_that_cannot_be_written_is_tried_again_as_often_as_all_that_fails(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(dead_letters, 'time', clock)
    refusals: list[BridgeError] = [RouteError('no permission') for _ in range(6)]
    sink = MemoryRecordSink[MessageEntry](errors={b'bad': refusals})
    letters = DeadLetters('dead', sink, lambda: None, LOG)
    flight = MessageFlight(10, 1000)
    refuse(flight)
    for wait_s in (1, 2, 4, 8, 10, 10):
        caplog.clear()
        letters.step(flight)
        assert f'no permission; tried again in {wait_s} s' in caplog.text
        clock.now_s += wait_s - 0.1
        letters.step(flight)
        clock.now_s += 0.1
    assert refusals == []
    assert outcomes(flight) == []
    letters.step(flight)
    assert outcomes(flight) == [Outcome.DEAD_LETTERED]
    sink.errors[b'bad'] = [RouteError('no permission')]
    caplog.clear()
    refuse(flight)
    letters.step(flight)
    assert outcomes(flight) == []
    assert 'tried again in 1 s' in caplog.text


def test_letters_that_were_on_their_way_as_the_topic_failed_go_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    monkeypatch.setattr(dead_letters, 'time', clock)
    sink = MemoryRecordSink[MessageEntry]()
    letters = DeadLetters('dead', sink, lambda: None, LOG)
    flight = MessageFlight(10, 10_000)
    sink.answering = False
    refuse(flight)
    letters.step(flight)
    monkeypatch.setattr(sink, 'poll', fails)
    letters.step(flight)
    monkeypatch.undo()
    monkeypatch.setattr(dead_letters, 'time', clock)
    sink.answering = True
    clock.now_s += 100
    letters.step(flight)
    assert outcomes(flight) == [Outcome.DEAD_LETTERED]


def fails(*_: object) -> NoReturn:
    raise RouteError('no permission')


def refuse(flight: MessageFlight) -> None:
    entry = MessageEntry(LETTER, Message(b'bad', b'', 0, 0), 0.0)
    flight.take([entry], LINE)
    flight.divert(entry, LETTER)
    flight.ready([entry])


def outcomes(flight: MessageFlight) -> list[Outcome | None]:
    return [entry.outcome for entry in flight.settled()]
