"""A ROS node beside the bridge: it publishes strings, or takes one and then stands still.

python -m benchmarks.peer publish /topic --bytes 950000 --rate 50
python -m benchmarks.peer stall /topic
python -m benchmarks.peer bare /topic --brokers localhost:9092 --kafka topic

The last one does nothing: it is what a bridge needs at least.
"""

import argparse
import time
from contextlib import closing
from typing import NoReturn

import rclpy
from confluent_kafka import Consumer, Producer
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

KEEP_ALL = QoSProfile(
    depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
)
FOR_EVER_S = 3600.0


def main() -> None:
    """Do one of both until told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=('publish', 'stall', 'bare'))
    parser.add_argument('topic')
    parser.add_argument('--bytes', type=int, default=500)
    parser.add_argument('--rate', type=float, default=100.0, help='messages/s at most')
    parser.add_argument('--brokers', default='localhost:9092')
    parser.add_argument('--kafka', default='orders', help='topic in Kafka')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'memory_{args.part}')
    if args.part == 'stall':
        node.create_subscription(String, args.topic, lambda _: time.sleep(FOR_EVER_S), KEEP_ALL)
        print('ready', flush=True)
        rclpy.spin(node)
    if args.part == 'bare':
        _be_there(node, args.topic, args.brokers, args.kafka)
    publisher = node.create_publisher(String, args.topic, KEEP_ALL)
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    time.sleep(1.0)  # the writer knows of the match before the reader does
    print('ready', flush=True)
    message = String(data='x' * args.bytes)
    while True:
        try:
            publisher.publish(message)
        except Exception as error:
            if 'cannot publish data' not in str(error):  # the reader's cache is full: held back
                raise
        time.sleep(1 / args.rate)


def _be_there(node: Node, topic: str, brokers: str, kafka_topic: str) -> NoReturn:
    """Have one end each way at Kafka and at ROS, and move nothing."""
    ends = [
        node.create_publisher(String, topic, KEEP_ALL),
        node.create_subscription(String, f'{topic}_back', lambda _: None, KEEP_ALL),
        Producer({'bootstrap.servers': brokers}),
    ]
    with closing(Consumer({'bootstrap.servers': brokers, 'group.id': kafka_topic})) as consumer:
        consumer.subscribe([kafka_topic])
        print('ready', flush=True)
        while ends:
            consumer.poll(1.0)
    raise AssertionError('it has no end')


if __name__ == '__main__':
    main()
