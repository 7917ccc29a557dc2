"""A ROS node that writes a short hash of each message that it takes, 8 bytes each.

python -m benchmarks.hash_reader FILE /topic=pkg/msg/Type
"""

import argparse
import hashlib
import importlib
import signal
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

KEEP_ALL = QoSProfile(
    depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
)
DIGEST_BYTES = 8


def digest(cdr: bytes) -> bytes:
    """Hash a message without its header and without the zeros that may pad it."""
    return hashlib.blake2b(cdr[4:].rstrip(b'\0'), digest_size=DIGEST_BYTES).digest()


def main() -> None:
    """Read until told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('file', type=Path)
    parser.add_argument('topic', help='/topic=pkg/msg/Type')
    args = parser.parse_args()
    topic, _, name = args.topic.partition('=')
    package, _, type_name = name.split('/')
    message_type: Any = getattr(importlib.import_module(f'{package}.msg'), type_name)

    rclpy.init()
    signal.signal(signal.SIGTERM, lambda *_: rclpy.try_shutdown())
    node = rclpy.create_node('hash_reader')
    with args.file.open('ab', buffering=0) as file:
        node.create_subscription(
            message_type, topic, lambda cdr: file.write(digest(cdr)), KEEP_ALL, raw=True
        )
        print('ready', flush=True)
        try:
            rclpy.spin(node)
        except ExternalShutdownException:
            return


if __name__ == '__main__':
    main()
