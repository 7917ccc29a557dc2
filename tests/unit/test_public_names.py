"""What `import ros2_kafka_bridge` offers, and what it does not load for it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ros2_kafka_bridge

ROOT = Path(__file__).parents[2]


def test_each_public_name_can_be_imported() -> None:
    for name in ros2_kafka_bridge.__all__:
        assert getattr(ros2_kafka_bridge, name) is not None, name


def test_the_names_that_users_are_shown_are_public() -> None:
    pages = [*ROOT.glob('*.md'), *ROOT.glob('docs/*.md'), *ROOT.glob('examples/**/*.py')]
    shown = {
        name.strip()
        for page in pages
        for names in re.findall(r'from ros2_kafka_bridge import ([\w, ]+)', page.read_text())
        for name in names.split(',')
    }
    assert {'Deduplicator', 'without_repeats'} <= shown
    assert {'Bridge', 'BridgeError', 'Config', 'Snapshot', 'load', 'loads'} <= {
        *ros2_kafka_bridge.__all__
    }, 'what a program that holds a bridge imports'
    assert shown <= {*ros2_kafka_bridge.__all__}


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'ros2_kafka_bridge' has no attribute 'Bridges'"):
        _ = ros2_kafka_bridge.Bridges


def test_the_package_alone_loads_nothing_heavy() -> None:
    program = (
        'import sys, ros2_kafka_bridge;'
        'assert not {"rclpy", "confluent_kafka", "pydantic", "rich"} & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)
