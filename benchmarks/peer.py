"""A ROS node beside the bridge: it publishes strings, or takes one and then stands still.

python -m benchmarks.peer publish /topic --bytes 950000 --rate 50
python -m benchmarks.peer stall /topic
"""

import argparse
import time

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

KEEP_ALL = QoSProfile(
    depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
)
FOR_EVER_S = 3600.0


def main() -> None:
    """Do one of both until told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=('publish', 'stall'))
    parser.add_argument('topic')
    parser.add_argument('--bytes', type=int, default=500)
    parser.add_argument('--rate', type=float, default=100.0, help='messages/s at most')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'memory_{args.part}')
    if args.part == 'stall':
        node.create_subscription(String, args.topic, lambda _: time.sleep(FOR_EVER_S), KEEP_ALL)
        print('ready', flush=True)
        rclpy.spin(node)
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


if __name__ == '__main__':
    main()
