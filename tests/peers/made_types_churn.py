"""Makes and destroys endpoints of many types, each made of its description, in many threads.

Usage: made_types_churn.py THREADS TIMES; prints `done`.
"""

import sys
import threading
from typing import Any

import rclpy

from ros2_kafka_bridge.message_types import describe, type_names
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class

TYPES = 60


def main(threads: int, times: int) -> None:
    """Each thread has its own topics; all have the same node."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('churn', context=context, start_parameter_services=False)
    names = [name for name in type_names() if not has_key(name)][:TYPES]
    classes = [endpoint_class(name, describe(name).types) for name in names]
    begin = threading.Barrier(threads)

    def churn(thread: int) -> None:
        begin.wait()
        for time in range(times):
            made: Any = classes[(thread * 7 + time) % len(classes)]
            topic = f'/t{thread}_{time % 20}'
            publisher = node.create_publisher(made, topic, 10)
            subscription = node.create_subscription(made, topic, print, 10, raw=True)
            node.destroy_publisher(publisher)
            node.destroy_subscription(subscription)

    running = [threading.Thread(target=churn, args=(number,)) for number in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    print('done')  # noqa: T201 (read by a test)


main(int(sys.argv[1]), int(sys.argv[2]))
