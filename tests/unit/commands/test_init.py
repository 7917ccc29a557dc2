"""The file that `init` writes, and when it writes none."""

from pathlib import Path

import pytest
from support.processes.terminal import typed

from ros2_kafka_bridge.commands.init import write
from ros2_kafka_bridge.ros.types import MessageType, load_type


def test_the_name_is_bridge_yaml_and_a_file_is_never_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert typed('init')[0] == 0
    file = tmp_path / 'bridge.yaml'
    file.write_text('mine')
    for options in ([], ['--from-graph']):
        status, out, err = typed('init', *options)
        assert (status, out) == (2, '')
        assert err.startswith('bridge.yaml: is there already: ')
        assert '--force' in err
    assert file.read_text() == 'mine'
    assert typed('init', '--force', '--bootstrap-servers', 'a:1,b:2')[0] == 0
    assert "  bootstrap.servers: 'a:1,b:2'\n" in file.read_text()
    assert typed('check', file)[0] == 0


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / 'missing' / 'bridge.yaml'
    expected = (2, '', f'{file}: cannot be written: No such file or directory\n')
    assert typed('init', file) == expected


def test_a_type_that_only_another_version_of_its_package_has_stays_a_comment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`check` and `run` would take its name for a mistake."""
    told = load_type('std_msgs/msg/String')
    known, newer = ('/a', 'acme/msg/Own'), ('/b', 'std_msgs/msg/Newer')
    monkeypatch.setattr(write, 'load_shown', lambda *_: {known: told, newer: told})
    found = write._types(None, [])  # type: ignore[arg-type]
    assert isinstance(found[known], MessageType)
    assert str(found[newer]).startswith('no message type std_msgs/msg/Newer here')
    assert 'ros.message_path' in str(found[newer])
