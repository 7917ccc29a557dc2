"""Takes a message of each of many topics, with endpoints whose types a node alone describes.

Usage: takes_many.py TOPICS DOMAIN; prints `took N in S s`, N the topics whose own message came.
"""

import sys
import time
from functools import partial
from typing import Any

from ros2_kafka_bridge.config.endpoints import QoS, RosSettings
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.used_type import RosEnd, RouteTypes
from ros2_kafka_bridge.threads.stop import Stop


def main(topics: int, domain: int) -> None:
    """Learn the type of each topic, and take what is on it."""
    from ros2_kafka_bridge.ros.take import take  # noqa: PLC0415 (with rclpy)

    began_s = time.monotonic()
    qos, taken = profile(QoS(), 'reliable', 'transient_local'), set[int]()
    with open_node('takes_many', domain, Histories({}, {})) as node:
        load = partial(RouteTypes(node, RosSettings()).load, log=route_log(), stop=Stop())
        made: list[Any] = []
        for number in range(topics):
            found = load(RosEnd(f'/t{number}'))
            assert found is not None
            with node.endpoint_lock:
                made.append(
                    node.handle.create_subscription(
                        found.endpoint_class, f'/t{number}', print, qos, raw=True
                    )
                )
        until_s = time.monotonic() + 120
        while len(taken) < topics and time.monotonic() < until_s:
            for number, subscription in enumerate(made):
                for cdr, _ in take(subscription, 10)[0]:
                    assert int.from_bytes(cdr[4:12], 'little') == number
                    taken.add(number)
            time.sleep(0.1)
        print(f'took {len(taken)} in {time.monotonic() - began_s:.1f} s', flush=True)  # noqa: T201


main(int(sys.argv[1]), int(sys.argv[2]))
