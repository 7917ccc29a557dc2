"""Prints who publishes and who subscribes to topics, as JSON, once every one has somebody.

Usage: ros_graph.py SECONDS TOPIC...
"""

import json
import sys
import time

import rclpy
from rclpy.node import Node


def endpoints(node: Node, topic: str) -> dict[str, list[str]]:
    """The names of the nodes at both ends of a topic."""
    return {
        'publishers': sorted({i.node_name for i in node.get_publishers_info_by_topic(topic)}),
        'subscribers': sorted({i.node_name for i in node.get_subscriptions_info_by_topic(topic)}),
    }


def main() -> None:
    """Look until every topic has a publisher, and nothing has changed for some seconds."""
    deadline = time.monotonic() + float(sys.argv[1])
    topics = sys.argv[2:]
    rclpy.init()
    node = rclpy.create_node('graph_reader')
    before: dict[str, dict[str, list[str]]] = {}
    same = 0
    while time.monotonic() < deadline:
        now = {topic: endpoints(node, topic) for topic in topics}
        same = same + 1 if now == before else 0
        # Fast DDS asks again only after 3 s for what got lost of its discovery.
        if same >= 5 and all(ends['publishers'] for ends in now.values()):
            break
        before = now
        time.sleep(1)
    print(json.dumps(before), flush=True)  # noqa: T201 (read by a test)


if __name__ == '__main__':
    main()
