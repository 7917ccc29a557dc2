"""Dead letters as a bridge makes them, and what makes of them what is sent; without a broker."""

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from support.worlds.flights import TO_ROS

from ros2_kafka_bridge.commands.dead_letters.restore import Restorer
from ros2_kafka_bridge.commands.dead_letters.types import JoinRos, LetterTypes, why_packages
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.letter import Letter, parse
from ros2_kafka_bridge.dead_letters.writer import explain, from_kafka, from_ros
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, RecordSource
from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError, RecordError
from ros2_kafka_bridge.kafka.letters import Original
from ros2_kafka_bridge.kafka_to_ros import KafkaToRos
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.records import RecordEntry
from ros2_kafka_bridge.route.type_hash import check_nothing
from ros2_kafka_bridge.testing.memory import MemoryMessageSink, MemoryRecord, MemoryRecordSink

TOPIC = 'orders.dead-letters'
HEADERS: HeaderList = [('trace', b'\xff'), ('trace', None)]
CONFIG: dict[str, Any] = {
    'name': 'warehouse-1',
    'kafka': {'bootstrap.servers': 'localhost:9092'},
    'routes': [
        {'name': 'orders', **TO_ROS, 'max_message_bytes': 100},
        {
            'name': 'returned',
            'from': {'ros': '/orders'},
            'to': {'kafka': 'returned', 'key': '{ros.gid} {message.data}'},
            'format': 'text',
        },
    ],
}


def stored(record: Outgoing, at: int = 7, time_ms: int = 1_000_000) -> MemoryRecord:
    """A record as Kafka hands it over."""
    headers: HeaderList = [
        (name, value.encode() if isinstance(value, str) else value)
        for name, value in record.headers
    ]
    return MemoryRecord(record.value, at, 0, record.key, headers or None, time_ms)


def kafka_letter(
    value: bytes | None = b'order', headers: HeaderList = HEADERS, topic: str = 'orders'
) -> Outgoing:
    record = Outgoing(topic, b'key', value, headers)
    return explain(record, DecodeError('not UTF-8 at byte 3'), from_kafka('orders', topic, 2, 5))


def ros_letter(
    value: bytes | None,
    error: RecordError | None = None,
    name: str = 'std_msgs/msg/String',
    type_hash: str = '',
) -> Outgoing:
    told: HeaderList = [
        ('ros.type', name),
        *([('ros.type_hash', type_hash)] * bool(type_hash)),
        ('ros.gid', 'ab' * 16),
        ('ros.seq', '1'),
    ]
    record = Outgoing('returned', None, value, told)
    origin = from_ros('returned', '/orders', 'returned')
    return explain(record, error or EncodeError('data: a NUL'), origin)


def read(record: Outgoing, at: int = 7, time_ms: int = 1_000_000) -> Letter:
    found = parse(TOPIC, stored(record, at, time_ms))
    assert isinstance(found, Letter)
    return found


def config(**changes: Any) -> Config:
    routes = [{**route, **changes} for route in CONFIG['routes']]
    return validated(Config, {**CONFIG, 'routes': routes})


def without_ros() -> RosNode:
    """No node is there to ask, nor needed."""
    raise ConfigError(['ROS 2 is not here'])


def restorer(
    of: Config | None = None,
    original: Outgoing | None = None,
    partitions: Mapping[str, int] | None = None,
    *,
    force: bool = False,
    was_there: bool = True,
    join: JoinRos = without_ros,
    to_ros: bool = False,
) -> Restorer:
    known = {'orders': 3, 'returned': 1, TOPIC: 1} if partitions is None else partitions
    fetched = Original(None if original is None else stored(original), was_there)
    made = of or config()
    types = LetterTypes(made, join, why_packages(made, to_ros=to_ros))
    return Restorer(made, known, lambda *_: fetched, types, force=force)


class Readers(MemoryMessageSink):
    """Readers to whom something happens once so many letters are published."""

    def happen_at(self, number: int, event: Callable[[], None]) -> None:
        self.number, self.event = number, event

    def publish(self, messages: Iterable[bytes]) -> int:
        before = len(self.published)
        for cdr in messages:
            if not super().publish([cdr]):
                break
            if len(self.published) == getattr(self, 'number', 0):
                self.event()
        return len(self.published) - before


def to_readers(readers: Readers) -> Callable[[KafkaToRosRoute, RecordSource], KafkaToRos]:
    """Makes the pipelines of a replay to these readers, who get each value as it is."""
    log = logging.LoggerAdapter(logging.getLogger('test'), {})

    def make(route: KafkaToRosRoute, source: RecordSource) -> KafkaToRos:
        dead = DeadLetters[RecordEntry]('dead', MemoryRecordSink(), lambda: None, log)
        return KafkaToRos(
            route, 'me', source, readers, check_nothing, lambda value: value or b'', dead, log
        )

    return make
