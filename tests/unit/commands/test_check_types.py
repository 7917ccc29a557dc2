"""What `check` says of types: where they are from, or what their routes would wait for."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from support.processes.terminal import typed

from ros2_kafka_bridge.commands.check.types import FoundType, find_types
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.node import RosNode

STRING, OWN = 'std_msgs/msg/String', 'acme/msg/Own'
CURE = 'put its .msg files into a folder of ros.message_path'


def text(message_type: str, ros: str = '{}') -> str:
    return f"""\
name: b
kafka: {{bootstrap.servers: localhost:1}}
ros: {ros}
routes:
  - {{name: r, from: {{kafka: a}}, to: {{ros: /a, type: {message_type}}}, format: json}}
"""


def checked(place: Path, config: str) -> tuple[int, list[str]]:
    """What is said below the route, without asking anybody."""
    file = place / 'bridge.yaml'
    file.write_text(config)
    status, out, err = typed('check', file)
    assert err == ''
    return status, out.splitlines()[3:]


def package(place: Path) -> str:
    """A folder with the .msg files of a package; returns the settings that name it."""
    (place / 'acme' / 'msg').mkdir(parents=True)
    (place / 'acme' / 'msg' / 'Own.msg').write_text('string data\n')
    return f'{{message_path: [{place}]}}'


def test_of_a_type_that_is_not_known_here_it_says_that_a_node_is_asked(tmp_path: Path) -> None:
    asked = '    note no message type {} here{}: a node that uses /a is asked for it'
    assert checked(tmp_path, text(OWN)) == (0, [asked.format(OWN, '')])
    near = 'std_msg/msg/String'
    hint = f' (did you mean {STRING}?)'
    assert checked(tmp_path, text(near)) == (0, [asked.format(near, hint)])


def test_a_type_of_a_folder_is_checked_as_one_that_is_installed(tmp_path: Path) -> None:
    ros = package(tmp_path / 'src')
    assert checked(tmp_path, text(OWN, ros)) == (0, [])
    file = tmp_path / 'src' / 'acme' / 'msg' / 'Own.msg'
    file.write_text('string data\nnobody/Knows it\n')
    status, [bad] = checked(tmp_path, text(OWN, ros))
    assert status == 1
    assert f'BAD {file}:2: no message type nobody/msg/Knows here' in bad


def test_where_packages_are_imported_no_node_is_asked(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(text(OWN, package(tmp_path).replace('{', '{packages: import, ')))
    status, _, err = typed('check', file)
    assert status == 2
    assert f'no message type {OWN} here: install its package (ros.packages is import)' in err


def found(config: str, *readers: Peer) -> FoundType:
    """What is found where these subscribe to the topic."""
    node = SimpleNamespace(publishers=lambda _: [], subscribers=lambda _: list(readers))
    return find_types(loads(config, 'bridge.yaml', {}), cast('RosNode', node))['r']


def reader(type_hash: str = '', name: str = OWN) -> Peer:
    return Peer.of_qos('/robot', name, b'1', type_hash, profile(QoS()))


def test_a_type_that_is_installed_or_in_a_folder_is_told_with_its_hash(tmp_path: Path) -> None:
    [ok] = found(text(STRING)).found
    assert ok[:3] == ('ok', 'type', f'{STRING} is installed here')
    own = found(text(OWN, package(tmp_path)))
    assert [it.text for it in own.found] == [f'{OWN} is described by {tmp_path}/acme/msg/Own.msg']
    assert own.layout == load_layout(OWN, [tmp_path])
    assert own.layout is not None
    assert own.type_hash == own.layout.type_hash != None  # noqa: E711 (both are told)


@pytest.mark.parametrize(
    'readers',
    [[], [reader(name=STRING)], [reader()._replace(node='/kafka_bridge_b')]],
    ids=['nobody', 'another type', 'a bridge'],
)
def test_a_route_whose_type_nobody_uses_yet_waits_and_is_not_wrong(
    readers: Sequence[Peer],
) -> None:
    waiting = found(text('std_msg/msg/String'), *readers)
    [note] = waiting.found
    assert (note.level, note.waits) == ('note', 'for a node that uses /a')
    hint = f'no message type std_msg/msg/String here (did you mean {STRING}?)'
    assert f'waits for a node that uses /a, to ask it for the type: {hint}' in note.text
    assert waiting.layout is None


def test_a_type_that_nobody_describes_is_wrong_and_the_cure_is_told() -> None:
    [bad] = found(text(OWN), reader()).found
    assert bad.level == 'bad'
    assert 'nobody there tells how it is defined' in bad.text
    assert CURE in bad.text


def test_where_packages_are_imported_a_type_without_one_is_wrong() -> None:
    [bad] = found(text(OWN, '{packages: import}'), reader('RIHS01_aa')).found
    assert bad.level == 'bad'
    assert 'its package has to be installed here' in bad.text


def test_somebody_who_cannot_be_read_is_told_and_hides_no_other_route() -> None:
    def strange(_: Any) -> Any:
        raise RouteError('somebody tells what cannot be read')

    more = f'  - {{name: s, from: {{ros: /s, type: {STRING}}}, to: {{kafka: s}}, format: text}}\n'
    node = SimpleNamespace(publishers=strange, subscribers=strange)
    types = find_types(loads(text(OWN) + more, 'bridge.yaml', {}), cast('RosNode', node))
    assert [it.text for it in types['r'].found] == ['somebody tells what cannot be read']
    assert types['r'].found[0].level == 'bad'
