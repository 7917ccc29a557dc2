"""Any user's node that reads many topics; appends each message to a file, `topic hex` a line.

The first file says what it reads, `topic type` a line; prints `ready` when all is subscribed.
"""

import argparse
import importlib
import os
from functools import partial
from pathlib import Path
from typing import BinaryIO

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy


def main() -> None:
    """Read topics until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topics', type=Path)
    parser.add_argument('file', type=Path)
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'many_subscriber_{os.getpid()}')
    qos = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)
    with args.file.open('ab', buffering=0) as file:
        for line in args.topics.read_text().splitlines():
            topic, kind_name = line.split(' ')
            package, _, name = kind_name.split('/')
            kind = getattr(importlib.import_module(f'{package}.msg'), name)
            node.create_subscription(kind, topic, partial(write, file, topic), qos, raw=True)
        print('ready', flush=True)  # noqa: T201
        rclpy.spin(node)


def write(file: BinaryIO, topic: str, cdr: bytes) -> None:
    """Append a message."""
    file.write(f'{topic} {cdr.hex()}\n'.encode())


main()
