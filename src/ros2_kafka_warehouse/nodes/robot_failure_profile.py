"""Robot Failure Profile: says which evidence means which failure, from a file."""

from ros2_kafka_warehouse.domain.robot_failure_profile import read_failure_profile
from ros2_kafka_warehouse.nodes.files import say_file
from ros2_kafka_warehouse.nodes.node import Module


def start(module: Module) -> None:
    """Say the file, and again when it has changed."""
    say_file(
        module, '/robot_failure_profile', module.settings.failure_profile, read_failure_profile
    )
