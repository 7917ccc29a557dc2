"""Prints the first orders that the bridge publishes, as any ROS node would read them."""

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String


def main() -> None:
    """Read `/orders` until Ctrl-C, with a history that waits: nothing is lost here either."""
    rclpy.init()
    node = rclpy.create_node('print_orders')
    qos = QoSProfile(
        depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
    )
    node.create_subscription(String, '/orders', lambda order: print(order.data, flush=True), qos)
    print('listening to /orders', flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
