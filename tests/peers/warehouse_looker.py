"""Looks at a warehouse in the standard types of ROS, as tools such as RViz do."""

import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from ros2_kafka_warehouse.nodes.standard import ros_name

rclpy.init()
node = rclpy.create_node('looker')
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
waits: set[str] = set()


def look(kind: type, topic: str, qos: QoSProfile | int = 10) -> None:
    """Wait for a message that says something."""
    waits.add(topic)

    def seen(message: object) -> None:
        # A robot that stands still has no way.
        if not isinstance(message, Path) or message.poses:
            waits.discard(topic)

    node.create_subscription(kind, topic, seen, qos)


look(OccupancyGrid, '/map', latched)
look(DiagnosticArray, '/diagnostics')
name = ros_name(sys.argv[1])
look(PoseStamped, f'/{name}/pose')
look(BatteryState, f'/{name}/battery_state')
look(Path, f'/{name}/path', latched)
print('looks', flush=True)  # noqa: T201 (for the test)
while waits:
    rclpy.spin_once(node, timeout_sec=1)
print('has seen all', flush=True)  # noqa: T201 (for the test)
