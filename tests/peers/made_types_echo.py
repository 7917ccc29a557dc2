"""Takes messages of many types, each made of its description, and publishes the same bytes again.

It takes `/there/TYPE` and publishes `/back/TYPE`, and prints `ready` when all endpoints are there.
"""

import sys
import time
from contextlib import suppress
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.ros.take import take
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class


def main(names: list[str]) -> None:
    """Echo until killed."""
    rclpy.init()
    node = rclpy.create_node('made_types_echo')
    qos = QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    ends: list[tuple[Any, Any]] = []
    for name in names:
        made = endpoint_class(name, describe(name).types)
        publisher = node.create_publisher(made, f'/back/{name}', qos)
        reader = node.create_subscription(made, f'/there/{name}', print, qos, raw=True)
        ends.append((reader, publisher))
    print('ready', flush=True)  # noqa: T201
    while True:
        for reader, publisher in ends:
            for cdr, _ in take(reader, 100)[0]:
                publisher.publish(bytes(cdr))
        time.sleep(0.01)


with suppress(KeyboardInterrupt):
    main(sys.argv[1:])
