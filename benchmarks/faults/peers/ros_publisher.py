"""A robot's node that publishes numbered orders, KEEP_ALL; waits when its history is full.

It is told by a file: `hostile N` makes the next N orders hostile ones, `enough` ends the
publishing and keeps the node: a TRANSIENT_LOCAL history lives as long as its node.
"""

import argparse
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from benchmarks.faults import orders
from benchmarks.faults.journal import ACKNOWLEDGED, BEGUN, HOSTILE, SENT, Journal
from benchmarks.faults.peers.commands import Commands, Pace

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

_FULL_S: Final = 0.005
_SETTLE_S: Final = 1.0  # the writer knows of a match before the reader does
_AT_ONCE: Final = Duration(seconds=0)


class Sender:
    """Publishes orders and writes down which.

    An order is written down before it is handed over, so that none is sent that is not known.
    """

    def __init__(
        self, publisher: 'Publisher[String]', journal: Journal, first: int, seed: int
    ) -> None:
        self._publisher = publisher
        self._journal = journal
        self._number = first
        self._acknowledged = first - 1
        self._make = orders.numbered(seed)
        self._kinds = orders.in_turn([kind for kind in orders.HOSTILE if kind.is_ros])

    def send(self, *, hostile: bool) -> None:
        """Publish the next order; waits while the history is full."""
        value = self._make(self._number)
        if hostile:
            value = next(self._kinds).make(self._number) or b''
        self._journal.write(HOSTILE if hostile else SENT, self._number)
        message = orders.to_cdr(value)
        while not self._taken(message):
            time.sleep(_FULL_S)
        self._number += 1

    def note_acknowledged(self) -> None:
        """Write down up to where all is acknowledged: that can no longer die with this node."""
        sent = self._number - 1
        if sent > self._acknowledged and self._publisher.wait_for_all_acked(_AT_ONCE):
            self._journal.write(ACKNOWLEDGED, sent)
            self._acknowledged = sent

    def _taken(self, message: bytes) -> bool:
        try:
            self._publisher.publish(message)
        except Exception as error:
            if 'cannot publish data' not in str(error):
                raise
            return False
        return True


def main() -> None:
    """Publish until it is ended."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('journal', type=Path)
    parser.add_argument('commands', type=Path)
    parser.add_argument('--durability', required=True)
    parser.add_argument('--rate', type=float, required=True)
    parser.add_argument('--first', type=int, default=0, help='number of the first order')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f'publisher_{os.getpid()}')
    publisher = _publisher(node, args.topic, args.durability)
    journal = Journal(args.journal)
    commands = Commands(args.commands)
    _wait_for_reader(publisher)
    journal.write(BEGUN, os.getpid())
    _publish(Sender(publisher, journal, args.first, args.seed), commands, Pace(args.rate))


def _publisher(node: Node, topic: str, durability: str) -> 'Publisher[String]':
    qos = QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy[durability.upper()],
        history=HistoryPolicy.KEEP_ALL,
    )
    return node.create_publisher(String, topic, qos)


def _wait_for_reader(publisher: 'Publisher[String]') -> None:
    while publisher.get_subscription_count() < 1:
        time.sleep(0.02)
    time.sleep(_SETTLE_S)


def _publish(sender: Sender, commands: Commands, pace: Pace) -> None:
    hostile, enough = 0, False
    while True:
        pace.wait()
        for words in commands():
            hostile += int(words[1]) if words[0] == 'hostile' else 0
            enough = enough or words[0] == 'enough'
        sender.note_acknowledged()
        if not enough:
            sender.send(hostile=hostile > 0)
            hostile = max(0, hostile - 1)


main()
