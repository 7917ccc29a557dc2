"""Peers of a bridge that send numbers and count them, a process each, until SIGTERM.

python -m benchmarks.numbers kafka SERVERS TOPIC --rate 1000
python -m benchmarks.numbers ros /topic --rate 1000
python -m benchmarks.numbers count FILE /topic
"""

import argparse
import json
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

from confluent_kafka import Producer

from rig.topics import records

BYTES: Final = 500
STEP_S: Final = 0.005
FLUSH_S: Final = 60.0
_PADDING: Final = 'x' * (BYTES - 13)

BOTH_WAYS: Final = """\
name: numbers
kafka: {{bootstrap.servers: '{servers}'}}
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


def count_topic(bootstrap_servers: str, topic: str, end: int) -> Count:
    """Count the numbers that a topic of one partition holds below an offset."""
    counter = Counter()
    for record in islice(records(bootstrap_servers, topic), end):
        counter.add(record.value() or b'')
    return counter.count()


def text_of(number: int) -> str:
    """Write a number, padded."""
    return f'{number:012} {_PADDING}'


class _Asked:
    """Whether SIGTERM came."""

    def __init__(self) -> None:
        self.to_end = False
        signal.signal(signal.SIGTERM, self._on_signal)

    def _on_signal(self, *_: object) -> None:
        self.to_end = True


def _paced(rate: float, asked: _Asked) -> Iterator[int]:
    """Yield the numbers from 0 on, so many a second, until asked to end."""
    start_s = time.monotonic()
    number = 0
    while not asked.to_end:
        due = int((time.monotonic() - start_s) * rate)
        while number < due and not asked.to_end:
            yield number
            number += 1
        time.sleep(STEP_S)


def _to_kafka(servers: str, topic: str, rate: float) -> None:
    asked = _Asked()
    producer = Producer(
        {'bootstrap.servers': servers, 'enable.idempotence': True, 'linger.ms': 5, 'log_level': 3}
    )
    sent = 0
    print('ready', flush=True)
    for number in _paced(rate, asked):
        while not _tried(partial(producer.produce, topic, text_of(number)), BufferError):
            producer.poll(0.01)
        producer.poll(0)
        sent += 1
    left = producer.flush(FLUSH_S)
    print(f'sent {sent - left}', flush=True)


def _tried(act: Callable[[], object], busy: type[Exception], words: str = '') -> bool:
    """Do something; False where the other side is busy."""
    try:
        act()
    except busy as error:
        if words not in str(error):
            raise
        return False
    return True


def _to_ros(topic: str, rate: float) -> None:
    import rclpy  # noqa: PLC0415 (not for Kafka's side)
    from rclpy.duration import Duration  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from std_msgs.msg import String  # noqa: PLC0415

    asked = _Asked()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('numbers')
    publisher = node.create_publisher(String, topic, _keep_all())
    while not publisher.get_subscription_count() and not asked.to_end:
        time.sleep(0.01)
    time.sleep(1.0)  # the writer knows of the match before the reader does
    print('ready', flush=True)
    sent = 0
    for number in _paced(rate, asked):
        message = String(data=text_of(number))
        while not _tried(partial(publisher.publish, message), Exception, 'cannot publish data'):
            time.sleep(0.001)
        sent += 1
    # What is not acknowledged goes with the publisher.
    publisher.wait_for_all_acked(Duration(seconds=FLUSH_S))
    print(f'sent {sent}', flush=True)


def _count(file: Path, topic: str) -> None:
    import rclpy  # noqa: PLC0415 (not for Kafka's side)
    from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from std_msgs.msg import String  # noqa: PLC0415

    asked = _Asked()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('counter')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    counter = Counter()
    # The bytes of a String: header, length, text, NUL.
    node.create_subscription(
        String, topic, lambda cdr: counter.add(cdr[8:30]), _keep_all(), raw=True
    )
    print('ready', flush=True)
    while not asked.to_end:
        executor.spin_once(timeout_sec=0.1)
    counted = None
    while counted != (counted := counter.count()):  # what waits in the reader's cache
        executor.spin_once(timeout_sec=0.5)
    file.write_text(json.dumps(counted._asdict()))


def _keep_all() -> Any:
    from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy  # noqa: PLC0415

    return QoSProfile(
        depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
    )


def main() -> None:
    """Play one part until told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts = parser.add_subparsers(dest='part', required=True)
    kafka = parts.add_parser('kafka', help='send to Kafka')
    kafka.add_argument('servers')
    ros = parts.add_parser('ros', help='send to ROS')
    count = parts.add_parser('count', help='count what comes from ROS')
    count.add_argument('file', type=Path)
    for part in (kafka, ros, count):
        part.add_argument('topic')
    for part in (kafka, ros):
        part.add_argument('--rate', type=float, required=True, help='numbers per second')
    args = parser.parse_args()
    if args.part == 'kafka':
        _to_kafka(args.servers, args.topic, args.rate)
    elif args.part == 'ros':
        _to_ros(args.topic, args.rate)
    else:
        _count(args.file, args.topic)


if __name__ == '__main__':
    main()
