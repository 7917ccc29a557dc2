"""Dead letters that a real bridge makes, and the commands that look at them."""

import contextlib
from pathlib import Path
from typing import Any

from confluent_kafka import KafkaException
from harness import Bench, Process, eventually, to_ros
from words import ROS_TOPIC

SMALL, LARGE = 100, 10_000  # limits of a route, in bytes
HOSTILE = b'\x1b[2J\r\xff\xe2\x80\xae'


def route(topic: str, limit_bytes: int = LARGE, **more: Any) -> dict[str, Any]:
    """A route to ROS that waits for nobody."""
    return to_ros(topic, ROS_TOPIC, max_message_bytes=limit_bytes, min_subscribers=0, **more)


def wait_for_commit(
    bench: Bench, topic: str, offset: int, bridge: Process, partition: int = 0
) -> None:
    """Wait until a bridge has moved all before an offset."""
    eventually(
        lambda: committed(bench, topic, partition) == offset,
        120,
        lambda: f'{committed(bench, topic, partition)}, not {offset}\n{bridge.output()}',
    )


def committed(bench: Bench, topic: str, partition: int) -> int:
    """The committed offset of the route; negative where Kafka cannot tell."""
    with contextlib.suppress(KafkaException):  # a new coordinator
        return bench.committed(bench.group, topic, partition)
    return -1


def run(bench: Bench, *arguments: str | Path) -> tuple[int, str, str]:
    """Run a command to its end."""
    return bench.command('dead-letters', *map(str, arguments), timeout_s=180)


def done(bench: Bench, *arguments: str | Path) -> str:
    """What a command prints that does all that it is asked for."""
    status, output, errors = run(bench, *arguments)
    assert (status, errors) == (0, ''), output + errors
    return output


def long(number: int) -> bytes:
    """A record that is too large for the first route."""
    return b'%d ' % number + b'x' * SMALL
