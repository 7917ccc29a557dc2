"""The configuration that a process begins with, checked against what is installed here."""

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ros2_kafka_bridge.errors import ConfigError

if TYPE_CHECKING:
    from ros2_kafka_bridge.config.settings import Config


def load_checked(file: Path) -> 'Config':
    """The configuration in a file, checked against the types and the Kafka client found here.

    Raises:
        ConfigError: With every mistake in the file.
    """
    from ros2_kafka_bridge.config.file import load  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.formats.walk import scalar_problem  # noqa: PLC0415
    from ros2_kafka_bridge.kafka.property_check import property_problems  # noqa: PLC0415
    from ros2_kafka_bridge.message_types import KnownTypes, load_layout  # noqa: PLC0415
    from ros2_kafka_bridge.outside.extras import missing_extra  # noqa: PLC0415

    layout_of = cache(load_layout)

    def check_field(message_type: str, field: str, folders: Sequence[Path] | None) -> str | None:
        try:
            layout = layout_of(message_type, tuple(folders or ()))
        except ConfigError:
            return None  # told of its type
        return scalar_problem(layout, field)

    check_type = KnownTypes().mistake
    return load(file, os.environ, check_type, property_problems, missing_extra, check_field)


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
