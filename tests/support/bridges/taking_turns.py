"""Bridges of one name that take turns at a route from ROS."""

import re
import time
from collections.abc import Iterable
from pathlib import Path

from confluent_kafka import Message
from support.bridges.routes import to_kafka, values
from support.processes.harness import Bench, Process, eventually, headers

from ros2_kafka_bridge.dedup import Deduplicator

RATE = 300
TAKES = 'takes over: this bridge runs the route'
HANDS = 'hands over: another bridge runs this route'
STANDS_BY = 'stands by: another bridge runs this route'


def exclusive(bench: Bench, name: str, topic: str) -> Path:
    """A file that several bridges run."""
    bench.create_topic(topic)
    route = to_kafka('/orders', topic, exclusive=True)
    return bench.config([route], name=name, ros={'lease_s': 3})


def runs(bridge: Process) -> bool:
    """Whether it is the one that runs its route, by what it has said."""
    said = bridge.output()
    return said.count(TAKES) > said.count(HANDS)


def wait_for_order(bench: Bench, topic: str, order: int, *bridges: Process) -> None:
    """Wait until the topic holds so many records."""
    eventually(
        lambda: bench.reaches(topic, order), 60, lambda: '\n'.join(b.output() for b in bridges)
    )


def wait_for_all(bench: Bench, topic: str, count: int, *bridges: Process) -> list[Message]:
    """Wait until each of the numbers from 1 has come; returns all records, in their order."""
    wait_for_order(bench, topic, count, *bridges)
    found: list[Message] = []

    def complete() -> bool:
        found[:] = bench.records(topic, bench.end_offset(topic))
        return len({headers(record)['ros.seq'] for record in found}) >= count

    eventually(complete, 60, lambda: '\n'.join(b.output() for b in bridges))
    return found


def assert_each_once_in_order(records: Iterable[Message], count: int) -> None:
    """Nothing lost, and nothing doubled once the repeats are left out."""
    dedup = Deduplicator()
    once = list(dedup.without_repeats(records))
    assert [int(headers(record)['ros.seq']) for record in once] == list(range(1, count + 1))
    assert values(once) == [b'%d' % number for number in range(count)]
    assert dedup.gaps() == {}


def said_at_s(bridge: Process, text: str) -> float:
    """When a bridge said something first, in seconds of its day."""
    found = re.search(rf' (\d+):(\d+):(\d+),(\d+) .*{re.escape(text)}', bridge.output())
    assert found, bridge.output()
    hours, minutes, seconds, ms = map(int, found.groups())
    return hours * 3600 + minutes * 60 + seconds + ms / 1000


def now_s() -> float:
    """What time it is, in seconds of the day."""
    here = time.localtime()
    return here.tm_hour * 3600 + here.tm_min * 60 + here.tm_sec + time.time() % 1


def tell(what: str, seconds: float) -> None:
    """Say how long something took; shown with `-s`."""
    print(f'{what}: {seconds:.1f} s')  # noqa: T201
