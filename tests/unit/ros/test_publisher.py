"""Who gets what a route publishes, and who would misread it."""

import logging
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros.node import Peer
from ros2_kafka_bridge.ros.publisher import RosSink
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
KIND = 'acme_msgs/msg/Crane'
OURS, THEIRS = 'RIHS01_aa', 'RIHS01_bb'
MISREAD = f'/old would misread {KIND}: install the same version of the package on both sides'


class Graph:
    """A topic with subscribers, some of which the middleware has matched."""

    def __init__(self, type_hash: str | None = OURS) -> None:
        self.peers: list[Peer] = []
        self.matched = self.come = 0
        node: Any = SimpleNamespace(subscribers=lambda _: self.peers)
        kind = MessageType(KIND, object, Layout(KIND, ()), type_hash)
        self.sink = RosSink(node, '/crane', kind, QoS(), None, LOG)
        self.sink._publisher, self.sink._publisher_qos = MagicMock(), profile(QoS())
        self.sink._events = SimpleNamespace(look=lambda: (self.matched, self.come))

    def enter(self, node: str, type_hash: str, kind: str = KIND, qos: QoS | None = None) -> None:
        self.peers.append(Peer.of_qos(node, kind, bytes(16), type_hash, profile(qos or QoS())))
        self.matched += 1
        self.come += 1

    @property
    def misread(self) -> str:
        return self.sink.readers().misread


def test_a_subscriber_of_another_definition_is_told_and_waited_out(
    caplog: pytest.LogCaptureFixture,
) -> None:
    graph = Graph()
    graph.enter('/new', OURS)
    assert graph.misread == ''
    graph.enter('/old', THEIRS)
    assert graph.misread == MISREAD, 'as soon as it has come'
    assert graph.sink.matches == (2, 0)
    [said] = caplog.messages
    assert said == (
        f'/crane: /old subscribes to it as {KIND} {THEIRS}, installed here is {OURS}: '
        'install the same version of the package on both sides'
    )
    del graph.peers[1]
    graph.matched -= 1
    assert graph.misread == '', 'as soon as it has gone'


def test_one_that_comes_as_another_goes_is_seen_at_once() -> None:
    graph = Graph()
    graph.enter('/new', OURS)
    assert graph.misread == ''
    graph.matched = 0
    graph.enter('/old', THEIRS)
    found = graph.sink.readers()
    assert found.lost
    assert found.misread == MISREAD


@pytest.mark.parametrize(
    ('here', 'node', 'there', 'kind'),
    [
        (None, '/old', THEIRS, KIND),
        (OURS, '/old', '', KIND),
        (OURS, '/old', 'RIHS02_bb', KIND),
        (OURS, '/old', THEIRS, 'acme_msgs/msg/Hook'),
        (OURS, '/kafka_bridge_other', THEIRS, KIND),
    ],
    ids=['no hash here', 'none there', 'another kind of hash', 'another type', 'a bridge'],
)
def test_only_who_surely_reads_other_fields_misreads(
    here: str | None, node: str, there: str, kind: str
) -> None:
    graph = Graph(here)
    graph.enter(node, there, kind)
    assert graph.misread == ''


def test_one_whose_qos_does_not_match_gets_nothing_to_misread() -> None:
    graph = Graph()
    graph.enter('/old', THEIRS, qos=QoS(durability='transient_local'))
    assert graph.misread == ''
