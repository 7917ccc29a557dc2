"""The demonstration as a user runs it, and what it tells."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.processes.harness import Process

COUNTED = re.compile(
    r'bridge: Producer (?P<produced>\S+), Kafka-ROS (?P<kafka_ros>\S+), '
    r'ROS-Kafka (?P<ros_kafka>\S+), Consumer (?P<consumed>\S+), lost (?P<lost>\S+) \(.*%\)'
)


@contextmanager
def demo(place: Path, *options: str) -> Iterator[Process]:
    """Start a demonstration; its children must have gone when it has ended."""
    command = [sys.executable, '-m', 'ros2_kafka_bridge', 'demo', *options]
    with Process(command, place / 'out', {'TMPDIR': str(place)}) as process:
        yield process
    assert children_in(place) == [], 'a child is left'


def children_in(place: Path) -> list[int]:
    """The processes that a demonstration of this place has started."""
    found = []
    for entry in Path('/proc').glob('[0-9]*'):
        try:
            words = (entry / 'cmdline').read_bytes().split(b'\0')
            environ = (entry / 'environ').read_bytes()
        except OSError:  # it has ended meanwhile
            continue
        tells = any(word.startswith(b'--snapshots') for word in words)
        if tells and f'TMPDIR={place}\0'.encode() in environ:
            found.append(int(entry.name))
    return found


def counted(process: Process) -> dict[str, str]:
    """The line that sums up."""
    [match] = filter(None, map(COUNTED.match, process.output().splitlines()))
    return match.groupdict()


def numbers(result: dict[str, str]) -> dict[str, int]:
    """The same as numbers."""
    return {what: int(n.replace(',', '')) for what, n in result.items()}


def all_equal(result: dict[str, str]) -> bool:
    """Whether every order was counted everywhere, and none is lost."""
    moved = {result[name] for name in ('produced', 'kafka_ros', 'ros_kafka', 'consumed')}
    return len(moved) == 1 and moved != {'0'} and result['lost'] == '0'
