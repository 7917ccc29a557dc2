"""`make release` of a checkout whose placeholders are filled in: what is in its files."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from releasing import CHANGELOG, FACE, PLACEHOLDERS
from support.install.checkout import commit, copy_checkout, git
from support.install.containers import IMAGE, Engine, engine
from support.install.wheels import LOCK, install, make_venv, run

VERSION = '99.0.0'  # the next one, whichever is out
MAKE = 'make --no-print-directory'
NAME = f'ros2-kafka-bridge-{VERSION}'
WHEEL = f'ros2_kafka_bridge-{VERSION}-py3-none-any.whl'
SBOM_OF_IMAGE = f'{NAME}-image-amd64.cdx.json'
SBOM_OF_WHEEL = f'{NAME}.cdx.json'
ADDRESS = 'https://forge.example.org'

pytestmark = pytest.mark.timeout(900)  # an environment of its own, and an image


@pytest.fixture(scope='module')
def builder(images: Path) -> Iterator[Engine]:
    """An engine, whose image is afterwards the one that other tests have built."""
    with engine(images) as found:
        built = found.docker('image', 'inspect', '--format={{.Id}}', IMAGE)
        found.docker(
            'tag', built, f'{IMAGE}:of-before'
        )  # as a machine has it that made one before
        yield found
        found.docker('tag', built, IMAGE)


@pytest.fixture(scope='module')
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files as they are here, in a repository of their own."""
    place = tmp_path_factory.mktemp('checkout')
    copy_checkout(place)
    return place


@pytest.fixture(scope='module')
def files(checkout: Path, builder: Engine) -> Path:
    """What a release of them is made of: a folder."""
    if shutil.which('syft') is None:
        pytest.skip('what is in a release cannot be listed here: needs syft')
    for name in {line.split(':')[0] for line in marked(checkout)}:
        text = (checkout / name).read_text()
        text = text.replace('https://EXAMPLE.INVALID', ADDRESS).replace('EXAMPLE.INVALID', 'b.org')
        (checkout / name).write_text(text.replace('placeholder:', 'it was'))
    text = (checkout / CHANGELOG).read_text()
    noted = re.sub(r'^## .*', '## [Unreleased]', text, count=1, flags=re.MULTILINE)
    (checkout / CHANGELOG).write_text(noted)
    assert make(checkout, f'version V={VERSION}').returncode == 0
    commit(checkout)
    git(checkout, 'tag', f'v{VERSION}')
    builder.shell(f'{MAKE} release A=--network=host', checkout, 600)
    return checkout / 'release'


def marked(place: Path) -> list[str]:
    """The lines with a placeholder: none, once whoever publishes has filled them in."""
    marks = [word for mark in PLACEHOLDERS for word in ('-e', mark)]
    command: list[str | Path] = ['git', 'grep', '-nIF', *marks, '--', ':!tests', ':!tools']
    return run(command, place).stdout.splitlines()


def make(place: Path, target: str) -> subprocess.CompletedProcess[str]:
    return run(['sh', '-c', f'{MAKE} {target}'], place, 200)


def components(file: Path) -> dict[str, str]:
    """What an SBOM names, with versions."""
    told: dict[str, Any] = json.loads(file.read_text())
    assert told['bomFormat'] == 'CycloneDX'
    assert told['metadata']['component']['version'] == VERSION
    return {one['name'].lower(): one.get('version', '') for one in told['components']}


def locked(name: str) -> set[str]:
    """The versions of a library in the lock: a newer Python may have another one."""
    return set(re.findall(rf'^{re.escape(name)}==([^ ;]+)', LOCK.read_text(), re.MULTILINE))


def test_make_release_refuses_each_placeholder(checkout: Path) -> None:
    """First of all, before another test fills them in."""
    (checkout / 'docs' / 'support.md').write_text('Write to help@EXAMPLE.INVALID\n')
    commit(checkout)
    told = make(checkout, 'release')
    assert told.returncode == 2
    lines = marked(checkout)
    assert 'docs/support.md:1:Write to help@EXAMPLE.INVALID' in lines
    for file, number, _ in (line.split(':', 2) for line in lines):
        assert f'{file}:{number}: a placeholder' in told.stderr
    assert not (checkout / 'release').exists()


def test_the_checksums_name_every_file_and_hold(files: Path) -> None:
    named = {line.split()[1] for line in (files / 'SHA256SUMS').read_text().splitlines()}
    assert named == {
        WHEEL, f'ros2_kafka_bridge-{VERSION}.tar.gz', f'{NAME}-image-amd64.tar.gz',
        SBOM_OF_IMAGE, SBOM_OF_WHEEL,
    }  # fmt: skip
    told = run(['sha256sum', '--check', '--quiet', 'SHA256SUMS'], files)
    assert told.returncode == 0, told.stdout + told.stderr


def test_the_wheel_knows_its_address_and_is_had_by_its_name(files: Path, tmp_path: Path) -> None:
    copied = shutil.copy(files / WHEEL, tmp_path)
    python = make_venv(tmp_path / 'venv')
    install(python, '--constraints', LOCK, copied)
    Path(copied).unlink()  # where it came from is the better place, while it is there
    told = run([python.parent / 'ros2-kafka-bridge', 'depth', '--recording', 'none'], tmp_path)
    assert told.stderr.strip().endswith("'ros2-kafka-bridge[depth]'")
    metadata = next(python.parents[1].rglob('ros2_kafka_bridge-*/METADATA')).read_text()
    assert f'Project-URL: Source, {ADDRESS}/' in metadata
    assert 'EXAMPLE.INVALID' not in metadata


def test_the_image_is_loaded_from_its_archive_and_runs(files: Path, builder: Engine) -> None:
    tags = (IMAGE, f'{IMAGE}:{VERSION}')
    builder.docker('tag', IMAGE, 'kept')
    builder.docker('rmi', *tags)
    builder.docker('load', '--input', files / f'{NAME}-image-amd64.tar.gz', timeout_s=200)
    for tag in tags:
        told = builder.docker('run', '--rm', '--network=host', '--read-only', tag, '--version')
        assert told == VERSION


def test_the_sboms_say_nothing_of_where_they_were_made(files: Path, checkout: Path) -> None:
    for name in (SBOM_OF_IMAGE, SBOM_OF_WHEEL):
        assert str(checkout) not in (files / name).read_text()


def test_the_sbom_of_the_image_names_what_is_in_it_of_python_and_of_debian(files: Path) -> None:
    named = components(files / SBOM_OF_IMAGE)
    assert named['ros2-kafka-bridge'] == VERSION
    for name in ('confluent-kafka', 'msgspec', 'ros-rclpy', 'uvicorn'):
        assert named[name] in locked(name)
    assert {'libc6', 'libssl3t64', 'python3', 'tini'} <= set(named)


def test_the_sbom_of_the_wheel_names_what_its_extras_bring(files: Path) -> None:
    named = components(files / SBOM_OF_WHEEL)
    assert named['ros2-kafka-bridge'] == VERSION
    for name in ('confluent-kafka', 'fastavro', 'matplotlib', 'ros-rclpy', 'scipy', 'uvicorn'):
        assert named[name] in locked(name)
    assert 'pytest' not in named


def test_the_tag_is_what_was_released_and_nothing_was_changed_by_it(
    files: Path, checkout: Path
) -> None:
    assert files.exists()
    assert git(checkout, 'status', '--porcelain') == ''
    assert f"__version__ = '{VERSION}'" in git(checkout, 'show', f'v{VERSION}:{FACE}')
