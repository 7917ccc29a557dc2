"""Any user's node with many topics: publishes the messages of a file, `topic type hex` a line.

Publishes message objects, not bytes. Waits for the readers of each topic first, prints
`published N` when all is out and `not acknowledged: TOPICS` where a reader lets it wait, and stays
until SIGTERM.
"""

import argparse
import importlib
import os
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

PATIENCE = Duration(seconds=10)


def main() -> None:
    """Publish the messages of a file, once."""
    parser = argparse.ArgumentParser()
    parser.add_argument('file', type=Path)
    parser.add_argument('--readers', type=int, default=1, help='of each topic, to wait for')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'many_publisher_{os.getpid()}')
    qos = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)
    publishers: dict[str, Any] = {}
    messages = []
    for line in args.file.read_text().splitlines():
        topic, kind_name, cdr = line.split(' ')
        package, _, name = kind_name.split('/')
        kind = getattr(importlib.import_module(f'{package}.msg'), name)
        if topic not in publishers:
            publishers[topic] = node.create_publisher(kind, topic, qos)
        messages.append((publishers[topic], deserialize_message(bytes.fromhex(cdr), kind)))
    while any(one.get_subscription_count() < args.readers for one in publishers.values()):
        time.sleep(0.01)
    time.sleep(1.0)  # a writer knows of the match before the reader does
    for publisher, message in messages:
        publisher.publish(message)
    print(f'published {len(messages)}', flush=True)  # noqa: T201
    late = [topic for topic, one in publishers.items() if not one.wait_for_all_acked(PATIENCE)]
    if late:
        print(f'not acknowledged: {" ".join(late)}', flush=True)  # noqa: T201
    while rclpy.ok():
        time.sleep(0.05)


main()
