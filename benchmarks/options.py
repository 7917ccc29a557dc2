"""What the command lines of several benchmarks have in common."""

import argparse
import math
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from ros2_kafka_bridge.testing.local_kafka import LocalKafka


class Broker(NamedTuple):
    """The Kafka to measure with.

    Args:
        pid: Process id, None where it is not ours.
    """

    bootstrap_servers: str
    pid: int | None


@contextmanager
def broker(bootstrap_servers: str | None) -> Iterator[Broker]:
    """Start a Kafka unless there is one."""
    if bootstrap_servers is not None:
        yield Broker(bootstrap_servers, None)
        return
    with LocalKafka() as kafka:
        yield Broker(kafka.bootstrap_servers, kafka.pid)


def whole_number(text: str) -> int:
    """Read a whole number from 1 on."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError('at least 1')
    return number


def positive(text: str) -> float:
    """Read a number above 0."""
    number = float(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError('more than 0')
    return number


def whole_numbers(text: str) -> list[int]:
    """Read whole numbers from 1 on, separated by commas."""
    return [whole_number(word) for word in text.split(',')]


def domains(text: str) -> list[int]:
    """Read ROS domains, separated by commas."""
    return [int(word) for word in text.split(',')]


def some_of(known: Collection[str]) -> Callable[[str], list[str]]:
    """Make what reads some of the names that are known, separated by commas, each once."""

    def read(text: str) -> list[str]:
        names = list(dict.fromkeys(text.split(',')))
        unknown = [name for name in names if name not in known]
        if unknown:
            raise argparse.ArgumentTypeError(f'no {unknown[0]!r}: there are {", ".join(known)}')
        return names

    return read
