"""The project as users install it: its wheel, and empty environments to put it into."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Final

from support.bridges.routes import to_kafka, to_ros, values
from support.processes.harness import Bench, Process
from support.processes.terminal import finished

ROOT: Final = Path(__file__).parents[3]
LOCK: Final = ROOT / 'requirements.lock'
COUNT: Final = 1000
_UV: Final = Path(sys.executable).parent / 'uv'
_UV_S: Final = 200.0


def uv(*words: str | Path) -> None:
    """Run uv to its end, which has to be a good one."""
    environ = {'UV_SYSTEM_CERTS': 'true', **os.environ}
    done = finished([_UV, *words], env=environ, timeout_s=_UV_S)
    assert done.returncode == 0, done.stdout + done.stderr


def build(kind: str, source: Path, folder: Path) -> Path:
    """Build the `wheel` or the `sdist` of a source; returns the file."""
    uv('build', f'--{kind}', '--out-dir', folder, source)
    [file] = folder.glob('*.whl' if kind == 'wheel' else '*.tar.gz')
    return file


def contents(wheel: Path) -> dict[str, bytes]:
    """The files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def interpreter(version: str) -> Path | None:
    """A Python of that version that really answers: a shim of pyenv may stand for none."""
    named = [Path(folder, f'python{version}') for folder in ('/usr/bin', '/usr/local/bin')]
    installed = Path.home().glob(f'.pyenv/versions/{version}.*/bin/python{version}')
    managed = Path.home().glob(f'.local/share/uv/python/cpython-{version}.*/bin/python{version}')
    code = 'import ssl, sqlite3, sys; print("%d.%d" % sys.version_info[:2])'
    for candidate in (*named, *sorted(installed), *sorted(managed)):
        if candidate.exists():
            told = finished([candidate, '-c', code])
            if told.stdout.strip() == version:
                return candidate
    return None


def make_venv(place: Path, python: str | Path = sys.executable) -> Path:
    """Make an empty environment; returns its Python."""
    uv('venv', '--python', python, place)
    return place / 'bin' / 'python'


def install(python: Path, *words: str | Path) -> None:
    """Install into an environment."""
    uv('pip', 'install', '--python', python, *words)


def run(
    command: list[str | Path], place: Path, timeout_s: float = 60.0
) -> subprocess.CompletedProcess[str]:
    """Run a command outside of the source tree, with nothing of the tests' own environment."""
    mine = ('PYTHON', 'PYTEST', 'VIRTUAL_ENV', 'LD_LIBRARY_PATH', 'AMENT', '_ROS_WHEELS')
    environ = {name: value for name, value in os.environ.items() if not name.startswith(mine)}
    return finished(command, cwd=place, env=environ, timeout_s=timeout_s)


def there_and_back(bench: Bench, topic: str, python: Path) -> Process:
    """Bring orders to ROS and back, once and in order, by the bridge of that Python."""
    sent = [b'order %d' % number for number in range(COUNT)]
    returned = f'{topic}.returned'
    config = bench.config([to_ros(topic, '/orders'), to_kafka('/orders', returned)])
    bench.create_topic(topic)
    with bench.drained(config, python=python) as bridge:
        bench.produce(topic, list(sent))
        assert values(bench.records(returned, COUNT)) == sent
    return bridge
