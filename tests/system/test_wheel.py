"""The built wheel, in an empty environment: all is in it, and it does what it does here."""

import tarfile
from pathlib import Path

import pytest
from harness import Bench, to_ros
from wheels import LOCK, ROOT, build, contents, install, make_venv, run, there_and_back, uv


@pytest.fixture(scope='module')
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build('wheel', ROOT, tmp_path_factory.mktemp('wheel'))


@pytest.fixture(scope='module')
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build('sdist', ROOT, tmp_path_factory.mktemp('sdist'))


@pytest.fixture(scope='module')
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an environment with the wheel and what it asks for with `[ros]`, and nothing else."""
    made = make_venv(tmp_path_factory.mktemp('environment') / 'venv')
    install(made, '--constraints', LOCK, f'{wheel}[ros]')
    return made


def files(*parts: str) -> set[str]:
    """The files below some folders of the repository."""
    found = (file for part in parts for file in (ROOT / part).rglob('*') if file.is_file())
    return {str(file.relative_to(ROOT)) for file in found if '__pycache__' not in file.parts}


def test_the_wheel_holds_every_file_of_both_packages_and_no_other(wheel: Path) -> None:
    held = {name for name in contents(wheel) if '.dist-info/' not in name}
    assert held == {name.removeprefix('src/') for name in files('src')}


def test_the_sdist_builds_the_same_wheel(wheel: Path, sdist: Path, tmp_path: Path) -> None:
    assert contents(build('wheel', sdist, tmp_path)) == contents(wheel)


def test_the_sdist_holds_what_is_installed_by_hand(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        held = {member.name.partition('/')[2] for member in archive if member.isfile()}
    alone = {'LICENSE', 'README.md', 'package.xml', 'pyproject.toml', 'setup.cfg', 'setup.py'}
    folders = files('docs', 'examples', 'launch', 'packaging', 'resource', 'src')
    assert (folders | alone) - held == set()


def test_the_installed_program_is_that_of_the_wheel_and_whole(
    wheel: Path, python: Path, tmp_path: Path
) -> None:
    code = 'import ros2_kafka_bridge, sys; print(ros2_kafka_bridge.__path__[0])'
    told = run([python, '-P', '-c', code], tmp_path)
    assert told.returncode == 0, told.stderr
    site = Path(told.stdout.strip()).parent
    assert site.is_relative_to(python.parents[1])
    missing = [name for name in contents(wheel) if not (site / name).is_file()]
    assert missing == []
    version = wheel.name.split('-')[1]
    told = run([python.parent / 'ros2-kafka-bridge', '--version'], tmp_path)
    assert (told.returncode, told.stdout.strip()) == (0, version)


def test_an_order_goes_there_and_back_through_the_installed_bridge(
    python: Path, bench: Bench, topic_name: str
) -> None:
    there_and_back(bench, topic_name, python)


@pytest.mark.usefixtures('ros_domain')
def test_the_demo_runs_and_says_that_nothing_is_lost(python: Path, tmp_path: Path) -> None:
    told = run([python.parent / 'ros2-kafka-bridge', 'demo', '--seconds', '3'], tmp_path, 120)
    assert told.returncode == 0, told.stdout + told.stderr


def test_what_an_extra_brings_is_named_where_it_is_missing(
    python: Path, bench: Bench, tmp_path: Path
) -> None:
    config = bench.config([to_ros('orders', '/orders')], monitoring={'port': 0})
    told = run([python.parent / 'ros2-kafka-bridge', 'run', config], tmp_path)
    assert told.returncode == 2
    assert 'ros2-kafka-bridge[monitoring]' in told.stderr


def test_the_formats_work_with_their_extras_alone(wheel: Path, tmp_path: Path) -> None:
    python = make_venv(tmp_path / 'venv')
    install(python, '--constraints', LOCK, f'{wheel}[ros,avro,protobuf]')
    for name in ('avro', 'protobuf'):
        program = python.parent / 'ros2-kafka-bridge'
        told = run([program, 'schema', 'std_msgs/msg/String', '--format', name], tmp_path)
        assert told.returncode == 0, told.stdout + told.stderr


def test_the_warehouse_runs_from_its_extra_alone(wheel: Path, tmp_path: Path) -> None:
    python = make_venv(tmp_path / 'venv')
    install(python, '--constraints', LOCK, f'{wheel}[warehouse]')
    warehouse = python.parent / 'warehouse'
    told = run([warehouse, 'simulate', '--steps', '300'], tmp_path, 120)
    assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.parametrize('version', ['3.11', '3.12', '3.13', '3.14'])
def test_everything_but_ros_has_wheels_for_arm64(version: str, tmp_path: Path) -> None:
    extras = [f'--extra={name}' for name in ('avro', 'depth', 'monitoring', 'protobuf', 'tracing')]
    there = ('--python-platform', 'aarch64-manylinux_2_28', '--python-version', version)
    uv('pip', 'compile', ROOT / 'pyproject.toml', *extras, *there, '--only-binary', ':all:',
       '--output-file', tmp_path / 'needed.txt')  # fmt: skip
