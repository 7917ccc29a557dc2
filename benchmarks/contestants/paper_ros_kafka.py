"""The published ROS-Kafka algorithm: a subscription's callback produces each message.

    python -m benchmarks.contestants.paper_ros_kafka localhost:9092 orders.returned /orders

Default client, default QoS (KEEP_LAST) with the depth that is given. One line is added to what
was published: the callback serves the producer (`poll`). Without it the producer's queue is full
after 100,000 messages, and the node dies of it. `--record FILE` measures how long it takes.
"""

import contextlib
from typing import Any

import rclpy
from confluent_kafka import Producer
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import String

from benchmarks.contestants.node import Count, arguments
from ros2_kafka_bridge.depth import ServiceTimes


def main() -> None:
    """Spin until told to end."""
    given = arguments(__doc__)
    count = Count('ros_to_kafka', given.snapshots)
    rclpy.init(args=['--ros-args', '--disable-external-lib-logs'])  # a home may be read-only
    node = rclpy.create_node('ros_kafka_bridge')
    producer = Producer({'bootstrap.servers': given.bootstrap_servers, **given.properties})

    def produce(message: String) -> None:
        producer.produce(given.kafka_topic, message.data.encode())
        producer.poll(0)
        count.confirmed += 1

    with contextlib.ExitStack() as stack:
        callback: Any = produce
        if given.record is not None:
            callback = stack.enter_context(ServiceTimes(given.record)).timed(produce)
        node.create_subscription(String, given.ros_topic, callback, given.depth)
        count.start()
        print('subscribed', flush=True)
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(node)
    producer.flush(10)
    count.tell()


if __name__ == '__main__':
    main()
