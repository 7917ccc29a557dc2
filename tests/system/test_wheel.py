"""The built wheel, in an empty environment: all is in it, and it does what it does here."""

import re
import shutil
import sys
import tarfile
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from packaging.metadata import Metadata
from support.bridges.routes import to_ros
from support.install.checkout import fenced
from support.install.wheels import (
    LOCK,
    ROOT,
    build,
    contents,
    install,
    interpreter,
    make_venv,
    run,
    there_and_back,
    uv,
)  # fmt: skip
from support.processes.harness import Bench
from support.processes.terminal import finished

import ros2_kafka_bridge

HERE = '3.11'
PYTHONS = (HERE, '3.12', '3.13')
BARE = {
    'ros': ['init', '--from-graph', 'found.yaml'],
    'avro': ['schema', 'std_msgs/msg/String', '--format', 'avro'],
    'protobuf': ['schema', 'std_msgs/msg/String', '--format', 'protobuf'],
    'depth': ['depth', '--recording', 'none'],
}
"""Of each extra that is needed by one command alone, such a command."""


class Dist(NamedTuple):
    """What `make dist` makes."""

    wheel: Path
    sdist: Path


def make_dist(folder: Path) -> Dist:
    command = ['make', '--no-print-directory', 'dist', f'DIST={folder}']
    done = finished(command, cwd=ROOT, timeout_s=200)
    assert done.returncode == 0, done.stdout + done.stderr
    wheel, sdist = map(Path, done.stdout.split())
    return Dist(wheel, sdist)


@pytest.fixture(scope='module')
def dist(tmp_path_factory: pytest.TempPathFactory) -> Dist:
    return make_dist(tmp_path_factory.mktemp('dist'))


@pytest.fixture(scope='module')
def wheel(dist: Dist) -> Path:
    return dist.wheel


@pytest.fixture(scope='module', params=PYTHONS)
def python(
    request: pytest.FixtureRequest, wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Of an environment with the wheel and what it asks for with `[ros]`, and nothing else."""
    found = Path(sys.executable) if request.param == HERE else interpreter(request.param)
    if found is None:
        pytest.skip(f'no Python {request.param} here')
    made = make_venv(tmp_path_factory.mktemp('environment') / 'venv', found)
    install(made, '--constraints', LOCK, f'{wheel}[ros]')
    return made


@pytest.fixture(scope='module')
def bare(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The commands of an environment with the wheel and no extra, and with a pip of its own."""
    place = tmp_path_factory.mktemp('bare') / 'a venv'  # what is a line for a shell is quoted
    made = run([sys.executable, '-m', 'venv', place], place.parent)
    assert made.returncode == 0, made.stderr
    install(place / 'bin' / 'python', '--constraints', LOCK, wheel)
    return place / 'bin'


def files(*parts: str) -> set[str]:
    """The files below some folders of the repository."""
    found = (file for part in parts for file in (ROOT / part).rglob('*') if file.is_file())
    return {str(file.relative_to(ROOT)) for file in found if '__pycache__' not in file.parts}


def metadata(wheel: Path) -> Metadata:
    [text] = (text for name, text in contents(wheel).items() if name.endswith('/METADATA'))
    return Metadata.from_email(text)  # it raises where a field is not as it should be


def test_the_wheel_holds_every_file_of_both_packages_and_no_other(wheel: Path) -> None:
    held = {name for name in contents(wheel) if '.dist-info/' not in name}
    assert held == {name.removeprefix('src/') for name in files('src')}


def test_all_that_it_installs_bears_its_name(wheel: Path) -> None:
    """Of two distributions with a package or command of one name pip overwrites one, silently."""
    packages = {name.partition('/')[0] for name in contents(wheel)}
    [entries] = (
        text for name, text in contents(wheel).items() if name.endswith('/entry_points.txt')
    )
    commands = set(re.findall(r'^(\S+) = ', entries.decode(), re.MULTILINE))
    assert commands
    assert {name for name in packages if not name.startswith('ros2_kafka_')} == set()
    assert {name for name in commands if not name.startswith('ros2-kafka-')} == set()


def test_the_sdist_builds_the_same_wheel(dist: Dist, tmp_path: Path) -> None:
    assert contents(build('wheel', dist.sdist, tmp_path)) == contents(dist.wheel)


def test_built_again_it_has_the_same_bytes(dist: Dist, tmp_path: Path) -> None:
    again = make_dist(tmp_path / 'again')
    assert [file.read_bytes() for file in again] == [file.read_bytes() for file in dist]


def test_the_sdist_holds_what_is_installed_by_hand(dist: Dist) -> None:
    with tarfile.open(dist.sdist) as archive:
        held = {member.name.partition('/')[2] for member in archive if member.isfile()}
    alone = {'LICENSE', 'README.md', 'package.xml', 'pyproject.toml', 'setup.cfg', 'setup.py'}
    folders = files('docs', 'examples', 'launch', 'packaging', 'resource', 'src')
    assert (folders | alone) - held == set()


def test_the_metadata_is_complete_and_leads_nowhere_beside_it(wheel: Path) -> None:
    told = metadata(wheel)
    assert str(told.version) == ros2_kafka_bridge.__version__
    assert {'Source', 'Documentation', 'Issues', 'Changelog'} <= set(told.project_urls or ())
    needed = (told.summary, told.license_expression, told.license_files, told.author,
              told.keywords, told.requires_python, told.classifiers)  # fmt: skip
    assert all(needed)
    page = told.description or ''
    assert page.startswith('# ros2-kafka-bridge')
    targets = re.findall(r'\]\((.*?)\)', page)
    assert len(targets) > 40
    assert [target for target in targets if not target.startswith(('https://', '#'))] == []
    assert f'/raw/v{told.version}/docs/images/' in page


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
    told = run([python.parent / 'ros2-kafka-bridge', '--version'], tmp_path)
    assert (told.returncode, told.stdout.strip()) == (0, ros2_kafka_bridge.__version__)


def test_an_order_goes_there_and_back_through_the_installed_bridge(
    python: Path, bench: Bench, topic_name: str
) -> None:
    bridge = there_and_back(bench, topic_name, python)
    assert 'Warning' not in bridge.output()


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('python', [HERE], indirect=True)
def test_the_demo_runs_and_says_that_nothing_is_lost(python: Path, tmp_path: Path) -> None:
    told = run([python.parent / 'ros2-kafka-bridge', 'demo', '--seconds', '3'], tmp_path, 120)
    assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.parametrize('part', ['monitoring', 'tracing'])
@pytest.mark.parametrize('python', [HERE], indirect=True)
def test_a_part_whose_extra_is_missing_keeps_the_bridge_from_starting_and_names_it(
    python: Path, part: str, bench: Bench, tmp_path: Path
) -> None:
    settings: dict[str, Any] = {
        'monitoring': {'port': 0},
        'tracing': {'endpoint': 'http://localhost:4318'},
    }
    config = bench.config([to_ros('orders', '/orders')], **{part: settings[part]})
    told = run([python.parent / 'ros2-kafka-bridge', 'run', config], tmp_path)
    assert told.returncode == 2
    assert f'[{part}]' in told.stderr
    assert 'Traceback' not in told.stderr


@pytest.mark.parametrize('extra', BARE)
def test_the_program_without_an_extra_names_it_in_a_sentence(
    bare: Path, extra: str, tmp_path: Path
) -> None:
    told = run([bare / 'ros2-kafka-bridge', *BARE[extra]], tmp_path)
    assert told.returncode == 2
    [sentence] = told.stderr.splitlines()
    assert sentence.endswith(f"[{extra}]'")


@pytest.mark.parametrize(
    'words', [['run', '--port', '0'], ['module', 'orders'], ['simulate'], ['benchmark']]
)
def test_the_warehouse_without_its_extra_names_it_in_a_sentence(
    bare: Path, words: list[str], tmp_path: Path
) -> None:
    told = run([bare / 'ros2-kafka-warehouse', *words], tmp_path)
    assert told.returncode == 2
    [sentence] = told.stderr.splitlines()
    assert sentence.endswith("[warehouse]'")


def test_the_line_that_names_an_extra_installs_it(bare: Path, tmp_path: Path) -> None:
    (tmp_path / 'gaps').write_text('1000000\n2000000\n3000000\n')
    command: list[str | Path] = [
        bare / 'ros2-kafka-bridge', 'depth', '--arrivals', 'gaps', '--service', '0.1ms',
    ]  # fmt: skip
    sentence = run(command, tmp_path).stderr
    assert sentence.startswith('depth needs scipy, which is not installed: ')
    done = run(['sh', '-c', sentence.partition('installed: ')[2]], tmp_path, 200)
    assert done.returncode == 0, done.stdout + done.stderr
    told = run(command, tmp_path)
    assert 'depth needs' not in told.stdout + told.stderr
    assert told.returncode in {0, 1}, told.stderr


def test_it_is_installed_as_the_page_says_also_without_a_network(
    dist: Dist, tmp_path: Path
) -> None:
    make, *lines = fenced('docs/install.md', 'sh')
    assert make == 'make dist\n'  # as the fixture has done
    shutil.copytree(dist.wheel.parent, tmp_path / 'dist')
    for name, line in zip(('here', 'here', 'there'), lines, strict=True):
        place = tmp_path / name
        if not place.exists():
            made = run([sys.executable, '-m', 'venv', place], tmp_path)
            assert made.returncode == 0, made.stderr
        pip = line.replace('pip ', f'{place}/bin/pip ', 1)
        done = run(['sh', '-c', pip], tmp_path, 200)
        assert done.returncode == 0, done.stdout + done.stderr
    told = run([tmp_path / 'there' / 'bin' / 'ros2-kafka-bridge', '--version'], tmp_path)
    assert told.stdout.strip() == ros2_kafka_bridge.__version__


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
    warehouse = python.parent / 'ros2-kafka-warehouse'
    told = run([warehouse, 'simulate', '--steps', '300'], tmp_path, 120)
    assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.parametrize('version', ['3.11', '3.12', '3.13', '3.14'])
def test_everything_but_ros_has_wheels_for_arm64(version: str, tmp_path: Path) -> None:
    extras = [f'--extra={name}' for name in ('avro', 'depth', 'monitoring', 'protobuf', 'tracing')]
    there = ('--python-platform', 'aarch64-manylinux_2_28', '--python-version', version)
    uv('pip', 'compile', ROOT / 'pyproject.toml', *extras, *there, '--only-binary', ':all:',
       '--output-file', tmp_path / 'needed.txt')  # fmt: skip
