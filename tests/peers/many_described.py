"""A robot's node with many topics of types that it alone describes, a message on each.

Usage: many_described.py PREFIX TYPES TOPICS; topic `/t7` is of the type `acme_many/msg/T7`, as far
as there are so many types. It prints `ready` when it spins.
"""

import os
import sys
from contextlib import suppress

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class


def main(prefix: str, types: int, topics: int) -> None:
    """Publish, and spin."""
    os.environ['AMENT_PREFIX_PATH'] = prefix
    rclpy.init()
    node = rclpy.create_node('robot')
    qos = QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    for number in range(topics):
        name = f'acme_many/msg/T{number % types}'
        publisher = node.create_publisher(
            endpoint_class(name, describe(name).types), f'/t{number}', qos
        )
        publisher.publish(b'\0\1\0\0' + number.to_bytes(8, 'little'))
    print('ready', flush=True)  # noqa: T201
    rclpy.spin(node)


with suppress(KeyboardInterrupt):
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
