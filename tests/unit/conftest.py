"""What the tests of exclusive routes share."""

import pytest


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what has failed be tried again soon."""
    monkeypatch.setattr('ros2_kafka_bridge.threads.backoff._FIRST_S', 0.01)
