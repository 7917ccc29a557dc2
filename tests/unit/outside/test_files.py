"""What a setting names is looked at before it is opened: no pipe is waited for, no text quoted."""

import os
from pathlib import Path

import pytest

from ros2_kafka_bridge.outside.files import (
    UnreadableError,
    file_problem,
    holds_text,
    read_any,
    read_regular,
)

NOT_REGULAR = 'not a regular file: no pipe, socket or device is read here'
PEM = '-----BEGIN PRIVATE KEY-----\nMIIB\n-----END PRIVATE KEY-----\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'file'
    path.write_bytes(b'hello')
    return path


def problems(path: Path, limit_bytes: int = 5) -> list[str | None]:
    """What is said of a file before a library opens it, and instead of its content."""
    with pytest.raises(UnreadableError) as caught:
        read_regular(path, limit_bytes)
    return [file_problem(path, limit_bytes), str(caught.value)]


def test_a_file_is_read_as_it_is_and_through_a_link(file: Path, tmp_path: Path) -> None:
    link = tmp_path / 'link'
    link.symlink_to(file)
    for path in (file, link):
        assert file_problem(path, 5) is None
        assert read_regular(path, 5) == read_any(path, 5) == b'hello'


def test_what_cannot_be_read_is_told_in_words(file: Path, tmp_path: Path) -> None:
    assert problems(tmp_path) == ['a directory: name the file in it'] * 2
    assert problems(file, 4) == ['larger than 4 bytes: is it the right file?'] * 2
    assert problems(tmp_path / 'gone') == ['no such file'] * 2
    assert problems(tmp_path / 'a\0b') == ['no such file'] * 2
    assert problems(file / 'below') == ['Not a directory'] * 2
    assert problems(tmp_path / ('x' * 300)) == ['File name too long'] * 2
    assert problems(Path('/dev/zero')) == [NOT_REGULAR] * 2
    os.mkfifo(tmp_path / 'pipe')
    assert problems(tmp_path / 'pipe') == [NOT_REGULAR] * 2
    with pytest.raises(UnreadableError, match='larger than 4 bytes'):
        read_any(file, 4)


def test_a_directory_may_stand_for_a_file_where_that_is_said(file: Path, tmp_path: Path) -> None:
    assert file_problem(tmp_path, or_directory=True) is None
    assert file_problem(file, or_directory=True) is None
    assert file_problem(Path('/dev/zero'), or_directory=True) == NOT_REGULAR
    assert file_problem(tmp_path / ('x' * 300), or_directory=True) == 'File name too long'


def test_a_folder_that_this_user_may_not_enter(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_path: Path) -> None:
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(Path, 'stat', refuse)
    assert problems(Path('/closed/key')) == ['no permission to read it'] * 2
    assert file_problem(Path('/closed'), or_directory=True) == 'no permission to read it'


def test_a_file_that_this_user_may_not_read(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, 'access', lambda *_args, **_more: False)
    assert problems(file) == ['no permission to read it'] * 2


def test_a_pipe_that_takes_the_place_of_a_file_is_not_waited_for(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    really = os.open

    def swapped(path: Path, flags: int) -> int:
        path.unlink()
        os.mkfifo(path)
        return really(path, flags)

    monkeypatch.setattr(os, 'open', swapped)
    with pytest.raises(UnreadableError, match=NOT_REGULAR):
        read_regular(file)


@pytest.mark.parametrize('text', [PEM, PEM.replace('\n', ' '), 'hunter2\n', 'hunter2\r'])
def test_the_text_of_a_file_is_no_name_of_one(text: str) -> None:
    assert holds_text(text)
    assert (
        problems(Path(text)) == ['holds the text of a file: write the name of the file here'] * 2
    )
