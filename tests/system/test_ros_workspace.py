"""The lines of docs/ros-workspace.md, one by one, in terminals that know nothing of ours.

What a machine without packages of ROS lacks stands in for it; nothing else is exchanged:

- /opt/ros/jazzy: the wheels of Jazzy, and the scripts of a ROS that are sourced;
- `ros2 run`, which has no wheel: it runs what the index of ROS leads to;
- colcon, a package of Ubuntu: that of the lock, where a Python of the system would find it;
- rosdep, which asks databases on the net, and apt: it installs nothing here;
- the address, which is not published yet: a repository of this checkout's files.
"""

import os
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest
from support.bridges.routes import to_kafka, to_ros, values
from support.install.checkout import ROOT, copy_checkout, fenced
from support.install.wheels import LOCK, install, make_venv, uv
from support.processes.harness import Bench, Process
from support.processes.terminal import finished

ROS: Final = '/opt/ros/jazzy'
# Where packages come from, and whom to trust about that, is the machine's own.
KEPT: Final = ('PIP_', 'SSL_CERT_', 'HTTP_PROXY', 'HTTPS_PROXY', 'NO_PROXY', 'ROS_')
BUILT_S: Final = 400.0
SOURCED: Final = """
import os, site, sys
own = {
    'AMENT_PREFIX_PATH': sys.prefix,
    'PYTHONPATH': site.getsitepackages()[0],
    'LD_LIBRARY_PATH': os.environ['LD_LIBRARY_PATH'],
    'PATH': f'{sys.prefix}/programs',
}
for name, value in own.items():
    print(f'export {name}="{value}${{{name}:+:${name}}}"')
print('export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1')
"""
ROS2_RUN: Final = """\
#!/usr/bin/env bash
[ "$1" = run ] || exit 2
IFS=:
for prefix in $AMENT_PREFIX_PATH; do
    if [ -e "$prefix/share/ament_index/resource_index/packages/$2" ]; then
        exec "$prefix/lib/$2/$3" "${@:4}"
    fi
done
echo "Package '$2' not found" >&2
exit 1
"""
ROSDEP: Final = """\
#!/usr/bin/env bash
[ "$*" = 'install --from-paths ws/src --ignore-src -y' ] && ls "$3"/*/package.xml
"""


class Machine(NamedTuple):
    """A machine with a ROS 2, on which somebody follows the page.

    Args:
        place: The folder that they stand in.
        environ: Of a new terminal there.
        exchanged: Words of the page, and what stands for them here.
    """

    place: Path
    environ: dict[str, str]
    exchanged: dict[str, str]

    def terminal(self, lines: str, **more: str) -> list[str]:
        """The command that is a new terminal in which lines of the page are typed."""
        for word, here in self.exchanged.items():
            lines = lines.replace(word, here)
        variables = [f'{name}={value}' for name, value in (self.environ | more).items()]
        return ['env', '-i', *variables, 'bash', '-ec', f'cd {self.place}\n{lines}']


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    ros, programs = tmp_path / 'ros', tmp_path / 'programs'
    make_ros(ros)
    add_program(programs / 'rosdep', ROSDEP)
    copy_checkout(tmp_path / 'published')
    development: list[str] = pyproject()['dependency-groups']['dev']
    colcon = [name for name in development if name.startswith('colcon-')]
    uv('pip', 'install', '--target', tmp_path / 'apt', '--constraints', LOCK, *colcon)
    place, home = tmp_path / 'place', tmp_path / 'home'
    place.mkdir()
    home.mkdir()
    python = Path(sys.executable).resolve().parent
    environ = {
        **{name: value for name, value in os.environ.items() if name.startswith(KEPT)},
        'HOME': str(home),
        'PATH': f'{programs}:{python}:/usr/bin:/bin',
        'PYTHONPATH': str(tmp_path / 'apt'),
    }
    exchanged = {ROS: str(ros), address(): str(tmp_path / 'published')}
    return Machine(place, environ, exchanged)


def pyproject() -> dict[str, Any]:
    return tomllib.loads((ROOT / 'pyproject.toml').read_text())


def address() -> str:
    package = ET.parse(ROOT / 'package.xml')  # noqa: S314 (our own file)
    return str(package.findtext("url[@type='repository']"))


def make_ros(ros: Path) -> None:
    """Make what stands for /opt/ros/jazzy."""
    wanted = (ROOT / 'requirements-jazzy.in').read_text().splitlines()
    python = make_venv(ros)
    install(
        python, '--constraints', ROOT / 'requirements-jazzy.lock',
        *(line for line in wanted if line.startswith('ros-')),
    )  # fmt: skip
    told = subprocess.run(
        [python, '-c', SOURCED], env={}, capture_output=True, text=True, check=True
    )
    for script in ('setup.bash', 'local_setup.bash'):  # sourced by people, and by workspaces
        (ros / script).write_text(told.stdout)
    add_program(ros / 'programs' / 'ros2', ROS2_RUN)


def add_program(file: Path, text: str) -> None:
    file.parent.mkdir()
    file.write_text(text)
    file.chmod(0o755)


@pytest.mark.timeout(600)
def test_an_order_goes_there_and_back_through_a_workspace_made_by_the_page(
    machine: Machine, bench: Bench, topic: str, tmp_path: Path
) -> None:
    build, run = fenced('docs/ros-workspace.md', 'bash')
    for word in machine.exchanged:
        assert build.count(word) == 1
    built = finished(machine.terminal(build), timeout_s=BUILT_S)
    assert built.returncode == 0, built.stdout + built.stderr
    returned = f'{topic}.returned'
    config = bench.config(
        [to_ros(topic, '/orders'), to_kafka('/orders', returned)],
        monitoring={'listen': '127.0.0.1:0'},
    )
    # `exec`: what is ended below is the bridge, not the terminal.
    lines = run.replace('ros2 run', 'exec ros2 run').replace('FILE', str(config))
    command = machine.terminal(lines, ROS_DOMAIN_ID=str(bench.domain))
    with Process(command, tmp_path / 'bridge.log') as bridge:
        bridge.wait_for('runs 2 routes')
        bench.produce(topic, [b'one', b'two'])
        assert values(bench.records(returned, 2)) == [b'one', b'two'], bridge.output()
        assert bridge.end() == 0, bridge.output()
