"""What `import ros2_kafka_bridge` offers, and what it does not load for it."""

import subprocess
import sys

import pytest

import ros2_kafka_bridge


def test_the_public_names_are_these() -> None:
    assert ros2_kafka_bridge.__all__ == [
        'Bridge',
        'BridgeError',
        'Config',
        'ConfigError',
        'DecodeError',
        'Deduplicator',
        'EncodeError',
        'RecordError',
        'RecordTooLargeError',
        'RouteError',
        'Snapshot',
        'TransportError',
        '__version__',
        'load',
        'loads',
        'without_repeats',
    ]


@pytest.mark.parametrize('name', ros2_kafka_bridge.__all__)
def test_each_public_name_can_be_imported(name: str) -> None:
    assert getattr(ros2_kafka_bridge, name) is not None


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'ros2_kafka_bridge' has no attribute 'Bridges'"):
        _ = ros2_kafka_bridge.Bridges


def test_the_package_alone_loads_nothing_heavy() -> None:
    program = (
        'import sys, ros2_kafka_bridge;'
        'assert not {"rclpy", "confluent_kafka", "pydantic", "rich"} & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)
