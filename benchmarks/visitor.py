"""A ROS node that comes and goes: it subscribes, or publishes a little, and is gone.

python -m benchmarks.visitor /read /write --times 25 --seed 1
python -m benchmarks.visitor /read /write --stay

Each time with another QoS, with a context of its own or as another node of the same one. With
`--stay` it comes once and stays until it is killed.
"""

import argparse
import itertools
import random
import time
from typing import Any, Final

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from rig.peers.ends import has_published, qos

_STAY_S: Final = 0.2


def main() -> None:
    """Come and go."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('read', help='the topic to subscribe to')
    parser.add_argument('write', help='the topic to publish on')
    parser.add_argument('--times', type=int, default=1)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--stay', action='store_true', help='until killed')
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 (no secret)
    shared = rclpy.Context()
    rclpy.init(context=shared)
    for number in range(args.times):
        context = shared if args.stay or rng.randrange(2) else rclpy.Context()
        if context is not shared:
            rclpy.init(context=context)
        node = rclpy.create_node(f'visitor_{rng.randrange(10**9)}', context=context)
        if rng.randrange(4) or args.stay:
            _read(node, context, args.read, rng, stay=args.stay)
        else:
            _write(node, args.write, rng)
        node.destroy_node()
        if context is not shared:
            rclpy.shutdown(context=context)
        print(f'gone {number + 1}', flush=True)


def _read(node: Any, context: Any, topic: str, rng: random.Random, *, stay: bool) -> None:
    node.create_subscription(String, topic, lambda _: None, _qos(rng))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    if stay:
        print('ready', flush=True)
    end_s = time.monotonic() + rng.uniform(0, _STAY_S)
    while stay or time.monotonic() < end_s:
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()


def _write(node: Any, topic: str, rng: random.Random) -> None:
    publisher = node.create_publisher(String, topic, _qos(rng))
    end_s = time.monotonic() + rng.uniform(0, _STAY_S)
    for number in itertools.count():
        if time.monotonic() > end_s:
            return
        has_published(publisher, String(data=f'visitor {number}'))  # or the history is full
        time.sleep(0.01)


def _qos(rng: random.Random) -> QoSProfile:
    reliability = rng.choice(('reliable', 'best_effort'))
    durability = rng.choice(('volatile', 'transient_local'))
    keeps_all, depth = rng.choice((True, False)), rng.choice((1, 10, 1000))
    return qos(durability, reliability, 0 if keeps_all else depth)


if __name__ == '__main__':
    main()
