# ruff: noqa: INP001  # launch loads it by its path
"""Start a bridge in ROS's own way.

    ros2 launch ros2_kafka_bridge bridge.launch.py config:=/path/to/bridge.yaml

With `monitoring: {start: unconfigured}` in the file the bridge waits for a lifecycle manager that
configures and activates it. That is `autostart:=true` here, or one such as Nav2's:

    lifecycle_manager:
      ros__parameters:
        autostart: true
        node_names: [kafka_bridge]
        bond_timeout: 0.0  # the bridge has no bond: its /diagnostics say how it is

Without that line in the file the routes run at once, and `autostart` is of no use.
"""

from typing import TYPE_CHECKING

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription

if TYPE_CHECKING:
    from launch.action import Action

# A second signal ends a drain, and launch would send it after 5 s. More than 65 s plus twice the
# longest `drain_s`, as the unit of systemd has it.
STOP_TIMEOUT_S = '90'


def generate_launch_description() -> LaunchDescription:
    """Make what launch runs."""
    bridge = LifecycleNode(
        package='ros2_kafka_bridge',
        executable='bridge',
        name=LaunchConfiguration('name'),
        namespace=LaunchConfiguration('namespace'),
        arguments=[
            LaunchConfiguration('config'),
            '--log-format',
            LaunchConfiguration('log_format'),
        ],
        output='screen',
        emulate_tty=False,
        sigterm_timeout=LaunchConfiguration('stop_timeout_s'),
    )
    return LaunchDescription([*_arguments(), bridge, *_autostart(bridge)])


def _arguments() -> list['Action']:
    return [
        DeclareLaunchArgument('config', description='The configuration file of the bridge.'),
        DeclareLaunchArgument('name', default_value='kafka_bridge', description='Of its node.'),
        DeclareLaunchArgument('namespace', default_value='', description='Of its node.'),
        DeclareLaunchArgument(
            'log_format',
            default_value='text',
            choices=['text', 'json'],
            description='How a line of its log is written.',
        ),
        DeclareLaunchArgument(
            'stop_timeout_s',
            default_value=STOP_TIMEOUT_S,
            description='How long a stop may take, before it is signalled again, which ends a '
            'drain: more than 65 s plus twice the longest drain_s.',
        ),
        DeclareLaunchArgument(
            'autostart',
            default_value='false',
            choices=['true', 'false'],
            description='Configure and activate a bridge with monitoring: {start: unconfigured}.',
        ),
    ]


def _autostart(bridge: LifecycleNode) -> list['Action']:
    """Configure it once it runs, and activate it once it is configured."""
    wanted = IfCondition(LaunchConfiguration('autostart'))

    def change(transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(
                lifecycle_node_matcher=matches_action(bridge), transition_id=transition
            )
        )

    configured = OnStateTransition(
        target_lifecycle_node=bridge,
        start_state='configuring',
        goal_state='inactive',
        entities=[change(Transition.TRANSITION_ACTIVATE)],
    )
    started = OnProcessStart(
        target_action=bridge, on_start=[change(Transition.TRANSITION_CONFIGURE)]
    )
    return [
        RegisterEventHandler(configured, condition=wanted),
        RegisterEventHandler(started, condition=wanted),
    ]
