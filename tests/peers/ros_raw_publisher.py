"""Any user's node that publishes the CDR bytes of a file, a message in hex on each line.

Prints its gid, then `published N` when all is out, and stays until SIGTERM.
"""

import argparse
import importlib
import os
import time
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message


def main() -> None:
    """Publish the messages of a file, once."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('type')
    parser.add_argument('file', type=Path)
    parser.add_argument('--typed', action='store_true', help='as message objects, not as bytes')
    parser.add_argument('--durability', default='volatile')
    parser.add_argument('--reliability', default='reliable')
    parser.add_argument('--period', type=float, default=0.0, help='seconds between two')
    parser.add_argument('--readers', type=int, default=1, help='wait for so many first')
    parser.add_argument('--leave', type=Path, help='publish as many as this file says, and wait')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'raw_publisher_{os.getpid()}')
    package, _, name = args.type.split('/')
    kind = getattr(importlib.import_module(f'{package}.msg'), name)
    qos = QoSProfile(
        reliability=ReliabilityPolicy[args.reliability.upper()],
        durability=DurabilityPolicy[args.durability.upper()],
        history=HistoryPolicy.KEEP_ALL,
    )
    publisher = node.create_publisher(kind, args.topic, qos)
    own = [
        bytes(info.endpoint_gid)[:16].hex()
        for info in node.get_publishers_info_by_topic(args.topic)
        if info.node_name == node.get_name()
    ]
    print(f'gid {own[0]}', flush=True)  # noqa: T201
    while rclpy.ok() and publisher.get_subscription_count() < args.readers:
        time.sleep(0.01)
    if args.readers:
        time.sleep(1.0)  # the writer knows of the match before the reader does
    messages = [bytes.fromhex(line) for line in args.file.read_text().split()]
    for number, message in enumerate(messages):
        while args.leave and number >= int(args.leave.read_text()):
            time.sleep(0.005)
        publisher.publish(deserialize_message(message, kind) if args.typed else message)
        time.sleep(args.period)
    print(f'published {len(messages)}', flush=True)  # noqa: T201
    while rclpy.ok():
        time.sleep(0.05)
    node.destroy_node()


main()
