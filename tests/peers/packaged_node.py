"""A robot's ordinary node: it has the package of its type, publishes objects of it, and spins.

What it publishes and what comes are written line by line, as Python prints the objects.
"""

import argparse
import importlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message


def qos(durability: str) -> QoSProfile:
    """RELIABLE and KEEP_ALL."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy[durability.upper()],
    )


def main() -> None:
    """Publish the messages of files of hex as objects, take objects, and spin."""
    parser = argparse.ArgumentParser()
    parser.add_argument('message_type')
    parser.add_argument('--publish', action='append', default=[], metavar='TOPIC=HEX=FILE')
    parser.add_argument('--take', action='append', default=[], metavar='TOPIC=FILE')
    parser.add_argument('--durability', default='transient_local')
    parser.add_argument('--readers', type=int, default=0, help='wait for so many first')
    args = parser.parse_args()
    package, _, short = args.message_type.split('/')
    kind: Any = getattr(importlib.import_module(f'{package}.msg'), short)
    rclpy.init()
    node = rclpy.create_node(f'{package}_node')
    for topic, file in (one.split('=') for one in args.take):
        node.create_subscription(kind, topic, writer_of(Path(file)), qos(args.durability))
    for topic, sent, file in (one.split('=') for one in args.publish):
        publisher = node.create_publisher(kind, topic, qos(args.durability))
        while publisher.get_subscription_count() < args.readers:
            rclpy.spin_once(node, timeout_sec=0.05)
        write = writer_of(Path(file))
        for line in Path(sent).read_text().split():
            message = deserialize_message(bytes.fromhex(line), kind)
            write(message)
            publisher.publish(message)
    print('ready', flush=True)  # noqa: T201
    rclpy.spin(node)


def writer_of(path: Path) -> Any:
    """Make what appends each message to a file."""

    def write(message: Any) -> None:
        with path.open('a') as file:
            file.write(f'{message!r}\n')

    return write


with suppress(KeyboardInterrupt):
    main()
