"""The limit, Kafka -> ROS: consume and publish bytes, and nothing else.

No check of what is published, no confirmation, no commit, no counter. The DDS settings are the
bridge's own; the Kafka client has its default, larger prefetch.
"""

import struct
import sys
import time
from collections.abc import Callable

from confluent_kafka import Consumer
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.profile import Endpoints
from ros2_kafka_bridge.ros.qos import profile

BATCH = 500
HISTORY = 500
NAP_S = 0.0005
SETTLE_S = 0.5


def main() -> None:
    """Move records until killed."""
    bootstrap_servers, kafka_topic, ros_topic = sys.argv[1:]
    with open_node('bare_kafka_ros', None, Endpoints({ros_topic: HISTORY}, {})) as node:
        publisher = node.handle.create_publisher(String, ros_topic, profile(QoS()))
        while not publisher.get_subscription_count():
            time.sleep(0.01)
        time.sleep(SETTLE_S)  # the writer knows of the match before the reader does
        move(consumer_of(bootstrap_servers, kafka_topic), publisher.publish)


def consumer_of(bootstrap_servers: str, topic: str) -> Consumer:
    """Subscribe from the earliest record."""
    consumer = Consumer(
        {
            'bootstrap.servers': bootstrap_servers,
            'group.id': 'bare',
            'auto.offset.reset': 'earliest',
            'enable.auto.commit': False,
        }
    )
    consumer.subscribe([topic])
    return consumer


def move(consumer: Consumer, publish: Callable[[bytes], None]) -> None:
    """Publish each record; while the history is full, sleep and try again."""
    full = rclpy_implementation.RCLError
    prefix = struct.Struct('<4sI').pack
    while True:
        first = consumer.poll(0.1)
        if first is None:
            continue
        for record in (first, *consumer.consume(BATCH - 1, 0.0)):
            value = record.value() or b''
            cdr = prefix(b'\0\1\0\0', len(value) + 1) + value + b'\0'
            while True:
                try:
                    publish(cdr)
                except full:
                    time.sleep(NAP_S)
                else:
                    break


main()
