"""Which way a route goes; apart from the settings, so that a supervisor loads no more of them."""

from enum import StrEnum


class Direction(StrEnum):
    """Which way a route goes."""

    KAFKA_TO_ROS = 'kafka_to_ros'
    ROS_TO_KAFKA = 'ros_to_kafka'
