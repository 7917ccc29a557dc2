"""Routes of strings, and what topics, files and bridges say of what these have carried."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from confluent_kafka import Message

from rig.processes import Process
from rig.topics import headers


def values(records: list[Message]) -> list[bytes]:
    """The values of records, none of them null."""
    found = [record.value() for record in records]
    assert all(value is not None for value in found)
    return [value for value in found if value is not None]


def lines(file: Path) -> list[str]:
    """The whole lines of a file that may be written to just now."""
    if not file.exists():
        return []
    return file.read_text().split('\n')[:-1]


def gaps(records: Sequence[Message]) -> str:
    """Between which numbers of their publisher some are missing, as far as records tell."""
    seqs = [int(found['ros.seq']) for found in map(headers, records) if 'ros.seq' in found]
    found = [(a, b) for a, b in itertools.pairwise([0, *seqs]) if b > a + 1]
    return f', with gaps of ros.seq at {found}' if found else ''


def totals(bridge: Process, route: str = 'to_ros') -> dict[str, int]:
    """What became of all that a route has taken, from the last line that a bridge said of it.

    The counters balance (guarantee 6), or it fails.
    """
    *_, line = [line for line in bridge.output().split('\n') if f'{route}: stopped: ' in line]
    parts = [part.split(' ', 1) for part in line.partition('stopped: ')[2].split(', ')]
    found = {name: int(count) for count, name in parts}
    ends = (
        'confirmed', 'only published', 'dead-lettered', 'dropped', 'skipped', 'returned',
        'given up', 'spooled', 'lost on a damaged disk',
    )  # fmt: skip
    assert found['taken'] == sum(found.get(end, 0) for end in ends), line
    return found


def to_ros(kafka: str, ros: str, name: str = 'to_ros', **more: Any) -> dict[str, Any]:
    """A route Kafka -> ROS for std_msgs/String as text, from the earliest record."""
    source = {'kafka': kafka, 'start': 'earliest'}
    sink = {'ros': ros, 'type': 'std_msgs/msg/String'}
    return {'name': name, 'from': source, 'to': sink, 'format': 'text', **more}


def to_kafka(ros: str, kafka: str, name: str = 'to_kafka', **more: Any) -> dict[str, Any]:
    """A route ROS -> Kafka for std_msgs/String as text."""
    source = {'ros': ros, 'type': 'std_msgs/msg/String'}
    return {'name': name, 'from': source, 'to': {'kafka': kafka}, 'format': 'text', **more}
