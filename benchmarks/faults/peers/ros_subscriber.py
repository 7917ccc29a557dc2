"""A robot's node that reads orders, KEEP_ALL and reliable, and writes down which have come.

Each is written before the next one is taken: a SIGKILL shows exactly what had arrived.
"""

import argparse
import os
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from benchmarks.faults import orders
from benchmarks.faults.journal import ARRIVED, BEGUN, STRANGE, Journal
from rig.peers.ends import qos


def main() -> None:
    """Read until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('journal', type=Path)
    args = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f'subscriber_{os.getpid()}')
    journal = Journal(args.journal)

    def note(message: bytes) -> None:
        number = orders.number_of(orders.from_cdr(message))
        journal.write(STRANGE if number is None else ARRIVED, number or 0)

    node.create_subscription(String, args.topic, note, qos(), raw=True)
    journal.write(BEGUN, os.getpid())
    rclpy.spin(node)


main()
