"""A robot without wheels: says where it is and how its battery is, and drives as it is told."""

import math
from typing import Final

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState

STEP_S: Final = 0.1


def main() -> None:
    """Drive until Ctrl-C."""
    rclpy.init()
    node = rclpy.create_node('pretend_robot')
    odometry = node.create_publisher(Odometry, '/odom', 10)
    battery = node.create_publisher(BatteryState, '/battery_state', 10)
    told = Twist()
    place = Odometry()
    place.header.frame_id, place.child_frame_id = 'odom', 'base_link'
    heading, charge = 0.0, 1.0

    def obey(command: Twist) -> None:
        nonlocal told
        told = command
        print(f'told to drive {command.linear.x:g} m/s', flush=True)

    def drive() -> None:
        nonlocal heading, charge
        heading += told.angular.z * STEP_S
        place.pose.pose.position.x += told.linear.x * math.cos(heading) * STEP_S
        place.pose.pose.position.y += told.linear.x * math.sin(heading) * STEP_S
        place.pose.pose.orientation.z, place.pose.pose.orientation.w = (
            math.sin(heading / 2),
            math.cos(heading / 2),
        )
        place.twist.twist = told
        place.header.stamp = node.get_clock().now().to_msg()
        odometry.publish(place)
        charge = max(0.0, charge - 1e-5)
        battery.publish(BatteryState(header=place.header, percentage=charge, present=True))

    # A command is never overwritten by the next one before the robot has seen it.
    waiting = QoSProfile(
        depth=0, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
    )
    node.create_subscription(Twist, '/cmd_vel', obey, waiting)
    node.create_timer(STEP_S, drive)
    print('the robot stands at 0, 0', flush=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        print(f'it stops at {place.pose.pose.position.x:.1f} m', flush=True)


if __name__ == '__main__':
    main()
