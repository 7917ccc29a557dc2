"""What the README says is supported, against what the tests run on: no more, and no less."""

import re
import tomllib
from typing import Final, NamedTuple

from support.install.checkout import ROOT

WAYS: Final = ('gate', 'long', 'once by hand', 'read only', 'no')


class Row(NamedTuple):
    """One line of the table."""

    ros: str
    python: str
    processor: str
    middleware: str
    known: str


def rows(*ways: str) -> list[Row]:
    """Those that are known in one of these ways."""
    lines = re.findall(r'^\| (.*) \|$', (ROOT / 'README.md').read_text(), re.MULTILINE)
    found = [Row(*line.split(' | ')) for line in lines if line.count(' | ') == 4]
    return [row for row in found if row.known.startswith(tuple(f'**{way}**' for way in ways))]


def pythons(*ways: str) -> set[str]:
    return set(re.findall(r'3\.\d+', ' '.join(row.python for row in rows(*ways))))


def locked(file: str, package: str) -> str:
    """The major version of a package in a lock."""
    [version] = re.findall(rf'^{package}==(\d+)', (ROOT / file).read_text(), re.MULTILINE)
    return str(version)


def test_each_line_says_how_it_is_known() -> None:
    text = (ROOT / 'README.md').read_text()
    lines = [line for line in text.splitlines() if line.startswith('| ') and line.count('|') == 6]
    head, *rest = lines
    assert head.startswith('| ROS 2 |')
    assert len(rest) == len(rows(*WAYS))
    assert all(rows(way) for way in WAYS)


def test_the_gate_is_said_to_run_on_what_it_is_locked_for() -> None:
    [row] = rows('gate')
    assert 'Kilted' in row.ros
    assert locked('requirements.lock', 'ros-rclpy') == '9'  # that of Kilted
    assert f'--python-version {row.python} ' in (ROOT / 'Makefile').read_text()


def test_a_distribution_that_is_said_to_be_tested_long_has_a_lock_and_tests() -> None:
    assert {row.ros.split(',')[0] for row in rows('long')} == {'Kilted', 'Jazzy'}
    assert locked('requirements-jazzy.lock', 'ros-rclpy') == '7'  # that of Jazzy
    for row in rows('long'):
        tests = re.findall(r'\((tests/[\w/]+\.py)\)', row.known)
        assert tests
        assert all((ROOT / test).exists() for test in tests)


def test_only_what_the_locked_wheels_are_for_is_said_to_be_tested() -> None:
    tested = rows('gate', 'long')
    where = {(row.ros.split(', ')[1], row.processor, row.middleware) for row in tested}
    assert where == {('wheels', 'x86-64', 'Fast DDS')}
    [gate] = rows('gate')
    assert {row.python for row in tested if 'Jazzy' in row.ros} == {gate.python}


def test_the_pythons_that_are_said_to_be_tested_are_those_of_tests_and_metadata() -> None:
    other = (ROOT / 'tests' / 'system' / 'test_other_pythons.py').read_text()
    [tested] = re.findall(r'^VERSIONS = \((.*)\)$', other, re.MULTILINE)
    assert pythons('gate', 'long') == pythons('gate') | set(re.findall(r'3\.\d+', tested))
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
    named = {one.rpartition(' ')[2] for one in project['classifiers'] if ' 3.' in one}
    assert named == pythons('gate', 'long')
    assert project['requires-python'] == f'>={min(named)}'
    assert max(pythons('no')) < min(named)


def test_every_extra_with_wheels_of_ros_stays_below_what_was_not_tried() -> None:
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
    asked = [one for extra in project['optional-dependencies'].values() for one in extra]
    wheels = {one for one in asked if one.startswith('ros-rclpy')}
    assert wheels == {'ros-rclpy[fastrtps]>=9.1.2,<10'}  # Lyrical's is 10
