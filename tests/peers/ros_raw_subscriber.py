"""Any user's node that reads a topic as CDR bytes; appends each in hex to a file, line by line."""

import argparse
import importlib
import os
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def main() -> None:
    """Read a topic until told to end; prints `ready` when the subscription is made."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('type')
    parser.add_argument('file', type=Path)
    parser.add_argument('--durability', default='volatile')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'raw_subscriber_{os.getpid()}')
    package, _, name = args.type.split('/')
    kind = getattr(importlib.import_module(f'{package}.msg'), name)
    qos = QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy[args.durability.upper()],
        history=HistoryPolicy.KEEP_ALL,
    )
    with args.file.open('ab', buffering=0) as file:
        node.create_subscription(
            kind, args.topic, lambda cdr: file.write(cdr.hex().encode() + b'\n'), qos, raw=True
        )
        print('ready', flush=True)  # noqa: T201
        rclpy.spin(node)


main()
