"""What a direction tells of itself: once a second, and at once when it pauses or goes on."""

import time
from typing import Any

from ros2_kafka_bridge.dead_letters.writer import DeadLetters
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.threads.pause import Pause

SNAPSHOT_S = 1.0


class Telling:
    """When a direction has to tell what it does, and what that is.

    Args:
        counters: Where its state is noted.
        meter: Where its errors are noted.
        dead_letters: Of the route.
    """

    def __init__(self, counters: Counters, meter: Meter, dead_letters: DeadLetters[Any]) -> None:
        self._counters = counters
        self._meter = meter
        self._dead_letters = dead_letters
        self._paused = False  # as was told last
        self._at_s = 0.0

    def is_due(self, pause: Pause) -> bool:
        """Whether it is time: a second after the last time, or once a pause begins or ends."""
        return time.monotonic() >= self._at_s or self._paused != pause.asked

    def tell(self, obstacle: str, away: str, pause: Pause) -> None:
        """Note what the direction does.

        Args:
            obstacle: What it waits for; empty where it runs.
            away: Why Kafka cannot be reached; empty where it can.
            pause: Of the route.
        """
        self._at_s = time.monotonic() + SNAPSHOT_S
        self._paused = pause.asked
        letters = self._dead_letters
        self._counters.tell(letters.problem, obstacle, pause.reason if self._paused else '')
        self._meter.look(away)
        if (error := letters.take_error()) is not None:
            self._meter.troubles.note(error, f'dead-letter topic {letters.topic}')
