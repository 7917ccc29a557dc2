"""Any user's node that publishes std_msgs/String; waits when its history is full.

Prints `held back from N` where the next one, number N, has to wait, and `published N` when all is
out; then it stays until it is told to end: a TRANSIENT_LOCAL publisher keeps its history as long
as it lives. With `--leave FILE` the size of `FILE.out` is how many are out.
"""

import argparse
import itertools
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String


def paced(count: int | None, rate: float, leave: Path | None) -> Iterator[int]:
    """The numbers from 0, each when it is its turn."""
    due_s, allowed = time.monotonic(), 0
    for number in itertools.count() if count is None else range(count):
        while leave and number >= allowed:
            allowed = int(leave.read_text())
            due_s = time.monotonic()
            time.sleep(0.005)
        if rate:
            time.sleep(max(0.0, due_s - time.monotonic()))
            due_s += 1 / rate
        yield number


def publish(publisher: Any, message: String) -> None:
    """Publish it, once the history has room."""
    if has_published(publisher, message):
        return
    print(f'held back from {message.data.strip()}', flush=True)  # noqa: T201
    while not has_published(publisher, message):
        time.sleep(0.001)


def has_published(publisher: Any, message: String) -> bool:
    """Publish it, if the history has room."""
    try:
        publisher.publish(message)
    except Exception as error:
        if 'cannot publish data' not in str(error):
            raise
        return False
    return True


def main() -> None:
    """Publish `--prefix` with a number behind it, `--count` times or until a file is there."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('--count', type=int, help='without it until --until')
    parser.add_argument('--until', type=Path, help='publish until this file is there')
    parser.add_argument('--leave', type=Path, help='publish as many as this file says, and wait')
    parser.add_argument('--rate', type=float, default=0.0, help='messages/s, 0 is no limit')
    parser.add_argument('--prefix', default='')
    parser.add_argument('--size', type=int, default=0, help='pad each to so many characters')
    parser.add_argument('--reliability', default='reliable')
    parser.add_argument('--durability', default='volatile')
    parser.add_argument('--depth', type=int, default=0, help='KEEP_LAST of so many; 0: KEEP_ALL')
    parser.add_argument('--readers', type=int, default=1, help='wait for so many first')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'publisher_{os.getpid()}')
    qos = QoSProfile(
        reliability=ReliabilityPolicy[args.reliability.upper()],
        durability=DurabilityPolicy[args.durability.upper()],
        history=HistoryPolicy.KEEP_LAST if args.depth else HistoryPolicy.KEEP_ALL,
        depth=args.depth,
    )
    publisher = node.create_publisher(String, args.topic, qos)
    while publisher.get_subscription_count() < args.readers:
        time.sleep(0.01)
    if args.readers:
        time.sleep(1.0)  # the writer knows of the match before the reader does
    published = 0
    # A byte for each that is out: how long it is cannot be read half written.
    out = args.leave and args.leave.with_suffix('.out').open('ab', buffering=0)
    for number in paced(args.count, args.rate, args.leave):
        if args.until and args.until.exists():
            break
        publish(publisher, String(data=f'{args.prefix}{number}'.ljust(args.size)))
        published += 1
        if out:
            out.write(b'.')
    print(f'published {published}', flush=True)  # noqa: T201
    while True:
        time.sleep(1)


main()
