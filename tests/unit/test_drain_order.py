"""Guarantee 7, stop is a drain: in one process, routes to ROS end before those from ROS stop.

What a route to ROS has published last, and its reader here has acknowledged, is still taken.
"""

import logging
import os
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest
from support.worlds.flights import TO_KAFKA, TO_ROS

from ros2_kafka_bridge import bridge as bridge_module
from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated

CONTENT: dict[str, Any] = {
    'name': 'test',
    'kafka': {'bootstrap.servers': 'localhost:1'},
    'routes': [
        {'name': 'to_ros', **TO_ROS},
        {'name': 'to_kafka', **TO_KAFKA, 'to': {'kafka': 'returned'}},
    ],
}


def test_guarantee_7_routes_from_ros_stop_only_once_those_to_ros_have_ended() -> None:
    bridge = Bridge(validated(Config, CONTENT))
    to_ros, to_kafka = bridge._runners
    asked_meanwhile = []

    def drain() -> None:
        assert to_ros.stop.wait(30)
        time.sleep(0.3)  # what is in flight
        asked_meanwhile.append(to_kafka.stop.asked)

    to_ros.thread = threading.Thread(target=drain, daemon=True)
    to_kafka.thread = threading.Thread(target=to_kafka.stop.wait, args=(30,), daemon=True)
    for runner in bridge._runners:
        assert runner.thread is not None
        runner.thread.start()
    bridge.stop.ask()
    assert not to_kafka.stop.asked
    bridge._shut_down()
    assert asked_meanwhile == [False]
    assert to_kafka.stop.asked
    assert not bridge.runs


def content(to_ros_s: float, to_kafka_s: float) -> dict[str, Any]:
    to_ros, to_kafka = CONTENT['routes']
    return CONTENT | {
        'routes': [{**to_ros, 'drain_s': to_ros_s}, {**to_kafka, 'drain_s': to_kafka_s}]
    }


@pytest.fixture
def exits(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """With what status the process was to end at once."""
    statuses: list[int] = []
    monkeypatch.setattr(os, '_exit', statuses.append)
    monkeypatch.setattr(logging, 'shutdown', lambda: None)
    monkeypatch.setattr(bridge_module, '_CLOSING_S', 0.2)
    return statuses


def test_a_route_from_ros_has_its_whole_drain_however_long_one_to_ros_takes(
    exits: list[int], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that does not wait: one never ends, the other takes 50 s of its 60."""
    bridge = Bridge(validated(Config, content(60, 60)))
    to_ros, to_kafka = bridge._runners
    let_go, drained = threading.Event(), threading.Event()
    to_ros.thread = threading.Thread(target=let_go.wait, args=(30,), daemon=True)
    to_kafka.thread = last = threading.Thread(target=drained.wait, args=(30,), daemon=True)
    to_ros.thread.start()
    last.start()
    now_s = asked_s = 1000.0

    def sleep(seconds: float) -> None:
        nonlocal now_s, asked_s
        now_s += seconds
        if not to_kafka.stop.asked:
            asked_s = now_s
        elif now_s > asked_s + 50:
            drained.set()
            last.join()

    clock = SimpleNamespace(monotonic=lambda: now_s, sleep=sleep)
    monkeypatch.setattr(bridge_module, 'time', clock)
    bridge.stop.ask()
    bridge._shut_down()
    assert to_ros.runs
    assert not to_kafka.runs
    let_go.set()
    assert exits == [1]
    assert now_s - 1000 < 60 + 60 + 2 * 0.2
    assert [vars(r)['route'] for r in caplog.records if r.levelname == 'ERROR'] == ['to_ros']


def test_what_a_route_leaves_that_does_not_end_in_time_is_said_of_it(
    exits: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    bridge = Bridge(validated(Config, content(0.0, 0.0)))
    let_go = threading.Event()
    for runner, held in zip(bridge._runners, (1, 2), strict=True):
        runner._work = runner._work._replace(
            before=runner._work.before._replace(taken=3, confirmed=3 - held, in_flight=held)
        )
        runner.thread = threading.Thread(target=let_go.wait, args=(30,), daemon=True)
        runner.thread.start()
    bridge.stop.ask()
    bridge._shut_down()
    let_go.set()
    assert exits == [1]
    one, two = [record.getMessage() for record in caplog.records if record.levelname == 'ERROR']
    assert one == (
        'did not end in time: it is left with 1 record in flight, read again next time '
        '(3 taken, 2 confirmed, 0 dead-lettered, 1 given up)'
    )
    assert two == (
        'did not end in time: it is left with 2 messages in flight, lost unless in the spool, or '
        'the publisher is TRANSIENT_LOCAL (3 taken, 1 confirmed, 0 dead-lettered, 2 given up)'
    )
