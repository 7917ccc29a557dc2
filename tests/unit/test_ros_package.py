"""The repository as a package of ROS: what package.xml and its requirements for pip repeat."""

import ast
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from typing import Any, Final

from support.install.checkout import ROOT

from ros2_kafka_bridge import __version__

PROJECT: Final[dict[str, Any]] = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
PACKAGE: Final = ET.parse(ROOT / 'package.xml').getroot()  # noqa: S314 (our own file)
REQUIREMENTS: Final = ROOT / 'packaging' / 'ros' / 'requirements.txt'
NO_WHEELS: Final = {'launch', 'launch_ros'}
BY_NAME: Final = {'rmw_fastrtps_cpp', 'std_msgs'}  # the middleware, and the type of text


def imported() -> Iterator[str]:
    """The packages that the bridge and its launch file import."""
    files = [*(ROOT / 'src' / 'ros2_kafka_bridge').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]
    for node in (node for file in files for node in ast.walk(ast.parse(file.read_text()))):
        if isinstance(node, ast.Import):
            yield from (name.name.split('.')[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split('.')[0]


def depended_on() -> set[str]:
    return {str(found.text) for found in PACKAGE.iter('exec_depend')}


def test_the_package_has_the_version_and_the_words_of_the_project() -> None:
    for field in ('description', 'license'):
        assert PACKAGE.findtext(field) == PROJECT[field]
    assert PACKAGE.findtext('author') == PROJECT['authors'][0]['name']
    assert PACKAGE.findtext('version') == __version__
    assert PACKAGE.findtext('name') == 'ros2_kafka_bridge'


def test_the_package_leads_where_the_project_leads() -> None:
    told = {found.get('type'): found.text for found in PACKAGE.iter('url')}
    urls = PROJECT['urls']
    source = urls['Source']
    assert told == {'website': source, 'repository': source, 'bugtracker': urls['Issues']}


def test_the_package_depends_on_every_package_of_ros_that_the_bridge_imports() -> None:
    wheels = packages_distributions()
    of_ros = {
        name
        for name in imported()
        if name in NO_WHEELS or any(wheel.startswith('ros-') for wheel in wheels.get(name, ()))
    }
    assert {'rclpy', 'std_srvs', 'launch'} <= of_ros
    of_python = {name for name in depended_on() if name.startswith('python3-')}
    assert depended_on() - of_python == of_ros | BY_NAME


def test_pip_is_given_the_libraries_of_the_bridge_and_of_monitoring() -> None:
    lines = REQUIREMENTS.read_text().splitlines()
    given = [line for line in lines if not line.startswith('#')]
    assert given == [*PROJECT['dependencies'], *PROJECT['optional-dependencies']['monitoring']]


def test_the_page_gives_pip_that_file() -> None:
    page = (ROOT / 'docs' / 'ros-workspace.md').read_text()
    below = REQUIREMENTS.relative_to(ROOT)
    assert f'pip install -r ws/src/ros2_kafka_bridge/{below}\n' in page
