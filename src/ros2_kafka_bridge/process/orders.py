"""How the bridge of a worker does what its supervisor tells it."""

import os
import sys
from typing import TYPE_CHECKING

from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.lines import LineReader
from ros2_kafka_bridge.protocol.worker import (
    ORDERS,
    Begin,
    Drain,
    End,
    PauseRoute,
    ResumeRoute,
    WorkerOrder,
)

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge


def follow_orders(bridge: 'Bridge', after: int | None) -> None:
    """Do what is told by standard input; without a supervisor, drain in the same order.

    Args:
        bridge: Of this process.
        after: A pipe that ends with the workers that are to drain before; None for none.
    """
    reader = LineReader(sys.stdin.fileno())
    while not reader.has_ended:
        for line in reader.read():
            run_order(bridge, ORDERS.decode(line))
    if after is not None:
        os.read(after, 1)  # until the workers that publish to ROS have ended
    if not bridge.stop.asked:
        logs.route_log().error('the supervisor has gone: draining')
        bridge.stop.ask()


def run_order(bridge: 'Bridge', order: WorkerOrder) -> None:
    """Let a bridge do what it is told."""
    match order:
        case Drain():
            bridge.stop.ask()
        case Begin():
            bridge.begin()
        case End(routes):
            bridge.end(frozenset(routes))
        case PauseRoute(route):
            bridge.pause(route)
        case ResumeRoute(route):
            bridge.resume(route)
