"""The pipeline Kafka -> ROS with ends in memory, driven step by step."""

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from support.worlds.flights import TO_ROS, Driven

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.errors import DecodeError, RouteError
from ros2_kafka_bridge.formats import guarded
from ros2_kafka_bridge.kafka_to_ros import KafkaToRos
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.type_hash import make_hash_check
from ros2_kafka_bridge.testing.memory import (
    MemoryMessageSink,
    MemoryRecord,
    MemoryRecordSink,
    MemoryRecordSource,
)

if TYPE_CHECKING:
    from ros2_kafka_bridge.route.flight.records import RecordEntry


HASH = 'RIHS01_' + '1' * 64
LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
MINE: HeaderList = [('ros.topic', b'/orders'), ('bridge.origin', b'me')]
"""The headers of a record that the bridge of a house has made of a message of its own topic."""

IN_2001_MS = 10**12
"""The time of a record that is old."""


BUGS: dict[bytes, tuple[type[BaseException], str]] = {
    b'bug of the bridge': (AttributeError, "'NoneType' object has no attribute 'get'"),
    b'bug that asserts': (AssertionError, ''),
    b'bug that takes all memory': (MemoryError, ''),
    b'bug without end': (RecursionError, 'maximum recursion depth exceeded'),
    b'bug, said the user': (KeyboardInterrupt, ''),
}


def decode(value: bytes | None) -> bytes:
    if value is None or value.startswith(b'bad'):
        raise DecodeError('not what it should be')
    if value.startswith(b'bug'):
        kind, text = BUGS[value]
        raise kind(text)
    if value.startswith(b'away'):
        raise RouteError('the Schema Registry does not answer')
    return b'cdr:' + value


class House(Driven):
    """A pipeline with its ends."""

    usual = 6

    def __init__(
        self,
        sink: MemoryMessageSink | None = None,
        letters: MemoryRecordSink[Any] | None = None,
        decode: Callable[[bytes | None], bytes] = decode,
        **settings: Any,
    ) -> None:
        self.source = MemoryRecordSource()
        self.sink = sink or MemoryMessageSink()
        self.letters: MemoryRecordSink[Any] = letters or MemoryRecordSink()
        route = validated(KafkaToRosRoute, {'name': 'orders', **TO_ROS, **settings})
        dead: DeadLetters[RecordEntry] = DeadLetters(
            'orders.dead', self.letters, lambda: None, LOG
        )
        self.pipeline: KafkaToRos = KafkaToRos(
            route,
            'me',
            self.source,
            self.sink,
            make_hash_check('std_msgs/msg/String', HASH),
            guarded(decode, route.max_message_bytes, DecodeError),
            dead,
            LOG,
        )
        self.pause = self.pipeline._pause
        self.source.open(self.pipeline)

    def give(self, *values: bytes | None, partition: int = 0, first: int = 0, **more: Any) -> None:
        for number, value in enumerate(values):
            self.source.waiting.append(MemoryRecord(value, first + number, partition, **more))

    def positions(self) -> dict[int, int]:
        self.pipeline._settle()
        return self.source.positions

    def confirmed(self) -> int:
        return self.pipeline.counters.snapshot(0).confirmed
