"""What helps where a route and somebody in the graph do not match."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from ros2_kafka_bridge.commands.check import ros
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import KafkaToRosRoute, QoS, RosToKafkaRoute
from ros2_kafka_bridge.ros.matching import reader_problem
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile


def _route(qos: str) -> KafkaToRosRoute:
    text = f"""
    name: test
    kafka: {{bootstrap.servers: localhost:9}}
    routes:
      - name: orders
        from: {{kafka: orders}}
        to: {{ros: /orders, type: std_msgs/msg/String, qos: {qos}}}
        format: text
    """
    [route] = loads(text, 'bridge.yaml', {}).routes
    assert isinstance(route, KafkaToRosRoute)
    return route


def _reader(**asked: object) -> Peer:
    return Peer.of_qos('/reader', 'std_msgs/msg/String', b'1', '', profile(QoS(**asked)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('qos', 'asked', 'cure'),
    [
        ('{}', {'durability': 'transient_local'}, '{durability: transient_local}'),
        (
            '{reliability: best_effort, depth: 5, history: keep_last}',
            {'deadline_s': 0.5},
            '{reliability: reliable, history: keep_last, depth: 5, deadline_s: 0.5}',
        ),
        (
            '{deadline_s: 2, liveliness: automatic}',
            {'liveliness': 'manual_by_topic', 'deadline_s': 4},
            '{deadline_s: 2.0, liveliness: manual_by_topic}',
        ),
    ],
)
def test_what_would_match_can_be_pasted_and_does_match(
    qos: str, asked: dict[str, object], cure: str
) -> None:
    problem = reader_problem(_route(qos), _reader(**asked), None)
    assert problem is not None
    assert problem.cure == f'set to.qos: {cure}'
    assert reader_problem(_route(cure), _reader(**asked), None) is None


@pytest.mark.parametrize('reaction', ['wait', 'publish'])
def test_a_reader_of_another_definition_is_told(reaction: Literal['wait', 'publish']) -> None:
    route = replace(_route('{}'), when_misread=reaction)
    reader = _reader()._replace(type_hash='RIHS01_bb')
    assert reader_problem(route, reader, 'RIHS01_bb') is None
    problem = reader_problem(route, reader, 'RIHS01_aa')
    assert problem is not None
    assert problem.text.startswith('would misread std_msgs/msg/String')
    assert ('the route waits' in problem.text) == (reaction == 'wait')


def test_routes_of_one_file_count_for_each_other() -> None:
    text = """
    name: test
    kafka: {bootstrap.servers: localhost:9}
    defaults: {format: text}
    routes:
      - {name: out, from: {kafka: o}, to: {ros: /orders, type: std_msgs/msg/String}}
      - {name: back, from: {ros: /orders}, to: {kafka: returned}}
    """
    config = loads(text, 'bridge.yaml', {})
    out, back = config.routes
    assert isinstance(out, KafkaToRosRoute)
    assert isinstance(back, RosToKafkaRoute)
    nobody: Any = SimpleNamespace(subscribers=lambda _: [], publishers=lambda _: [])
    [readers] = ros.reader_findings(out, config, nobody, None)
    assert readers.level == 'ok'
    assert readers.text == '1 subscriber of /orders matches, with route back of this file'
    peers = ros.publishers(back, config, nobody)
    found = [it.text for it in ros.publisher_findings(back, peers, 'std_msgs/msg/String')]
    assert found[0] == 'route out of this file publishes /orders'


def test_a_latched_publisher_is_promised_no_more_than_its_depth() -> None:
    config = loads(
        'name: b\nkafka: {bootstrap.servers: localhost:9}\nroutes:\n'
        '  - {name: back, from: {ros: /orders}, to: {kafka: returned}, format: text}\n',
        'bridge.yaml',
        {},
    )
    [back] = config.routes
    assert isinstance(back, RosToKafkaRoute)
    string, qos = 'std_msgs/msg/String', profile(QoS(), 'reliable', 'transient_local')
    latched = Peer('/node', string, bytes(16), '', 'reliable', 'transient_local', qos)
    [found] = ros.publisher_findings(back, [latched], string)
    assert found.text.endswith('comes afterwards, within its depth')
