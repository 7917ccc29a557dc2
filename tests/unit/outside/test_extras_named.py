"""The line that installs an extra begins where this program came from."""

import json
import shlex
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.outside import extras
from ros2_kafka_bridge.outside.extras import install_command

METADATA = """Metadata-Version: 2.4
Name: ros2-kafka-bridge
Version: 0.1.0
Requires-Dist: pydantic<3,>=2.9
Requires-Dist: matplotlib>=3.9; extra == 'depth'
Requires-Dist: scipy>=1.13; extra == "depth"
Requires-Dist: confluent-kafka[avro]<3,>=2.16; extra == 'avro'
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The metadata of the program, as an installer leaves them."""
    folder = tmp_path / 'ros2_kafka_bridge-0.1.0.dist-info'
    folder.mkdir()
    (folder / 'METADATA').write_text(METADATA)
    monkeypatch.setattr(metadata, 'distribution', lambda _: metadata.Distribution.at(folder))
    monkeypatch.setattr(extras, 'PUBLISHED', False)
    return folder


def words(extra: str = 'depth') -> list[str]:
    """What the line gives to pip, as a shell takes it apart."""
    said = shlex.split(install_command(extra))
    assert said[:4] == [sys.executable, '-m', 'pip', 'install']
    return said[4:]


def noted(folder: Path, url: str, **more: Any) -> None:
    (folder / 'direct_url.json').write_text(json.dumps({'url': url, **more}))


def test_from_a_checkout_it_is_that_checkout(installed: Path, tmp_path: Path) -> None:
    checkout = tmp_path / "a robot's bridge"
    checkout.mkdir()
    noted(installed, checkout.as_uri(), dir_info={})
    assert words() == [f'{checkout}[depth]']
    noted(installed, checkout.as_uri(), dir_info={'editable': True})
    assert words() == ['-e', f'{checkout}[depth]']


def test_from_a_wheel_it_is_that_wheel_as_long_as_it_is_there(
    installed: Path, tmp_path: Path
) -> None:
    wheel = tmp_path / 'ros2_kafka_bridge-0.1.0-py3-none-any.whl'
    wheel.touch()
    noted(installed, wheel.as_uri(), archive_info={})
    assert words() == [f'{wheel}[depth]']
    wheel.unlink()
    assert words() == ['matplotlib>=3.9', 'scipy>=1.13']


def test_from_elsewhere_it_is_the_libraries_since_an_address_is_masked_where_it_is_shown(
    installed: Path, tmp_path: Path
) -> None:
    commit = {'vcs_info': {'vcs': 'git', 'commit_id': '72c767e'}}
    bare = tmp_path.as_uri()  # a repository on this disk, from which pip installs no folder
    wheel = 'https://files.example/ros2_kafka_bridge-0.1.0-py3-none-any.whl?token=sesame'
    origins: list[tuple[str, dict[str, Any]]] = [
        ('https://git.example/a.git', commit),
        ('ssh://git@git.example/a.git', commit),
        (bare, commit),
        (wheel, {'archive_info': {}}),
    ]
    for url, more in origins:
        noted(installed, url, **more)
        assert words() == ['matplotlib>=3.9', 'scipy>=1.13']
        line = install_command('depth')
        assert str(ConfigError([line])) == line


def test_from_an_index_it_is_the_libraries_until_the_name_is_ours(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (installed / 'INSTALLER').write_text('pip\n')
    assert words('avro') == ['confluent-kafka[avro]<3,>=2.16']
    monkeypatch.setattr(extras, 'PUBLISHED', True)
    assert words('avro') == ['ros2-kafka-bridge[avro]']


def test_in_a_workspace_it_is_the_libraries_since_a_second_bridge_would_stand_beside_it(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert installed.exists()  # and no note of an installer, as colcon leaves it
    monkeypatch.setattr(extras, 'PUBLISHED', True)
    assert words('avro') == ['confluent-kafka[avro]<3,>=2.16']


def test_an_environment_without_pip_is_one_of_uv(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert installed.exists()
    monkeypatch.setattr(extras, 'find_spec', lambda _: None)
    said = shlex.split(install_command('avro'))
    assert said[:-1] == ['uv', 'pip', 'install', '--python', sys.executable]


def test_from_its_source_alone_it_is_that_checkout_and_no_name_that_an_index_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> Any:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, 'distribution', missing)
    file = tmp_path / 'src' / 'ros2_kafka_bridge' / 'outside' / 'extras.py'
    monkeypatch.setattr(extras, '__file__', str(file))
    assert words() == ['path/to/ros2-kafka-bridge[depth]']
    (tmp_path / 'pyproject.toml').touch()
    assert words() == [f'{tmp_path}[depth]']
