"""Any user's node that reads std_msgs/String; appends what it gets to a file, line by line.

It is written before the next message is taken, so a SIGKILL shows exactly what had arrived.
"""

import argparse
import os
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String


def main() -> None:
    """Read a topic until told to end; prints `ready` when the subscription is made."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('file', type=Path)
    parser.add_argument('--reliability', default='reliable')
    parser.add_argument('--durability', default='volatile')
    parser.add_argument('--depth', type=int, default=0, help='KEEP_LAST of so many; 0: KEEP_ALL')
    parser.add_argument('--leave', type=Path, help='take as many as this file says, and wait')
    parser.add_argument('--work', type=float, default=0.0, help='seconds of work for a message')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'subscriber_{os.getpid()}')
    qos = QoSProfile(
        reliability=ReliabilityPolicy[args.reliability.upper()],
        durability=DurabilityPolicy[args.durability.upper()],
        history=HistoryPolicy.KEEP_LAST if args.depth else HistoryPolicy.KEEP_ALL,
        depth=args.depth,
    )
    taken = 0
    with args.file.open('ab', buffering=0) as file:

        def on_message(message: String) -> None:
            nonlocal taken
            taken += 1
            file.write(message.data.encode() + b'\n')
            if args.work:
                time.sleep(args.work)

        node.create_subscription(String, args.topic, on_message, qos)
        print('ready', flush=True)  # noqa: T201
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while True:
            if args.leave and taken >= int(args.leave.read_text()):
                time.sleep(0.01)
            else:
                executor.spin_once(timeout_sec=1.0)


main()
