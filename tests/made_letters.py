"""Dead letters as a bridge makes them, and what makes of them what is sent; without a broker."""

from collections.abc import Mapping
from typing import Any

from ros2_kafka_bridge.commands.dead_letters.restore import Restorer
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.letter import Letter, parse
from ros2_kafka_bridge.dead_letters.writer import explain, from_kafka, from_ros
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing
from ros2_kafka_bridge.errors import (
    DecodeError,
    EncodeError,
    RecordError,
)
from ros2_kafka_bridge.kafka.letters import Original
from ros2_kafka_bridge.testing.memory import MemoryRecord

TOPIC = 'orders.dead-letters'
HEADERS: HeaderList = [('trace', b'\xff'), ('trace', None)]
CONFIG: dict[str, Any] = {
    'name': 'warehouse-1',
    'kafka': {'bootstrap.servers': 'localhost:9092'},
    'routes': [
        {
            'name': 'orders',
            'from': {'kafka': 'orders'},
            'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
            'format': 'text',
            'max_message_bytes': 100,
        },
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


def ros_letter(value: bytes | None, error: RecordError | None = None) -> Outgoing:
    told: HeaderList = [
        ('ros.type', 'std_msgs/msg/String'),
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


def restorer(
    of: Config | None = None,
    original: Outgoing | None = None,
    partitions: Mapping[str, int] | None = None,
    *,
    force: bool = False,
    was_there: bool = True,
) -> Restorer:
    known = {'orders': 3, 'returned': 1, TOPIC: 1} if partitions is None else partitions
    fetched = Original(None if original is None else stored(original), was_there)
    return Restorer(of or config(), known, lambda *_: fetched, force=force)
