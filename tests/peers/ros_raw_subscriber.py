"""Any user's node that reads a topic as CDR bytes; appends each in hex to a file, line by line."""

import argparse
import importlib
import os
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def main() -> None:
    """Read a topic until told to end; prints `ready` when the subscription is made."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('type')
    parser.add_argument('file', type=Path)
    parser.add_argument('--durability', default='volatile')
    parser.add_argument('--leave', type=Path, help='take as many as this file says, and wait')
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
    taken = 0
    with args.file.open('ab', buffering=0) as file:

        def on_message(cdr: bytes) -> None:
            nonlocal taken
            taken += 1
            file.write(cdr.hex().encode() + b'\n')

        node.create_subscription(kind, args.topic, on_message, qos, raw=True)
        print('ready', flush=True)  # noqa: T201
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while True:
            if args.leave and taken >= int(args.leave.read_text()):
                time.sleep(0.01)
            else:
                executor.spin_once(timeout_sec=1.0)


main()
