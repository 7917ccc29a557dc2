"""The newer Pythons that users have: the locked wheels exist for them, and work as they do here.

Messages both ways: test_wheel.py.
"""

from pathlib import Path

import pytest
from support.install.wheels import LOCK, ROOT, build, install, interpreter, make_venv, run

VERSIONS = ('3.12', '3.13')
# What the bridge proper stands on; the rest of tests/unit takes as long as all else here.
UNIT = (
    'config', 'kafka', 'logs', 'process', 'route', 'spool', 'running', 'exclusive',
    'formats/test_cdr.py', 'formats/test_json.py', 'formats/test_json_errors.py',
    'formats/test_text.py',
)  # fmt: skip
IMPORT_ALL = """
import importlib, pkgutil, ros2_kafka_bridge, ros2_kafka_warehouse
for package in (ros2_kafka_bridge, ros2_kafka_warehouse):
    for found in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
        if not found.name.endswith('.__main__'):
            importlib.import_module(found.name)
            print(found.name)
"""


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
    assert found == {'ros2_kafka_bridge', 'ros2_kafka_warehouse'}


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
