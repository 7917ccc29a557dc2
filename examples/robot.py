"""A robot: takes each order from /orders and says on /status that it is done."""

import json

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String


def main() -> None:
    """Work until Ctrl-C."""
    rclpy.init()
    node = rclpy.create_node('robot')
    # What it says while the bridge is away waits here for the bridge: the last 5,000 of it.
    latched = QoSProfile(
        depth=5000,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    # No order is overwritten by the next one: when it is too slow, the bridge waits.
    waiting = QoSProfile(
        depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
    )
    status = node.create_publisher(String, '/status', latched)
    done = 0

    def work(order: String) -> None:
        nonlocal done
        order_id = json.loads(order.data)['order_id']
        status.publish(String(data=json.dumps({'order_id': order_id, 'status': 'done'})))
        done += 1
        if done == 1 or done % 100 == 0:
            print(f'{done} orders done', flush=True)

    node.create_subscription(String, '/orders', work, waiting)
    print('the robot waits for orders', flush=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        print(f'{done} orders done, good night', flush=True)


if __name__ == '__main__':
    main()
