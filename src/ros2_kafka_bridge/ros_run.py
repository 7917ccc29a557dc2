"""The executable `bridge` of a ROS workspace.

    ros2 run ros2_kafka_bridge bridge FILE [--routes a,b] [--log-format json] [--ros-args ...]

It is `ros2-kafka-bridge run FILE` for `ros2 run` and launch: FILE may be given as the ROS
parameter `config`, too. The other ROS arguments are for the node of `monitoring: {node: true}`:
its name, its namespace, and remappings of its services and of /diagnostics. The topics of the
routes are those of the file, whatever is remapped.
"""

import json
import os
import re
import sys
from importlib.metadata import distribution, requires

_MISSING = (
    'which configuration? ros2 run ros2_kafka_bridge bridge FILE, or --ros-args -p config:=FILE'
)


def main() -> None:
    """Run a bridge; the same exit status as `ros2-kafka-bridge run`."""
    try:
        _look_for_libraries()
        from ros2_kafka_bridge import cli  # noqa: PLC0415 (a workspace brings no Python libraries)
    except ModuleNotFoundError as error:
        sys.exit(_without_libraries(error))
    from ros2_kafka_bridge.errors import BridgeError  # noqa: PLC0415

    try:
        sys.argv[1:] = _as_run(sys.argv[1:])
    except BridgeError as error:
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user)
        sys.exit(2)
    cli.main()


def _as_run(given: list[str]) -> list[str]:
    from ros2_kafka_bridge.errors import ConfigError  # noqa: PLC0415
    from ros2_kafka_bridge.ros.arguments import (  # noqa: PLC0415
        ROS_ARGUMENTS,
        config_parameter,
        taken_apart,
    )

    own, ros = taken_apart(given)
    if ros:
        os.environ[ROS_ARGUMENTS] = json.dumps(ros)
    config = config_parameter(ros)
    if not own and config is None:
        raise ConfigError([_MISSING])
    return ['run', *own] if config is None else ['run', *own, '--', config]


def _look_for_libraries() -> None:
    """Raise where one is not here, also of those that are imported when routes begin."""
    for need in requires('ros2-kafka-bridge') or ():
        if 'extra ==' not in need:
            distribution(re.split(r'[^\w.-]', need)[0])  # PackageNotFoundError is a missing module


def _without_libraries(error: ModuleNotFoundError) -> int:
    print(  # noqa: T201 (the words for the user)
        f'the Python library {error.name} is not there for {sys.executable}: colcon installs '
        'none. In a virtual environment made with --system-site-packages, install those of '
        'the bridge with pip (docs/ros-workspace.md), and run it there',
        file=sys.stderr,
    )
    return 2
