"""Whose definition of a type counts for a route."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final, cast

import pytest
from support.ros.package import write_package

from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.ros import used_type
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.used_type import RosEnd, RouteTypes, wait_for_type

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.node import RosNode

OWN: Final = 'acme_msgs/msg/Own'
STRING: Final = 'std_msgs/msg/String'
ROBOT, VIEWER, BRIDGE = ('/robot', 'RIHS01_aa'), ('/viewer', 'RIHS01_bb'), ('/kafka_bridge_b', '')


def peer(node: str, type_hash: str, name: str = OWN) -> Peer:
    """Somebody at the topic."""
    return Peer.of_qos(node, name, node.encode(), type_hash, profile(QoS()))


def found(
    end: RosEnd,
    publishers: Sequence[tuple[str, str]] = (),
    subscribers: Sequence[tuple[str, str]] = (),
    ros: RosSettings = RosSettings(),  # noqa: B008 (a value)
    name: str = OWN,
) -> dict[str, str] | None:
    """The definitions that are found where these are there now; None where a route waits."""
    node: Any = SimpleNamespace(
        publishers=lambda _: [peer(*one, name) for one in publishers],
        subscribers=lambda _: [peer(*one, name) for one in subscribers],
    )
    wanted = RouteTypes(cast('RosNode', node), ros).find(end, lambda _: True)
    return None if wanted is None else dict(wanted.definitions)


LEARNED, TO_KAFKA, TO_ROS = RosEnd('/t'), RosEnd('/t', OWN), RosEnd('/t', OWN, publishes=True)
BY_ROBOT, BY_VIEWER = {'RIHS01_aa': '/robot'}, {'RIHS01_bb': '/viewer'}


@pytest.mark.parametrize(
    ('end', 'publishers', 'subscribers', 'expected'),
    [
        (LEARNED, [ROBOT], [VIEWER], BY_ROBOT),
        (LEARNED, [], [VIEWER], None),
        (LEARNED, [BRIDGE], [VIEWER], BY_VIEWER),
        (TO_KAFKA, [ROBOT], [VIEWER], BY_ROBOT),
        (TO_KAFKA, [], [VIEWER], None),
        (TO_KAFKA, [BRIDGE], [VIEWER], BY_VIEWER),
        (TO_ROS, [ROBOT], [VIEWER], BY_VIEWER),
        (TO_ROS, [ROBOT], [], BY_ROBOT),
        (TO_ROS, [BRIDGE], [], None),
    ],
)
def test_who_publishes_shows_what_is_read_and_who_subscribes_what_is_published(
    end: RosEnd,
    publishers: list[tuple[str, str]],
    subscribers: list[tuple[str, str]],
    expected: dict[str, str] | None,
) -> None:
    assert found(end, publishers, subscribers) == expected


@pytest.mark.parametrize('publishes', [False, True])
def test_a_type_that_is_known_here_waits_for_nobody_unless_in_two_versions(
    tmp_path: Path, *, publishes: bool
) -> None:
    end = RosEnd('/t', STRING, publishes)
    assert found(end) == {}
    write_package(tmp_path, 'std_msgs', {'String': 'string old\n'})
    ros = RosSettings(message_path=[tmp_path])
    assert found(end, ros=ros) is None
    installed = load_layout(STRING).type_hash or ''
    robot = [('/robot', installed)]
    ends: dict[str, Any] = {'subscribers' if publishes else 'publishers': robot}
    assert found(end, ros=ros, name=STRING, **ends) == {installed: '/robot'}


def test_nodes_are_waited_for_until_they_have_names(monkeypatch: pytest.MonkeyPatch) -> None:
    unnamed = peer('/_NODE_NAME_UNKNOWN_', 'RIHS01_aa')
    looks = [[], [unnamed], [unnamed], [peer(*ROBOT)]]
    used = wait_for_type(lambda: looks.pop(0), '/t', lambda _: False)
    assert used == (OWN, BY_ROBOT)
    monkeypatch.setattr(used_type, 'ANNOUNCED_S', 0.0)
    used = wait_for_type(lambda: [unnamed], '/t', lambda _: False)
    assert used is not None
    assert used.name == OWN
