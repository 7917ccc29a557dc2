"""Numbers through a bridge, both ways, and what of them has arrived.

python -m benchmarks.numbers FILE /topic

That is a node of ROS which counts, and writes it down at SIGTERM.
"""

import json
import signal
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from threading import Event
from typing import Final, NamedTuple

from benchmarks.processes import programs
from benchmarks.topics import topics
from rig.processes import Process, Programs
from rig.topics import records

BYTES: Final = 500
START_S: Final = 60.0
END_S: Final = 120.0
COUNTED: Final = 'counted.json'

BOTH_WAYS: Final = """\
name: numbers
kafka: {{bootstrap.servers: '{servers}'}}
defaults: {defaults}
routes:
  - name: to_ros
    from: {{kafka: {mark}.source, start: earliest}}
    to: {{ros: /to_ros_{mark}, type: std_msgs/msg/String}}
    format: text
  - name: to_kafka
    from: {{ros: /to_kafka_{mark}, type: std_msgs/msg/String}}
    to: {{kafka: {mark}.sink}}
    format: text
"""
"""A bridge for numbers, with a route each way."""


class Count(NamedTuple):
    """What has arrived of the numbers from 0 on.

    Args:
        different: How many different ones.
        repeated: How many came again.
        highest: The highest one, -1 where none came.
        others: What is no number.
    """

    different: int
    repeated: int
    highest: int
    others: int

    def lost(self, sent: int) -> int:
        """How many of the numbers below `sent` have not arrived."""
        return sent - self.different


class Counter:
    """Counts numbers as they come."""

    def __init__(self) -> None:
        self._seen = bytearray()
        self._different = self._repeated = self._others = 0

    def add(self, text: bytes) -> None:
        """Count one; what follows a blank is padding."""
        word = text[:13].partition(b' ')[0]
        if not word.isdigit():
            self._others += 1
            return
        number = int(word)
        if number >= len(self._seen):
            self._seen += bytes(number + 1000 - len(self._seen))
        self._repeated += self._seen[number]
        self._different += not self._seen[number]
        self._seen[number] = 1

    def count(self) -> Count:
        """Sum up."""
        return Count(self._different, self._repeated, self._seen.rfind(1), self._others)


class Stage(NamedTuple):
    """A bridge with a route each way, and a node that counts what comes to ROS.

    Args:
        mark: Part of the names of all topics.
    """

    servers: str
    mark: str
    at: Programs
    bridge: Process
    counter: Process

    @contextmanager
    def senders(self, to_ros: float, to_kafka: float) -> Iterator['Senders']:
        """Send so many numbers per second each way, to the end of the `with` or of one's own."""
        until = self.at.logs / f'until-{uuid.uuid4().hex[:8]}'
        words = '--size', str(BYTES), '--until', str(until), '--rate'
        kafka = self.servers, f'{self.mark}.source', *words, str(to_ros)
        ros = f'/to_kafka_{self.mark}', '--acknowledged', *words, str(to_kafka)
        with (
            self.at.peer(f'kafka-{until.name}', 'kafka_producer', *kafka) as sends_to_ros,
            self.at.peer(f'ros-{until.name}', 'publisher', *ros) as sends_to_kafka,
        ):
            for sender in (sends_to_ros, sends_to_kafka):
                sender.wait_for('ready', START_S)
            yield Senders(sends_to_ros, sends_to_kafka, until)

    def counted(self) -> Count:
        """What has come to ROS; ends who counts."""
        self.counter.end(END_S)
        return Count(**json.loads((self.at.logs / COUNTED).read_text()))

    def counted_in_kafka(self, end: int) -> Count:
        """What has come to Kafka, below an offset."""
        counter = Counter()
        for record in islice(records(self.servers, f'{self.mark}.sink'), end):
            counter.add(record.value() or b'')
        return counter.count()


class Senders(NamedTuple):
    """What sends the numbers of both ways."""

    to_ros: Process
    to_kafka: Process
    until: Path

    def end(self) -> tuple[int, int]:
        """Let both come to their end; returns how many they have sent, and are acknowledged."""
        self.until.touch()
        for sender in (self.to_ros, self.to_kafka):
            sender.wait_for('published', END_S)
        to_ros, to_kafka = (
            int(sender.output().rpartition('published ')[2])
            for sender in (self.to_ros, self.to_kafka)
        )
        return to_ros, to_kafka


@contextmanager
def staged(
    servers: str, place: Path, domain: int, stem: str, defaults: str = '{}'
) -> Iterator[Stage]:
    """Start a bridge with two routes, and a reader that counts.

    Args:
        servers: Of a Kafka.
        place: A directory for files.
        domain: ROS domain.
        stem: Of the names of topics.
        defaults: Of the routes.
    """
    mark = f'{stem}_{uuid.uuid4().hex[:8]}'
    at = programs(place, domain)
    file = place / 'bridge.yaml'
    file.write_text(BOTH_WAYS.format(servers=servers, mark=mark, defaults=defaults))
    words = '-m', 'benchmarks.numbers', str(place / COUNTED), f'/to_ros_{mark}'
    with (
        topics(servers, [f'{mark}.source', f'{mark}.sink']),
        at.bridge('bridge', file) as bridge,
        at.python('count', *words) as counter,
    ):
        for what in ('subscribes to', ' reads '):
            bridge.wait_for(what, START_S)
        counter.wait_for('ready', START_S)
        yield Stage(servers, mark, at, bridge, counter)


def main() -> None:
    """Count what comes from ROS until told to end."""
    import rclpy  # noqa: PLC0415 (not for those who start this)
    from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from std_msgs.msg import String  # noqa: PLC0415

    from rig.peers.ends import qos  # noqa: PLC0415

    file, topic = sys.argv[1:]
    asked = Event()
    signal.signal(signal.SIGTERM, lambda *_: asked.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('counter')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    counter = Counter()
    # The bytes of a String: header, length, text, NUL.
    node.create_subscription(String, topic, lambda cdr: counter.add(cdr[8:30]), qos(), raw=True)
    print('ready', flush=True)
    while not asked.is_set():
        executor.spin_once(timeout_sec=0.1)
    counted = None
    while counted != (counted := counter.count()):  # what waits in the reader's cache
        executor.spin_once(timeout_sec=0.5)
    Path(file).write_text(json.dumps(counted._asdict()))


if __name__ == '__main__':
    main()
