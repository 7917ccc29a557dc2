"""The repository as a package of a ROS workspace: built by colcon, sourced, run."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from support.bridges.routes import to_kafka, to_ros, values
from support.processes.harness import Bench, Process
from support.processes.terminal import finished

from ros2_kafka_bridge import __version__

ROOT = Path(__file__).parents[2]
PACKAGE = 'ros2_kafka_bridge'
PARTS = ('LICENSE', 'README.md', 'launch', 'package.xml', 'pyproject.toml', 'resource',
         'setup.cfg', 'setup.py', 'src')  # fmt: skip
BINARIES = Path(sys.executable).parent

NOT_INSTALLED = """
from importlib import metadata
found = metadata.Distribution.from_name
def found_but_one(name):
    if name == 'confluent-kafka':
        raise metadata.PackageNotFoundError(name)
    return found(name)
metadata.Distribution.from_name = found_but_one
"""


class Workspace(NamedTuple):
    """A workspace that was built.

    Args:
        place: Its folder.
        environ: Of a shell that has sourced it.
        code: From which folder its code comes.
    """

    place: Path
    environ: dict[str, str]
    code: Path

    @property
    def executable(self) -> Path:
        """What `ros2 run ros2_kafka_bridge bridge` finds."""
        return self.place / 'install' / PACKAGE / 'lib' / PACKAGE / 'bridge'


@pytest.fixture(scope='module', params=['', '--symlink-install'], ids=['copied', 'linked'])
def workspace(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Workspace:
    place = tmp_path_factory.mktemp('workspace')
    package = place / 'src' / 'bridge'
    package.mkdir(parents=True)
    for part in PARTS:
        _copy(ROOT / part, package / part)
    environ = {**os.environ, 'PATH': f'{BINARIES}:{os.environ["PATH"]}', 'COLCON_HOME': str(place)}
    options = [request.param] if request.param else []
    built = finished(
        [BINARIES / 'colcon', 'build', *options], cwd=place, env=environ, timeout_s=300
    )
    assert built.returncode == 0, built.stdout + built.stderr
    linked = place / 'build' / PACKAGE / 'src'
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    copied = place / 'install' / PACKAGE / 'lib' / version / 'site-packages'
    sourced = _sourced(place / 'install' / 'setup.bash', environ)
    return Workspace(place, sourced, linked if request.param else copied)


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(
            source, target, ignore=shutil.ignore_patterns('__pycache__', 'ros2_kafka_warehouse')
        )
    else:
        shutil.copy(source, target)


def _sourced(script: Path, environ: Mapping[str, str]) -> dict[str, str]:
    command = ['bash', '-c', 'source "$0" > /dev/null && env -0', str(script)]
    found = subprocess.run(command, env=environ, capture_output=True, text=True, check=True)
    return dict(line.split('=', 1) for line in found.stdout.split('\0') if line)


def _run(workspace: Workspace, *command: str | Path) -> subprocess.CompletedProcess[str]:
    return finished(command, env=workspace.environ)


def test_the_index_of_ros_leads_to_the_executables_and_the_launch_file(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', workspace.environ['AMENT_PREFIX_PATH'])
    found = Path(get_package_prefix(PACKAGE), 'lib', PACKAGE)
    executables = {path.name for path in found.iterdir() if os.access(path, os.X_OK)}
    assert executables == {'bridge', 'ros2-kafka-bridge'}
    assert Path(get_package_share_directory(PACKAGE), 'launch', 'bridge.launch.py').is_file()


def test_the_code_that_runs_is_that_of_the_workspace_and_complete(workspace: Workspace) -> None:
    code = f'import {PACKAGE}; print({PACKAGE}.__file__)'
    told = _run(workspace, BINARIES / 'python', '-c', code)
    assert told.stdout.strip() == str(workspace.code / PACKAGE / '__init__.py')
    source = ROOT / 'src' / PACKAGE
    wanted = {file.relative_to(source) for file in source.rglob('*') if file.is_file()}
    there = {file.relative_to(workspace.code / PACKAGE) for file in _files(workspace)}
    assert {file for file in wanted if '__pycache__' not in file.parts} <= there


def _files(workspace: Workspace) -> list[Path]:
    folder = workspace.code / PACKAGE
    return [Path(place, name) for place, _, names in os.walk(folder) for name in names]


def test_an_order_goes_there_and_back_through_the_executable(
    workspace: Workspace, bench: Bench, topic: str, tmp_path: Path
) -> None:
    returned = f'{topic}.returned'
    config = bench.config([to_ros(topic, '/orders'), to_kafka('/orders', returned)])
    arguments = ['--ros-args', '-r', '__node:=shop', '-p', f'config:={config}']
    command = [str(workspace.executable), *arguments]
    with Process(
        command, tmp_path / 'log', {**workspace.environ, 'ROS_DOMAIN_ID': str(bench.domain)}
    ) as bridge:
        bench.produce(topic, [b'one', b'two'])
        assert values(bench.records(returned, 2)) == [b'one', b'two'], bridge.output()
        assert bridge.end() == 0, bridge.output()


def test_without_a_configuration_it_says_how_to_name_one(workspace: Workspace) -> None:
    told = _run(workspace, workspace.executable, '--ros-args', '-r', '__node:=shop')
    assert told.returncode == 2
    assert 'ros2 run ros2_kafka_bridge bridge FILE' in told.stderr


@pytest.mark.parametrize(
    ('library', 'lacks'),
    [
        ('typer', "import sys; sys.modules['typer'] = None"),
        ('confluent-kafka', NOT_INSTALLED),  # imported when routes begin
    ],
)
def test_without_the_python_libraries_it_says_where_they_come_from(
    library: str, lacks: str, workspace: Workspace
) -> None:
    code = f'{lacks}\nfrom ros2_kafka_bridge.ros_run import main; main()'
    told = _run(workspace, BINARIES / 'python', '-c', code)
    assert told.returncode == 2
    assert library in told.stderr
    assert 'pip' in told.stderr
    assert 'Traceback' not in told.stderr


def test_an_extra_that_is_missing_is_named_by_its_libraries(workspace: Workspace) -> None:
    code = (
        "import sys; sys.modules['scipy'] = None; from ros2_kafka_bridge.cli import main; "
        "sys.argv[1:] = ['depth', '--recording', 'none']; main()"
    )
    told = _run(workspace, BINARIES / 'python', '-c', code)
    assert told.returncode == 2
    [sentence] = told.stderr.splitlines()
    assert 'depth needs scipy' in sentence
    assert "'scipy>=" in sentence


def test_the_whole_command_line_is_there_too(workspace: Workspace) -> None:
    told = _run(workspace, workspace.executable.parent / 'ros2-kafka-bridge', '--version')
    assert told.stdout.strip() == __version__
