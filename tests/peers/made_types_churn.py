"""Makes and destroys endpoints of many types, each made of its description, in many threads.

Usage: made_types_churn.py THREADS TIMES [--memory]; prints `done`, or how the memory of the
process has grown since a quarter of the times.
"""

import os
import sys
import threading
from pathlib import Path
from typing import Any

import rclpy

from ros2_kafka_bridge.message_types import describe, type_names
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class

TYPES = 60


def main(threads: int, times: int, *, measures: bool) -> None:
    """Each thread has its own topics; all have the same node."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('churn', context=context, start_parameter_services=False)
    names = [name for name in type_names() if not has_key(name)][:TYPES]
    types = {name: describe(name).types for name in names}
    begin = threading.Barrier(threads)

    def churn(thread: int, times: int) -> None:
        begin.wait()
        for time in range(times):
            name = names[(thread * 7 + time) % len(names)]
            made: Any = endpoint_class(name, types[name])  # as each route does
            topic = f'/t{thread}_{time % 20}'
            publisher = node.create_publisher(made, topic, 10)
            subscription = node.create_subscription(made, topic, print, 10, raw=True)
            node.destroy_publisher(publisher)
            node.destroy_subscription(subscription)

    def churn_in_all(times: int) -> None:
        running = [
            threading.Thread(target=churn, args=(number, times)) for number in range(threads)
        ]
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()

    churn_in_all(times // 4)
    before_kb = resident_kb()
    churn_in_all(times - times // 4)
    print(f'grew {resident_kb() - before_kb} kB' if measures else 'done')  # noqa: T201


def resident_kb() -> int:
    """How much memory this process has now."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') // 1024


main(int(sys.argv[1]), int(sys.argv[2]), measures='--memory' in sys.argv)
