"""The newer Pythons that users have: the locked wheels exist for them, and all works as here."""

import subprocess
from pathlib import Path

import pytest
from harness import Bench
from wheels import LOCK, ROOT, build, install, make_venv, run, there_and_back

VERSIONS = ('3.12', '3.13')
# What the bridge proper stands on; the rest of tests/unit takes as long as all else here.
UNIT = (
    'config', 'kafka', 'logs', 'process', 'route', 'spool', 'turns',
    'formats/test_cdr.py', 'formats/test_json.py', 'formats/test_json_errors.py',
    'formats/test_text.py',
)  # fmt: skip
IMPORT_ALL = """
import importlib, pkgutil, ros2_kafka_bridge, warehouse
for package in (ros2_kafka_bridge, warehouse):
    for found in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
        if not found.name.endswith('.__main__'):
            importlib.import_module(found.name)
            print(found.name)
"""


def interpreter(version: str) -> Path | None:
    """A Python of that version that really answers: a shim of pyenv may stand for none."""
    named = [Path(folder, f'python{version}') for folder in ('/usr/bin', '/usr/local/bin')]
    installed = Path.home().glob(f'.pyenv/versions/{version}.*/bin/python{version}')
    managed = Path.home().glob(f'.local/share/uv/python/cpython-{version}.*/bin/python{version}')
    code = 'import ssl, sqlite3, sys; print("%d.%d" % sys.version_info[:2])'
    for candidate in (*named, *sorted(installed), *sorted(managed)):
        if candidate.exists():
            told = subprocess.run(
                [candidate, '-c', code], capture_output=True, text=True, check=False
            )
            if told.stdout.strip() == version:
                return candidate
    return None


@pytest.fixture(scope='module', params=VERSIONS)
def python(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an environment with the locked libraries, and the wheel of this project."""
    found = interpreter(request.param)
    if found is None:
        pytest.skip(f'no Python {request.param} here')
    place = tmp_path_factory.mktemp('other-python')
    wheel = build('wheel', ROOT, place / 'dist')
    made = make_venv(place / 'venv', found)
    install(made, '--require-hashes', '-r', LOCK)
    install(made, '--no-deps', wheel)
    return made


def test_every_module_is_imported_without_a_warning(python: Path, tmp_path: Path) -> None:
    strict = ('-W', 'error::SyntaxWarning', '-W', 'error::DeprecationWarning:ros2_kafka_bridge')
    told = run([python, '-P', *strict, '-c', IMPORT_ALL], tmp_path, 120)
    assert told.returncode == 0, told.stderr
    found = {name.split('.')[0] for name in told.stdout.splitlines()}
    assert found == {'ros2_kafka_bridge', 'warehouse'}


def test_the_command_line_tells_its_version(python: Path, tmp_path: Path) -> None:
    told = run([python.parent / 'ros2-kafka-bridge', '--version'], tmp_path)
    assert told.returncode == 0, told.stderr
    assert f'ros2_kafka_bridge-{told.stdout.strip()}-' in str(
        next((python.parents[2] / 'dist').glob('*.whl'))
    )


@pytest.mark.timeout(900)
def test_the_unit_tests_of_the_bridge_pass(python: Path, tmp_path: Path) -> None:
    tests = [ROOT / 'tests' / 'unit' / part for part in UNIT]
    options = ('-q', '-p', 'no:cacheprovider', '--rootdir', ROOT, '-c', ROOT / 'pyproject.toml')
    told = run([python, '-m', 'pytest', *options, *tests], tmp_path, 880)
    assert told.returncode == 0, told.stdout + told.stderr


def test_orders_through_both_directions_arrive_once_and_in_order(
    python: Path, bench: Bench, topic_name: str
) -> None:
    bridge = there_and_back(bench, topic_name, python)
    assert 'Warning' not in bridge.output()
