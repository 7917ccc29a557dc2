"""The published Kafka-ROS algorithm: a timer publishes every record that waits.

Default clients, default QoS (KEEP_LAST, depth 10). It waits for the subscriber before it spins,
which was not published: else a start before the match would lose whatever it publishes until
then, and the drain would measure discovery.
"""

import contextlib
import sys
import time
from typing import Any

import rclpy
from confluent_kafka import Consumer
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import String

DEPTH = 10
PERIOD_S = 0.01
SETTLE_S = 0.5


def main() -> None:
    """Spin until told to end."""
    bootstrap_servers, kafka_topic, ros_topic = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node('kafka_ros_bridge')
    publisher = node.create_publisher(String, ros_topic, DEPTH)
    consumer = Consumer(
        {
            'bootstrap.servers': bootstrap_servers,
            'group.id': 'paper',
            'auto.offset.reset': 'earliest',
        }
    )
    consumer.subscribe([kafka_topic])
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    time.sleep(SETTLE_S)  # the writer knows of the match before the reader does
    node.create_timer(PERIOD_S, lambda: publish(consumer, publisher))
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)
    consumer.close()


def publish(consumer: Consumer, publisher: Any) -> None:
    """Publish every record in the consumer."""
    while (record := consumer.poll(0)) is not None:
        value = record.value()
        if record.error() is None and value is not None:
            publisher.publish(String(data=value.decode()))


main()
