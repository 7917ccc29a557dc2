"""What the modules say in the standard types of ROS: places, and names of topics."""

import math
import re
from typing import Any, Final

FRAME: Final = 'site'
"""The frame of the site: metres from the top left cell, x along a row, y down a column."""


def ros_name(serial_number: str) -> str:
    """A robot's name as a part of a topic: `carrier-1` is `carrier_1`."""
    name = re.sub(r'\W', '_', serial_number, flags=re.ASCII)
    return name if name[:1].isalpha() else f'robot_{name}'


def place(pose: Any, x: float, y: float, theta: float) -> None:
    """Write a place into a `geometry_msgs/Pose`."""
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(theta / 2), math.cos(theta / 2)
