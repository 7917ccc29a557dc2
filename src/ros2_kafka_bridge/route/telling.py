"""What a pipeline tells of itself: once a second, and at once when it pauses or goes on.

One that has nothing to do tells as often as somebody asks, and seldom where nobody does.
"""

import time
from typing import Any

from ros2_kafka_bridge.endpoints import KafkaEnd
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.threads.pause import Pause

SNAPSHOT_S = 1.0
_UNASKED_S = 10.0


class Telling:
    """When a pipeline has to tell what it does, and what that is.

    Args:
        counters: Where its state is noted.
        meter: Where its errors are noted.
        dead_letters: Of the route.
    """

    def __init__(self, counters: Counters, meter: Meter, dead_letters: DeadLetters[Any]) -> None:
        self.is_asked = False  # since it told last; another thread sets it
        self._counters = counters
        self._meter = meter
        self._dead_letters = dead_letters
        self._paused = False  # as was told last
        self._told_s = -_UNASKED_S

    def is_due(self, pause: Pause, *, is_calm: bool) -> bool:
        """Whether it is time for that.

        Args:
            pause: Of the route.
            is_calm: Whether the route has had nothing to do for a while.
        """
        patience_s = _UNASKED_S if is_calm and not self.is_asked else SNAPSHOT_S
        return time.monotonic() >= self._told_s + patience_s or self._paused != pause.asked

    def tell(self, obstacle: str, kafka: KafkaEnd, pause: Pause, *, begun: bool = False) -> None:
        """Note what the pipeline does.

        Args:
            obstacle: What it waits for; empty where it runs.
            kafka: The end of the route that is in Kafka.
            pause: Of the route.
            begun: Whether it does its work though Kafka has never answered.
        """
        self._told_s, self.is_asked = time.monotonic(), False
        self._paused = pause.asked
        letters = self._dead_letters
        reason = pause.reason if self._paused else ''
        begun = begun or kafka.reached
        self._counters.tell(letters.problem, obstacle, reason, begun=begun)
        self._meter.kafka_up = kafka.answers
        self._meter.look(kafka.away)
        if (error := letters.take_error()) is not None:
            self._meter.troubles.note(error, f'dead-letter topic {letters.topic}')
