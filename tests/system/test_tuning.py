"""The DDS profiles of the docs are ones that ROS takes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.processes.terminal import finished

from ros2_kafka_bridge.ros.fastdds_profile import Histories, make_profile

DOCS = Path(__file__).parents[2] / 'docs'
START = """
import rclpy
rclpy.init()
node = rclpy.create_node('profile')
print('started')
rclpy.shutdown()
"""


@pytest.mark.parametrize('page', ['tuning.md', 'troubleshooting.md'])
def test_ros_starts_with_the_profile_of_the_docs_and_with_what_the_bridge_adds(
    page: str, tmp_path: Path, ros_domain: int
) -> None:
    users = tmp_path / 'users.xml'
    users.write_text(profile_of(page))
    bridges = tmp_path / 'bridges.xml'
    bridges.write_text(make_profile(Histories({'/a': 500}, {'/b': 2000}, lease_s=3), users))
    for file in (users, bridges):
        done = started(file, ros_domain)
        assert (done.returncode, done.stdout) == (0, 'started\n'), done.stderr
        assert 'Error' not in done.stderr, done.stderr


def test_a_profile_with_a_mistake_would_be_noticed(tmp_path: Path, ros_domain: int) -> None:
    wrong = tmp_path / 'wrong.xml'
    wrong.write_text(profile_of('tuning.md').replace('segment_size', 'size_of_segment'))
    assert 'Error' in started(wrong, ros_domain).stderr


def profile_of(page: str) -> str:
    """The one of a page of the docs."""
    [text] = re.findall(r'```xml\n(.*?)```', (DOCS / page).read_text(), re.DOTALL)
    return str(text)


def started(profile: Path, ros_domain: int) -> subprocess.CompletedProcess[str]:
    """What a ROS node says that starts with a profile."""
    return finished(
        [sys.executable, '-c', START],
        env={
            **os.environ,
            'FASTDDS_DEFAULT_PROFILES_FILE': str(profile),
            'ROS_DOMAIN_ID': str(ros_domain),
        },
    )
