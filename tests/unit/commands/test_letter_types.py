"""By which definition of its type a dead letter is read: a known one, or one that a node tells."""

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.bridges.made_letters import (
    CONFIG,
    kafka_letter,
    read,
    restorer,
    ros_letter,
    without_ros,
)
from support.ros.package import write_package

from ros2_kafka_bridge.commands.dead_letters import types
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.message_types import describe, load_layout
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.peer import Peer

CRATE = 'acme_msgs/msg/Crate'
STRING = 'std_msgs/msg/String'


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(types, '_DISCOVERY_S', 0.0)


@pytest.fixture
def crates(tmp_path: Path) -> Path:
    """What only robots have."""
    write_package(tmp_path, 'acme_msgs', {'Crate': 'string label\nint32 kilos\n'})
    return tmp_path


def config(*folders: Path, to: str = STRING, **ros: Any) -> Config:
    """A route to ROS, and one from ROS that carries whatever is published."""
    there, back = CONFIG['routes']
    routes = [
        there | {'format': 'json', 'to': {'ros': '/orders', 'type': to}},
        back | {'format': 'json', 'to': {'kafka': 'returned'}},
    ]
    settings = {'message_path': [str(one) for one in folders], **ros}
    return validated(Config, CONFIG | {'ros': settings, 'routes': routes})


def text(data: bytes) -> bytes:
    return b'\0\1\0\0' + struct.pack('<I', len(data) + 1) + data + b'\0'


def joining(name: str, folder: Path, asked: list[str]) -> Callable[[], RosNode]:
    """A node that sees one user of a type, as a folder defines it, on /orders."""

    def join() -> Any:
        asked.append('joined')
        hashed = load_layout(name, [folder]).type_hash or ''
        peer = Peer('/amr', name, b'', hashed, 'reliable', 'volatile', None)
        return SimpleNamespace(publishers=lambda _: [peer], subscribers=lambda _: [])

    return join


@pytest.fixture
def asked(crates: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was asked for; the node tells what the folder has."""
    found: list[str] = []

    def ask_users(_node: RosNode, _look: Any, name: str, wanted: str) -> Any:
        found.append(wanted)
        return describe(name, [crates])

    monkeypatch.setattr(types, 'ask_users', ask_users)
    return found


def test_a_letter_of_a_type_that_nobody_tells_stays_and_says_the_cure() -> None:
    tried: list[str] = []

    def join() -> RosNode:
        tried.append('ROS')
        return without_ros()

    restore = restorer(config(to=CRATE), join=join)
    unknown = read(ros_letter(b'', name=CRATE, type_hash='RIHS01_1'))
    for letter in (unknown, unknown, read(kafka_letter(b'{}'))):
        with pytest.raises(RecordError) as caught:
            restore.for_kafka(letter)
        assert str(caught.value) == (
            f'no message type {CRATE} here, and ROS 2 is not here; put its .msg files into a '
            'folder of ros.message_path, or install its package; ros2-kafka-bridge schema '
            f'{CRATE} --from-graph --format msg --output DIR writes them while a node runs that '
            'describes it'
        )
    assert len(tried) == 2  # once for each kind of letter: each waits for seconds


def test_a_node_tells_the_type_that_a_letter_of_ros_was_written_with_and_is_asked_once(
    crates: Path, asked: list[str]
) -> None:
    written = load_layout(CRATE, [crates]).type_hash or ''
    restore = restorer(config(), join=joining(CRATE, crates, asked))
    value = text(b'tea') + struct.pack('<I', 3)  # 4 bytes of text are aligned already
    for _ in range(2):
        again = restore.for_kafka(read(ros_letter(value, name=CRATE, type_hash=written)))
        assert again.record.value == b'{"label":"tea","kilos":3}'
    assert [one for one in asked if one != 'joined'] == [written]
    with pytest.raises(RecordError, match=rf'no node at /orders uses {CRATE} RIHS01_1: put its'):
        restore.for_kafka(read(ros_letter(value, name=CRATE, type_hash='RIHS01_1')))


def test_a_letter_to_ros_is_checked_by_the_type_that_is_used_on_the_topic(
    crates: Path, asked: list[str]
) -> None:
    restore = restorer(config(to=CRATE), join=joining(CRATE, crates, asked))
    good = read(kafka_letter(b'{"label":"tea","kilos":3}'))
    assert restore.for_ros(good).record.value == good.value
    with pytest.raises(RecordError, match=r'would fail again: DecodeError: \$\.kilos'):
        restore.for_ros(read(kafka_letter(b'{"label":"tea","kilos":"3"}')))


def test_of_two_versions_that_are_known_a_letter_to_ros_is_checked_by_the_one_in_use(
    tmp_path: Path,
) -> None:
    """The route publishes that one, too."""
    older, newer = tmp_path / 'older', tmp_path / 'newer'
    write_package(older, 'std_msgs', {'String': 'int32 older\n'})
    write_package(newer, 'std_msgs', {'String': 'string data\n'})
    joined: list[str] = []
    restore = restorer(config(older), join=joining(STRING, newer, joined))
    good = read(kafka_letter(b'{"data":"x"}'))
    assert restore.for_ros(good).record.value == good.value
    assert joined


def test_no_node_is_opened_for_what_is_known(asked: list[str], crates: Path) -> None:
    told = load_layout(STRING).type_hash or ''
    restore = restorer(config(), join=joining(CRATE, crates, asked))
    for type_hash in ('', told):
        again = restore.for_kafka(read(ros_letter(text(b'hello'), type_hash=type_hash)))
        assert again.record.value == b'{"data":"hello"}'
    restore.for_ros(read(kafka_letter(b'{"data":"hello"}')))
    assert asked == []


def test_a_letter_is_read_by_the_one_of_two_known_definitions_that_it_was_written_with(
    tmp_path: Path,
) -> None:
    write_package(tmp_path, 'std_msgs', {'String': 'string text\n'})
    for hashed, field in (
        (load_layout(STRING, [tmp_path]).type_hash, 'text'),
        (load_layout(STRING).type_hash, 'data'),
    ):
        letter = read(ros_letter(text(b'hello'), type_hash=hashed or ''))
        value = restorer(config(tmp_path)).for_kafka(letter).record.value
        assert value == b'{"%s":"hello"}' % field.encode()
    other = read(ros_letter(text(b'hello'), type_hash='RIHS01_1'))
    with pytest.raises(RecordError, match=r'would fail again: EncodeError: ros\.type_hash'):
        restorer(config(tmp_path)).for_kafka(other)


def test_where_packages_are_imported_folders_and_nodes_say_nothing(
    crates: Path, asked: list[str]
) -> None:
    made = config(crates, to=CRATE, packages='import')
    with pytest.raises(RecordError, match=r'install its package \(ros\.packages is import\)'):
        restorer(made, join=joining(CRATE, crates, asked)).for_ros(read(kafka_letter(b'{}')))
    assert asked == []


def test_letters_to_ros_are_checked_by_what_is_published_where_this_ros_needs_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that only the folder allows would hold up all behind it, at each replay."""
    write_package(tmp_path, 'std_msgs', {'String': 'string text\n'})
    letter = read(kafka_letter(b'{"text":"hello"}'))
    assert restorer(config(tmp_path), to_ros=True).for_ros(letter).record.value == letter.value
    monkeypatch.setattr(types, 'why_import', lambda: 'rmw_other needs them')
    with pytest.raises(RecordError, match='would fail again: DecodeError'):
        restorer(config(tmp_path), to_ros=True).for_ros(letter)


@pytest.mark.parametrize('name', ['', '../../x', 'std_msgs/msg/String\n'])
def test_a_name_that_is_none_of_a_type_is_asked_of_nobody(
    name: str, asked: list[str], crates: Path
) -> None:
    restore = restorer(config(), join=joining(CRATE, crates, asked))
    with pytest.raises(RecordError, match='is not of the form pkg/msg/Type'):
        restore.for_kafka(read(ros_letter(b'', name=name)))
    assert asked == []
