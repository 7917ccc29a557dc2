"""What a file may name depends on whether ROS itself has to know it."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.process.load import load_checked

MESSAGES = Path(__file__).parents[3] / 'examples' / 'msgs'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'bridge.yaml'
    path.write_text(f"""
name: warehouse-1
kafka: {{bootstrap.servers: 'localhost:9092'}}
ros: {{message_path: ['{MESSAGES}']}}
routes:
  - name: scans
    from: {{kafka: scans}}
    to: {{ros: /scans, type: shelf_msgs/msg/ShelfScan}}
    format: json
""")
    return path


def test_a_folder_of_msg_files_is_enough_without_ros(file: Path) -> None:
    assert load_checked(file, with_ros=False).routes[0].name == 'scans'


def test_a_route_that_runs_needs_the_package(file: Path) -> None:
    with pytest.raises(ConfigError, match=r'lies in ros\.message_path only'):
        load_checked(file)
