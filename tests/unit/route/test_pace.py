"""When a record may be published."""

import time

import pytest

from ros2_kafka_bridge.route.publishing import Pace


def test_without_a_rate_every_message_goes_at_once() -> None:
    pace = Pace(None)
    assert all(pace.go() for _ in range(1000))
    assert pace.wait_s == 0


def test_a_rate_spaces_messages_and_catches_up_on_one_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, 'monotonic', lambda: now_s)
    pace = Pace(10.0)
    assert [pace.go() for _ in range(3)] == [True, True, False], 'one was owed, one is due'
    assert pace.wait_s == pytest.approx(0.1)
    now_s = 100.1
    assert [pace.go(), pace.go()] == [True, False]
    now_s = 200.0
    assert [pace.go() for _ in range(4)] == [True, True, False, False], 'no burst after a rest'
