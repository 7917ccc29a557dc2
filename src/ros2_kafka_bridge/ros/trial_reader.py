"""A subscription in a process of its own, which `trial.py` stops: it takes nothing."""

import os
import sys
import time

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.outside.parent import end_with_parent
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import load_type


def main(name: str, topic: str, domain_id: int, owner: int) -> None:
    """Subscribe, reliably and to all, until killed: by who has started it, or with it."""
    end_with_parent()
    time_class = load_type('builtin_interfaces/msg/Time', 'import').endpoint_class
    with open_node(name, domain_id, Histories({}, {})) as node:
        node.handle.create_subscription(time_class, topic, lambda _: None, profile(QoS()))
        while os.getppid() == owner:
            time.sleep(1)


if __name__ == '__main__':
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
