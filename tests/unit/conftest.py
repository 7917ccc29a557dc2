"""What tests of routes share: no waiting."""

import pytest


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what has failed be tried again soon."""
    monkeypatch.setattr('ros2_kafka_bridge.threads.backoff._FIRST_S', 0.01)


@pytest.fixture
def no_settle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody wait for who has just come."""
    monkeypatch.setattr('ros2_kafka_bridge.route.readiness.SETTLE_S', 0.0)
