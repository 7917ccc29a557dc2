"""Dead letters that a real bridge makes, and the commands that look at them."""

from pathlib import Path
from typing import Any

from support.bridges.routes import to_ros
from support.bridges.words import ROS_TOPIC
from support.processes.harness import Bench

from ros2_kafka_bridge.kafka.transactions import Parcel, RefusedParcel, Transactions
from ros2_kafka_bridge.threads.stop import Stop

SMALL, LARGE = 100, 10_000  # limits of a route, in bytes
HOSTILE = b'\x1b[2J\r\xff\xe2\x80\xae'


def route(topic: str, limit_bytes: int = LARGE, **more: Any) -> dict[str, Any]:
    """A route to ROS that waits for nobody."""
    return to_ros(topic, ROS_TOPIC, max_message_bytes=limit_bytes, min_subscribers=0, **more)


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


def written_one_by_one(
    properties: dict[str, Any], name: str, jobs: list[list[Parcel]]
) -> list[RefusedParcel]:
    """What is refused as parcels are written, each time in transactions of their own."""
    refused: list[RefusedParcel] = []
    while jobs:
        with Transactions(properties, name, Stop()) as transactions:
            while jobs and not transactions.spent:
                found, jobs[0] = transactions.write(jobs[0])
                refused += found
                jobs = jobs[not jobs[0] :]
    return refused
