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

    def enter(self, node: str, type_hash: str, kind: str = KIND, *, matched: bool = True) -> None:
        self.peers.append(Peer.of_qos(node, kind, bytes(16), type_hash, profile(QoS())))
        self.matched += matched
        self.come += matched

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
    assert graph.sink.matches == (2, 1)
    [said] = caplog.messages
    assert said == (
        f'/crane: /old subscribes to it as {KIND} {THEIRS}, installed here is {OURS}: '
        'install the same version of the package on both sides'
    )
    del graph.peers[1]
    graph.matched -= 1
    graph.sink.readers()  # what it had not acknowledged is published again
    graph.sink._graph_at_s = 0.0
    assert graph.misread == ''


def test_one_that_the_middleware_has_not_matched_holds_nobody_up() -> None:
    graph = Graph()
    graph.enter('/new', OURS)
    graph.enter('/old', THEIRS, matched=False)
    assert graph.misread == ''


@pytest.mark.parametrize(
    ('here', 'there', 'kind'),
    [(None, THEIRS, KIND), (OURS, '', KIND), (OURS, THEIRS, 'acme_msgs/msg/Hook')],
    ids=['not to be checked', 'not told', 'another type'],
)
def test_a_definition_counts_only_where_both_are_known(
    here: str | None, there: str, kind: str
) -> None:
    graph = Graph(here)
    graph.enter('/new', OURS)
    graph.enter('/old', there, kind, matched=kind == KIND)
    assert graph.misread == ''
