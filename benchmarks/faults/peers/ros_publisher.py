"""A robot's node that publishes numbered orders, KEEP_ALL; waits when its history is full."""

import os
import time
from typing import Any, Final

import rclpy
from rclpy.duration import Duration
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from benchmarks.faults import orders
from benchmarks.faults.peers.sending import Commands, parser_of_sender, send
from rig.peers.ends import has_published, qos, wait_for_readers

_FULL_S: Final = 0.005
_AT_ONCE: Final = Duration(seconds=0)


class Robot:
    """Where the orders of a publisher go."""

    hostile = tuple(kind for kind in orders.HOSTILE if kind.is_ros)

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def send(self, number: int, kind: orders.Hostile, _: int) -> None:
        """Publish an order; waits while the history is full."""
        message = orders.to_cdr(kind.make(number) or b'')
        while not has_published(self._publisher, message):
            time.sleep(_FULL_S)

    def has_all(self) -> bool:
        """Whether all is acknowledged."""
        return bool(self._publisher.wait_for_all_acked(_AT_ONCE))


def main() -> None:
    """Publish until it is ended."""
    parser = parser_of_sender()
    parser.add_argument('--durability', required=True)
    args = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f'publisher_{os.getpid()}')
    publisher = node.create_publisher(String, args.topic, qos(args.durability))
    commands = Commands(args.commands)
    wait_for_readers([publisher])
    send(Robot(publisher), commands, args)


main()
