"""What types a file may name."""

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


def test_a_folder_of_msg_files_is_enough(file: Path) -> None:
    assert load_checked(file).routes[0].name == 'scans'


def test_a_type_of_a_package_that_is_not_here_may_be_described_by_a_node(file: Path) -> None:
    file.write_text(file.read_text().replace('shelf_msgs/msg/ShelfScan', 'nav2_msgs/msg/Costmap'))
    assert load_checked(file).routes[0].name == 'scans'


@pytest.mark.parametrize(
    ('wrong', 'near'),
    [
        ('shelf_msgs/msg/ShelfScn', 'shelf_msgs/msg/ShelfScan'),
        ('std_msgs/msg/Strin', 'std_msgs/msg/String'),
    ],
)
def test_a_package_that_is_here_has_all_of_its_types(file: Path, wrong: str, near: str) -> None:
    file.write_text(file.read_text().replace('shelf_msgs/msg/ShelfScan', wrong))
    said = rf'no message type {wrong} here \(did you mean {near}\?\)'
    with pytest.raises(ConfigError, match=said):
        load_checked(file)
