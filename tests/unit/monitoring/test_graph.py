"""Who is said to match whom in the ROS graph."""

from typing import Any

import pytest

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.monitoring import graph
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile

from .conftest import CONFIG, Told, configured

STRING = 'std_msgs/msg/String'


def peer(node: str, message_type: str = STRING, type_hash: str = 'RIHS01_aa') -> Peer:
    return Peer.of_qos(node, message_type, b'1', type_hash, profile(QoS()))


def matches(told: Told, monkeypatch: pytest.MonkeyPatch, topic: Topic) -> list[dict[str, Any]]:
    monkeypatch.setattr(graph, 'middleware', lambda: '')
    seen = graph.seen(told.watch.config, told.watch.routes, [topic])
    return [it for row in seen['topics'] for it in row['matches'] if it['node'].startswith('/')]


@pytest.mark.parametrize(
    ('ours', 'theirs', 'is_known'),
    [
        ('RIHS01_aa', 'RIHS01_aa', True),
        ('RIHS01_aa', '', False),
        ('', 'RIHS01_aa', False),
        ('RIHS01_aa', 'RIHS02_bb', False),
    ],
)
def test_whether_a_reader_has_the_same_definition_is_not_known_without_both_hashes(
    told: Told, monkeypatch: pytest.MonkeyPatch, ours: str, theirs: str, *, is_known: bool
) -> None:
    own = peer('/kafka_bridge_test', type_hash=ours)
    topic = Topic('/orders', [STRING], [own], [peer('/reader', type_hash=theirs)])
    [found] = matches(told, monkeypatch, topic)
    assert found['problem'] == ''
    assert (found['unknown'] == '') == is_known


def test_with_publishers_of_two_types_it_is_not_known_whom_a_route_takes_from(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = 'from: {ros: /orders, type: std_msgs/msg/String}'
    told.tell(configured(CONFIG.replace(source, 'from: {ros: /other}')))
    one, other = peer('/one'), peer('/other', 'std_msgs/msg/Int32')
    types = [STRING, other.message_type]
    found = matches(told, monkeypatch, Topic('/other', types, [one, other], []))
    assert [(it['problem'], bool(it['unknown'])) for it in found] == [('', True)] * 2
    [alone] = matches(told, monkeypatch, Topic('/other', [STRING], [one], []))
    assert (alone['problem'], alone['unknown']) == ('', '')
