"""What tests of routes share: no waiting, and a log that is as before."""

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what has failed be tried again soon."""
    monkeypatch.setattr('ros2_kafka_bridge.threads.backoff._FIRST_S', 0.01)


@pytest.fixture
def no_settle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody wait for who has just come."""
    monkeypatch.setattr('ros2_kafka_bridge.route.readiness.SETTLE_S', 0.0)


@pytest.fixture
def own_log() -> Iterator[None]:
    """Let a test set up the log of the bridge."""
    logger = logging.getLogger('ros2_kafka_bridge')
    before = logger.handlers, logger.level, logger.propagate
    yield
    logger.handlers, logger.level, logger.propagate = before
