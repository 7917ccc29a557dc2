"""Guarantee 7, stop is a drain: in one process, routes to ROS end before those from ROS stop.

What a route to ROS has published last, and its reader here has acknowledged, is still taken.
"""

import threading
import time

from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.config.settings import Config

CONTENT = {
    'name': 'test',
    'kafka': {'bootstrap.servers': 'localhost:1'},
    'routes': [
        {
            'name': 'to_ros',
            'from': {'kafka': 'orders'},
            'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
            'format': 'text',
        },
        {
            'name': 'to_kafka',
            'from': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
            'to': {'kafka': 'returned'},
            'format': 'text',
        },
    ],
}


def test_guarantee_7_routes_from_ros_stop_only_once_those_to_ros_have_ended() -> None:
    bridge = Bridge(Config.model_validate(CONTENT))
    to_ros, to_kafka = bridge._lanes
    asked_meanwhile = []

    def drain() -> None:
        assert to_ros.stop.wait(30)
        time.sleep(0.3)  # what is in flight
        asked_meanwhile.append(to_kafka.stop.asked)

    to_ros.thread = threading.Thread(target=drain, daemon=True)
    to_kafka.thread = threading.Thread(target=to_kafka.stop.wait, args=(30,), daemon=True)
    for lane in bridge._lanes:
        assert lane.thread is not None
        lane.thread.start()
    bridge.stop.ask()
    assert not to_kafka.stop.asked
    bridge._shut_down()
    assert asked_meanwhile == [False]
    assert to_kafka.stop.asked
    assert not bridge.runs
