"""The configuration that a process begins with, checked against what is installed here."""

import os
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from ros2_kafka_bridge.errors import ConfigError

if TYPE_CHECKING:
    from ros2_kafka_bridge.config.settings import Config
    from ros2_kafka_bridge.message_types import KnownTypes


def load_checked(file: Path, *, with_ros: bool = True) -> 'Config':
    """The configuration in a file, checked against the types and the Kafka client found here.

    Args:
        file: The file.
        with_ros: Whether rclpy has to load the types; else a folder of .msg files is enough.

    Raises:
        ConfigError: With every mistake in the file.
    """
    from ros2_kafka_bridge.config.file import load  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.formats.walk import scalar_problem  # noqa: PLC0415
    from ros2_kafka_bridge.kafka.property_check import property_problems  # noqa: PLC0415
    from ros2_kafka_bridge.message_types import KnownTypes, load_layout  # noqa: PLC0415
    from ros2_kafka_bridge.outside.extras import missing_extra  # noqa: PLC0415

    types = KnownTypes()
    check_type = partial(_not_installed, types) if with_ros else types.unknown
    layout_of = cache(load_layout)

    def check_field(message_type: str, field: str, folders: Sequence[Path]) -> str | None:
        try:
            layout = layout_of(message_type, () if with_ros else tuple(folders))
        except ConfigError:
            return None  # told of its type
        return scalar_problem(layout, field)

    return load(file, os.environ, check_type, property_problems, missing_extra, check_field)


def _not_installed(types: 'KnownTypes', name: str, message_path: Sequence[Path]) -> str | None:
    """Say what is wrong with the type of a route, which rclpy has to load; None if it can."""
    problem = types.unknown(name)
    if problem and message_path and types.unknown(name, message_path) is None:
        return (
            f'{name} lies in ros.message_path only, which is enough without ROS: a route '
            'that runs needs its package, built and sourced'
        )
    return problem


def chosen(config: 'Config', routes: str) -> frozenset[str] | None:
    """The names in a list with commas, None for all routes.

    Raises:
        ConfigError: There are no such routes.
    """
    if not routes:
        return None
    names = frozenset(name.strip() for name in routes.split(','))
    known = {route.name for route in config.routes}
    if unknown := sorted(names - known):
        there = ', '.join(sorted(known))
        raise ConfigError([f'--routes: no route {name}, there are {there}' for name in unknown])
    return names
