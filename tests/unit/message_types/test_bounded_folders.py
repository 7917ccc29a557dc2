"""Folders of .msg files are looked at once for a whole file, and within limits."""

import os
from pathlib import Path

import pytest

from ros2_kafka_bridge import message_types
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import KnownTypes, folders, load_layout, type_names


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of one type."""
    (tmp_path / 'acme_msgs' / 'msg').mkdir(parents=True)
    (tmp_path / 'acme_msgs' / 'msg' / 'Crane.msg').write_text('int32 load\n')
    return tmp_path


@pytest.mark.parametrize('target', ['pipe', '/dev/zero'])
def test_what_is_no_file_is_not_read_as_a_definition(package: Path, target: str) -> None:
    os.mkfifo(package / 'pipe')
    file = package / 'acme_msgs' / 'msg' / 'Hook.msg'
    file.symlink_to(package / target)
    with pytest.raises(ConfigError) as caught:
        load_layout('acme_msgs/msg/Hook', [package])
    said = 'not a regular file: no pipe, socket or device is read here'
    assert caught.value.problems == [f'{file}: {said}']


def test_a_definition_is_no_large_file(package: Path) -> None:
    file = package / 'acme_msgs' / 'msg' / 'Crane.msg'
    file.write_bytes(b'#' * 1_048_577)
    with pytest.raises(ConfigError, match='larger than 1048576 bytes'):
        load_layout('acme_msgs/msg/Crane', [package])


@pytest.mark.parametrize('where', ['acme_msgs/msg/T{}.msg', 'folder{}/file'])
def test_a_disk_is_no_folder_of_packages(
    package: Path, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, '_ENTRIES_LIMIT', 10)
    for number in range(11):
        file = package / where.format(number)
        file.parent.mkdir(exist_ok=True)
        file.touch()
    with pytest.raises(ConfigError) as caught:
        type_names([package])
    said = 'more than 10 files and folders lie in it: name the folder of the packages'
    assert caught.value.problems == [f'message path {package}: {said}']


@pytest.mark.parametrize('there', [True, False])
def test_the_folders_are_looked_at_once_for_all_names(
    package: Path, monkeypatch: pytest.MonkeyPatch, *, there: bool
) -> None:
    looked: list[tuple[Path, ...]] = []
    real = message_types.type_names

    def look(path: tuple[Path, ...]) -> list[str]:
        looked.append(path)
        return real(path)

    monkeypatch.setattr(message_types, 'type_names', look)
    types = KnownTypes()
    place = package if there else package / 'nowhere'
    told = [types.unknown(f'acme_msgs/msg/Crane{number}', [place]) for number in range(102)]
    assert looked == [(place,)]
    said = 'no message type acme_msgs/msg/Crane101 here' if there else 'there is no such folder'
    assert said in (told[-1] or '')
    if there:
        assert types.unknown('acme_msgs/msg/Crane', [place]) is None
        assert '(did you mean acme_msgs/msg/Crane?)' in (told[0] or '')
        assert 'did you mean' not in (told[-1] or ''), 'nobody is told more than a hundred'
