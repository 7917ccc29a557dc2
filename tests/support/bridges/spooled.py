"""A bridge with a spool: its route, what it has on disk, what has arrived."""

import contextlib
import sqlite3
from pathlib import Path
from typing import Any

from confluent_kafka import Consumer, KafkaException, TopicPartition
from support.bridges.routes import to_kafka
from support.patience import patient
from support.processes.harness import Bench

from rig.topics import records
from ros2_kafka_bridge.spool.store import file_of

WINDOW = 500
CACHE = 500
RATE = 1000


def route(bench: Bench, topic: str, *, mode: str = 'when_away', **more: Any) -> dict[str, Any]:
    """A route with a spool, and a window and a cache that a test can fill."""
    spool = {'path': str(bench.place / 'spool'), 'mode': mode, **more}
    made = to_kafka('/orders', topic, max_in_flight=WINDOW, spool=spool)
    made['from']['max_samples'] = CACHE
    return made


def file(bench: Bench) -> Path:
    """The spool of the route in the bridge of the tests."""
    return file_of(bench.place / 'spool', bench.name, 'to_kafka')


def numbers(bench: Bench, topic: str) -> list[int]:
    """What has arrived, in the order of the topic."""
    return [int(record.value() or b'') for record in records(bench.bootstrap_servers, topic)]


def arrived(bench: Bench, topic: str) -> int:
    """How many records a topic holds just now."""
    config = {'bootstrap.servers': bench.bootstrap_servers, 'group.id': 'nobody'}
    with contextlib.closing(Consumer(config)) as consumer:
        try:
            return int(
                consumer.get_watermark_offsets(TopicPartition(topic, 0), timeout=patient(10))[1]
            )
        except KafkaException:
            return 0


def on_disk(bench: Bench) -> int:
    """How many messages a running bridge has on disk."""
    if not file(bench).exists():
        return 0
    reader = sqlite3.connect(f'file:{file(bench)}?mode=ro', uri=True)
    with contextlib.closing(reader):
        return int(reader.execute('SELECT count(*) FROM rows').fetchone()[0])
