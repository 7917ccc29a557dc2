"""The rclpy of this process: where it lies, how old it is, and whether the bridge can use it."""

import re
import sys
from pathlib import Path
from typing import Final

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros.rclpy_api import NeededBy, lacking

_VERSION: Final = re.compile(r'rclpy-(\d+(?:\.\d+)*)')
_OLDEST: Final = 7
_NAMED: Final = 3


def rclpy_folder() -> Path:
    """Where the rclpy in use lies: that of the wheels, or of a sourced ROS 2."""
    import rclpy  # noqa: PLC0415 (heavy)

    return Path(rclpy.__file__).parent


def rclpy_version() -> str:
    """The version of the rclpy in use, empty where nothing tells it."""
    # importlib.metadata would load a parser of mail, for as long as the bridge runs.
    installed = (path.name for path in rclpy_folder().parent.glob('rclpy-*-info'))
    found = next(filter(None, map(_VERSION.match, installed)), None)
    return found[1] if found else _version_elsewhere()


def rclpy_major(version: str) -> int | None:
    """The first number of a version: 7 is Jazzy, 9 Kilted, 10 Lyrical; None where it has none."""
    first = version.partition('.')[0]
    return int(first) if first.isdecimal() else None


def check_alone() -> None:
    """Refuse another rclpy before that of the wheels.

    Both have libraries of the same names: which ones a process loads is then by chance, and
    nodes crash.

    Raises:
        ConfigError: It names both places.
    """
    used = rclpy_folder()
    for place in map(Path, sys.path):
        wheels = place / 'rclpy'
        has_wheels = any(place.glob('ros_rclpy-*.dist-info')) and wheels.exists()
        if has_wheels and wheels.resolve() != used.resolve():
            problem = (
                f'two ROS at once: rclpy is that of {used}, and the wheels of ROS 2 are in '
                f'{place}: make an environment without the extra [ros] for a sourced ROS, or open '
                'a terminal that has not sourced one'
            )
            raise ConfigError([problem])


def check_api(part: NeededBy) -> None:
    """Refuse an rclpy that does not have what a part of the bridge calls.

    Raises:
        ConfigError: It names what is not there.
        ImportError: rclpy itself lacks something of others.
    """
    if lacks := lacking(part):
        raise ConfigError([refusal(rclpy_version(), rclpy_folder(), lacks)])


def refusal(version: str, folder: Path, lacks: list[str]) -> str:
    """Say which rclpy it is, what it does not have, and what to do."""
    major = rclpy_major(version)
    age = 'too old' if major is not None and major < _OLDEST else 'too new, or changed'
    named = ', '.join(lacks[:_NAMED])
    more = f' and {len(lacks) - _NAMED} more' if len(lacks) > _NAMED else ''
    return (
        f'rclpy {version or "of an unknown version"} of {folder} is {age}: it does not have what '
        f'the bridge calls: {named}{more}: source a ROS that is supported, Jazzy (rclpy 7) or '
        'newer (README.md, What is supported)'
    )


def _version_elsewhere() -> str:
    from importlib import metadata  # noqa: PLC0415 (heavy)

    try:
        return metadata.version('rclpy')
    except metadata.PackageNotFoundError:
        return ''
