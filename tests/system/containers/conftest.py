"""What the tests of the image share: it is built once, and then run where `localhost` is free."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.install.checkout import ROOT, fenced
from support.install.containers import BASE, IMAGE, Engine, engine, provide_base

from rig.hosts import Host, Network
from ros2_kafka_bridge.errors import ConfigError

BUILD, _, _, BUILD_ON_ROS = fenced('docs/container.md', 'sh')
BASE_WITH_ROS = 'with-ros'
ON_ROS = f'{IMAGE}-on-ros'

# A ROS 2 in /opt/ros, with a setup.bash, as ROS's own images have one: from its wheels.
WITH_ROS = f"""\
FROM {BASE}
RUN apt-get update && apt-get install --yes --no-install-recommends python3-venv
RUN python3 -m venv /opt/ros/kilted && /opt/ros/kilted/bin/pip install --no-cache-dir \\
    'ros-rclpy[fastrtps]<10' 'ros-common-interfaces<6'
ENV ROS_DISTRO=kilted
RUN env -i /opt/ros/kilted/bin/python -c 'import os, site; \\
    own = {{"PYTHONPATH": site.getsitepackages()[0], "AMENT_PREFIX_PATH": "/opt/ros/kilted"}}; \\
    [print(f"export {{name}}={{value!r}}") for name, value in (os.environ | own).items()]' \\
    > /opt/ros/kilted/setup.bash
"""


@pytest.fixture(scope='session')
def images(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where an engine finds the image of this checkout, and its base."""
    place = tmp_path_factory.mktemp('images')
    data = place / 'data'
    with engine(data) as builder:
        provide_base(builder, place)
        builder.shell(f'{BUILD.strip()} A=--network=host', ROOT)
    yield data
    shutil.rmtree(data)  # gigabytes, which pytest would keep for three runs


@pytest.fixture(scope='session')
def on_ros(images: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The image on a base that has a ROS 2; its name."""
    place = tmp_path_factory.mktemp('on_ros')
    (place / 'Dockerfile').write_text(WITH_ROS)
    with engine(images) as builder:
        builder.docker('build', '--network=host', f'--tag={BASE_WITH_ROS}', place, timeout_s=200)
        line = re.sub('BASE=.* ', f'BASE={BASE_WITH_ROS} --network=host ', BUILD_ON_ROS)
        builder.shell(line.replace(f'--tag {IMAGE} ', f'--tag {ON_ROS} '), ROOT)
    return ON_ROS


@pytest.fixture
def host() -> Iterator[Host]:
    """A machine with a network of its own; the test's own sockets are there, too."""
    try:
        with Network('machine') as (machine,), machine.entered():
            yield machine
    except ConfigError as reason:
        pytest.skip(str(reason))


@pytest.fixture
def docker(images: Path, host: Host) -> Iterator[Engine]:
    """An engine on that machine."""
    with engine(images, host) as found:
        yield found
