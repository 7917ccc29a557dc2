"""Execution Profiles: says what robots can do and what is done about failures, from a file."""

from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.nodes.files import say_file
from ros2_kafka_warehouse.nodes.node import Module


def start(module: Module) -> None:
    """Say the file, and again when it has changed."""
    say_file(module, '/execution_profiles', module.settings.profiles, read_execution_profiles)
