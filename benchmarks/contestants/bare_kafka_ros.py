"""The limit, Kafka -> ROS: consume and publish bytes, and nothing else.

No check of what is published, no confirmation, no commit, one number that counts. The DDS
settings are the bridge's own; the Kafka client has its default, larger prefetch.
"""

import signal
import struct
import sys
import time
from collections.abc import Callable, Mapping

from confluent_kafka import Consumer
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String

from benchmarks.contestants.node import Count, arguments
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.qos import profile

BATCH = 500
HISTORY = 500
NAP_S = 0.0005
SETTLE_S = 1.0


def main() -> None:
    """Move records until told to end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    given = arguments(__doc__)
    count = Count('kafka_to_ros', given.snapshots)
    with open_node('bare_kafka_ros', None, Histories({given.ros_topic: HISTORY}, {})) as node:
        publisher = node.handle.create_publisher(String, given.ros_topic, profile(QoS()))
        count.start()
        while not publisher.get_subscription_count():
            time.sleep(0.01)
        time.sleep(SETTLE_S)  # the writer knows of the match before the reader does
        consumer = consumer_of(given.bootstrap_servers, given.kafka_topic, given.properties)
        try:
            move(consumer, publisher.publish, count)
        finally:
            count.tell()


def consumer_of(bootstrap_servers: str, topic: str, properties: Mapping[str, str]) -> Consumer:
    """Subscribe from the earliest record."""
    consumer = Consumer(
        {
            'bootstrap.servers': bootstrap_servers,
            'group.id': f'{topic}.bare',
            'auto.offset.reset': 'earliest',
            'enable.auto.commit': False,
            **properties,
        }
    )
    consumer.subscribe([topic])
    return consumer


def move(consumer: Consumer, publish: Callable[[bytes], None], count: Count) -> None:
    """Publish each record; while the history is full, sleep and try again."""
    full = rclpy_implementation.RCLError
    prefix = struct.Struct('<4sI').pack
    while True:
        first = consumer.poll(0.1)
        if first is None:
            continue
        records = (first, *consumer.consume(BATCH - 1, 0.0))
        for record in records:
            value = record.value() or b''
            cdr = prefix(b'\0\1\0\0', len(value) + 1) + value + b'\0'
            while True:
                try:
                    publish(cdr)
                except full:
                    time.sleep(NAP_S)
                else:
                    break
        count.confirmed += len(records)


main()
