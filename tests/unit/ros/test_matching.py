"""What helps where a route and somebody in the graph do not match."""

import pytest

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import KafkaToRosRoute, QoS
from ros2_kafka_bridge.ros.matching import reader_problem
from ros2_kafka_bridge.ros.node import Peer
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
    problem = reader_problem(_route(qos), _reader(**asked))
    assert problem is not None
    assert problem.cure == f'set to.qos: {cure}'
    assert reader_problem(_route(cure), _reader(**asked)) is None
