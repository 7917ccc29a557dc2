"""A ROS node that reads /orders with a queue of ten, and records how long it takes for each.

`ros2-kafka-bridge depth --recording orders.times` tells how deep its queue should be.
"""

import argparse
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ros2_kafka_bridge.depth import ServiceTimes

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument('--file', default='orders.times', help='where to write the times')
parser.add_argument('--work', type=float, default=0.002, help='seconds of work for an order')
parser.add_argument('--depth', type=int, default=10, help='of the queue')
args = parser.parse_args()


def on_order(_: String) -> None:
    """Work on an order."""
    time.sleep(args.work)


rclpy.init()
node = rclpy.create_node('timed_orders')
with ServiceTimes(args.file) as times:
    qos = QoSProfile(depth=args.depth)
    node.create_subscription(String, '/orders', times.timed(on_order), qos)
    print('ready', flush=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        print('recorded', args.file, flush=True)
