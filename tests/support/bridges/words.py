"""What the tests of Kafka -> ROS share: words that are sent, and waiting for them."""

import contextlib
from pathlib import Path

from confluent_kafka import KafkaException
from support.bridges.routes import lines
from support.processes.harness import PATIENCE_S, Bench, Process, eventually

ROS_TOPIC = '/words'


def words(count: int, start: int = 0) -> list[bytes | None]:
    return [b'%d' % number for number in range(start, start + count)]


def texts(found: list[bytes | None]) -> list[str]:
    return [(value or b'').decode() for value in found]


def wait_for(
    file: Path, expected: list[str], bridge: Process, timeout_s: float = PATIENCE_S
) -> None:
    """Wait until all has arrived, once and in order."""
    eventually(
        lambda: len(lines(file)) >= len(expected),
        timeout_s,
        lambda: f'{len(lines(file))} of {len(expected)}\n{bridge.output()}',
    )
    assert lines(file) == expected


def committed(bench: Bench, topic: str, partition: int) -> int:
    """The committed offset of the route; negative where Kafka cannot tell."""
    with contextlib.suppress(KafkaException):  # a new coordinator
        return bench.committed(bench.group, topic, partition)
    return -1


def wait_for_commit(
    bench: Bench, topic: str, offset: int, bridge: Process, partition: int = 0
) -> None:
    """Wait until a bridge has moved all before an offset."""
    eventually(
        lambda: committed(bench, topic, partition) == offset,
        PATIENCE_S,
        lambda: f'{committed(bench, topic, partition)}, not {offset}\n{bridge.output()}',
    )
