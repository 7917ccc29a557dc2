"""The published Kafka-ROS algorithm: a timer publishes every record that waits.

    python -m benchmarks.contestants.paper_kafka_ros localhost:9092 orders /orders --depth 10

Default clients, default QoS (KEEP_LAST) with the depth that is given. It waits for the subscriber
before it spins, which was not published: else a start before the match would lose whatever it
publishes until then, and one would measure discovery. `--record FILE` notes when it publishes.
"""

import contextlib
import time
from array import array
from typing import Any

import rclpy
from confluent_kafka import Consumer
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import String

from benchmarks.contestants.node import Count, arguments

PERIOD_S = 0.01
SETTLE_S = 1.0


def main() -> None:
    """Spin until told to end."""
    given = arguments(__doc__)
    count = Count('kafka_to_ros', given.snapshots)
    rclpy.init(args=['--ros-args', '--disable-external-lib-logs'])  # a home may be read-only
    node = rclpy.create_node('kafka_ros_bridge')
    publisher = node.create_publisher(String, given.ros_topic, given.depth)
    consumer = Consumer(
        {
            'bootstrap.servers': given.bootstrap_servers,
            'group.id': f'{given.kafka_topic}.paper',
            'auto.offset.reset': 'earliest',
            **given.properties,
        }
    )
    consumer.subscribe([given.kafka_topic])
    count.start()
    while rclpy.ok() and not publisher.get_subscription_count():
        time.sleep(0.01)
    time.sleep(SETTLE_S)  # the writer knows of the match before the reader does
    published_ns = None if given.record is None else array('q')
    node.create_timer(PERIOD_S, lambda: publish(consumer, publisher, count, published_ns))
    try:
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(node)
    finally:
        count.tell()  # also where the end met it in the middle of a callback
    consumer.close()
    if given.record is not None and published_ns is not None:
        given.record.write_text('\n'.join(map(str, published_ns)), encoding='ascii')


def publish(
    consumer: Consumer, publisher: Any, count: Count, published_ns: 'array[int] | None'
) -> None:
    """Publish every record in the consumer."""
    while (record := consumer.poll(0)) is not None:
        value = record.value()
        if record.error() is None and value is not None:
            if published_ns is not None:
                published_ns.append(time.time_ns())
            publisher.publish(String(data=value.decode()))
            count.confirmed += 1


if __name__ == '__main__':
    main()
