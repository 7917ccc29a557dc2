"""A machine with systemd as its first process, whose files are those of this one and its own.

It has namespaces of its own for mounts and processes; what it writes lies in memory. The network
is that of this machine. It takes root.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import pytest
from support.patience import patient
from support.processes.harness import eventually
from support.processes.terminal import finished

from ros2_kafka_bridge.testing.owned import start_owned

REPOSITORY: Final = Path(__file__).parents[3]
_SYSTEMD: Final = '/usr/lib/systemd/systemd'
_PREFIX: Final = Path('/opt/ros2-kafka-bridge')
_PYTHON: Final = '/opt/python'
_PACKAGES: Final = '/opt/packages'

# In a cgroup of its own, which is all that it sees of them: those of this machine may be another
# systemd's. The kernel's settings are everybody's, hence read-only, as in a container.
_BOOT: Final = r"""
set -e
echo $$ > "$1/cgroup.procs"
shift
exec unshare --mount --pid --fork --kill-child --cgroup --uts sh -c '
set -e
root=$1/root
mount --make-rprivate /
mount -t tmpfs tmpfs "$1"
mkdir "$1/upper" "$1/work" "$root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$1/upper,workdir=$1/work" "$root"
rm -rf "$root"/etc/systemd/system/*.wants "$root/usr/lib/systemd/system/timers.target.wants"
mkdir -p "$root/opt/python" "$root/opt/packages" "$root/opt/repository" "$root$2"
mount --bind "$2" "$root$2"
mount --bind "$2" "$root/opt/repository"
mount --bind "$3" "$root/opt/python"
mount --bind "$5" "$root/opt/packages"
for place in run tmp; do mount -t tmpfs tmpfs "$root/$place"; done
mount --rbind /dev "$root/dev"
mount -o remount,bind,ro "$root/dev"
mount -t tmpfs tmpfs "$root/dev/shm"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t proc proc "$root/proc"
mount --bind "$root/proc/sys" "$root/proc/sys"
mount -o remount,bind,ro "$root/proc/sys"
exec env -i container=other PATH="$PATH" chroot "$root" "$4" --unit=basic.target
' sh "$@"
"""

# The libraries of this Python lie where it was built. A service may not look into a home, in which
# this repository may be.
_PROGRAM: Final = f"""#!/bin/sh
export LD_LIBRARY_PATH={_PYTHON}/lib PYTHONPATH=/opt/repository/src
exec {_PREFIX}/bin/python -m ros2_kafka_bridge "$@"
"""


class Machine(NamedTuple):
    """The machine while it runs.

    Args:
        pid: Its first process, as this machine counts.
        root: Where its files are in its own mounts.
    """

    pid: int
    root: Path

    def run(self, *command: str, timeout_s: float = 60.0) -> str:
        """Run a command of root's there to its end; returns what it says."""
        done = finished([*self._enter(), *command], timeout_s=timeout_s)
        assert done.returncode == 0, f'{command}: {done.returncode}: {done.stdout}{done.stderr}'
        return done.stdout.strip()

    def path(self, name: str) -> Path:
        """A file of the machine, as this one sees it."""
        return Path(f'/proc/{self.pid}/root', name.lstrip('/'))

    def _enter(self) -> list[str]:
        return ['nsenter', '-t', str(self.pid), '-m', '-p', '-u', '-C', '-r', '-w']


@contextmanager
def booted(place: Path) -> Iterator[Machine]:
    """Boot it, for as long as this lasts; else skip the test.

    The bridge is in /opt/ros2-kafka-bridge, with the packages and the Python of the tests.
    """
    if not shutil.which(_SYSTEMD) or os.geteuid():
        pytest.skip('systemd cannot be booted here: needs root and systemd')
    place.mkdir()
    with _cgroup(f'booted-{os.getpid()}-{place.parent.name}') as cgroup:
        base, packages = Path(sys.base_prefix).resolve(), Path(sys.prefix).resolve()
        given = (cgroup, place, REPOSITORY, base, _SYSTEMD, packages)
        process = start_owned(['sh', '-c', _BOOT, 'sh', *map(str, given)], _log(place))
        try:
            machine = _machine(process, place)
            _install(machine)
            yield machine
        finally:
            process.kill()
            process.wait()


@contextmanager
def _cgroup(name: str) -> Iterator[Path]:
    mounts = [line.split() for line in Path('/proc/mounts').read_text().splitlines()]
    places = [Path(place) for _, place, kind, *_ in mounts if kind == 'cgroup2']
    if not places or not os.access(places[0], os.W_OK):
        pytest.skip('systemd cannot be booted here: needs a cgroup2 to write to')
    cgroup = places[0] / name
    cgroup.mkdir()
    try:
        yield cgroup
    finally:
        eventually(lambda: 'populated 0' in (cgroup / 'cgroup.events').read_text(), 30)
        for folder, _, _ in os.walk(cgroup, topdown=False):
            Path(folder).rmdir()


def _log(place: Path) -> Path:
    return place.with_suffix('.log')


def _machine(process: subprocess.Popen[bytes], place: Path) -> Machine:
    until_s = time.monotonic() + patient(30)
    children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
    while time.monotonic() < until_s:
        time.sleep(0.1)
        with contextlib.suppress(OSError):  # it has ended just now
            for pid in map(int, children.read_text().split()):
                machine = Machine(pid, place / 'root')
                if _is_up(machine):
                    return machine
        if process.poll() is not None:
            break
    pytest.skip(f'systemd cannot be booted here: {_log(place).read_text()[-500:]}')


def _is_up(machine: Machine) -> bool:
    if Path(f'/proc/{machine.pid}/comm').read_text() != 'systemd\n':
        return False
    try:
        told = machine.run('systemctl', 'show', '--property=SystemState')
    except AssertionError:
        return False
    return told in {'SystemState=running', 'SystemState=degraded'}


def _install(machine: Machine) -> None:
    """Make a virtual environment at another place: what it holds is that of the tests."""
    prefix = machine.path(str(_PREFIX))
    (prefix / 'bin').mkdir(parents=True)
    (prefix / 'pyvenv.cfg').write_text(f'home = {_PYTHON}/bin\n')
    name = f'python{sys.version_info.major}.{sys.version_info.minor}'
    (prefix / 'bin/python').symlink_to(f'{_PYTHON}/bin/{name}')
    for folder in ('lib', 'lib64', 'share'):
        (prefix / folder).symlink_to(f'{_PACKAGES}/{folder}')
    program = prefix / 'bin/ros2-kafka-bridge'
    program.write_text(_PROGRAM)
    program.chmod(0o755)
