"""The published ROS-Kafka algorithm: a subscription's callback produces each message.

Default client, default QoS (KEEP_LAST, depth 10). One line is added to what was published: the
callback serves the producer (`poll`). Without it the producer's queue is full after 100,000
messages, and the node dies of it.
"""

import contextlib
import sys

import rclpy
from confluent_kafka import Producer
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import String

DEPTH = 10


def main() -> None:
    """Spin until told to end."""
    bootstrap_servers, kafka_topic, ros_topic = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node('ros_kafka_bridge')
    producer = Producer({'bootstrap.servers': bootstrap_servers})

    def produce(message: String) -> None:
        producer.produce(kafka_topic, message.data.encode())
        producer.poll(0)

    node.create_subscription(String, ros_topic, produce, DEPTH)
    print('subscribed', flush=True)
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)
    producer.flush(10)


main()
