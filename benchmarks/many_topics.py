"""A ROS node with an endpoint on each of many topics: /stem0, /stem1, ...

python -m benchmarks.many_topics read /stem 100
python -m benchmarks.many_topics write /stem 100
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

KEEP_ALL = QoSProfile(
    depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
)


def main() -> None:
    """Say each topic on which something comes, or publish one message on each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=('read', 'write'))
    parser.add_argument('stem')
    parser.add_argument('count', type=int)
    args = parser.parse_args()
    names = [f'{args.stem}{number}' for number in range(args.count)]
    rclpy.init()
    node = rclpy.create_node('many')
    if args.part == 'read':
        seen: set[str] = set()
        for name in names:
            node.create_subscription(String, name, _noting(name, seen, len(names)), KEEP_ALL)
        while any(not node.count_publishers(name) for name in names):
            rclpy.spin_once(node, timeout_sec=0.1)
        print('ready', flush=True)
        rclpy.spin(node)
        return
    publishers = [node.create_publisher(String, name, KEEP_ALL) for name in names]
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.05)
    time.sleep(1.0)  # the writer knows of a match before the reader does
    for publisher, name in zip(publishers, names, strict=True):
        publisher.publish(String(data=name))
    print('written', flush=True)
    rclpy.spin(node)


def _noting(name: str, seen: set[str], total: int) -> Callable[[String], None]:
    def note(name: str, _: String) -> None:
        print(name, flush=True)
        seen.add(name)
        if len(seen) == total:
            print('all', flush=True)

    return partial(note, name)


if __name__ == '__main__':
    main()
