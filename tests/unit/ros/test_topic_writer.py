"""Who gets what a route publishes, and who would misread it."""

import logging
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from support.ros.ends import end_of, still_graph, writer_of

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import writer_history
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.topic_end import OwnPublisher
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
KIND = 'acme_msgs/msg/Crane'
OURS, THEIRS = 'RIHS01_aa', 'RIHS01_bb'
ROOM = 5
MISREAD = f'/old would misread {KIND}: install the same version of the package on both sides'


class Graph:
    """A topic with subscribers, some of which the middleware has matched."""

    def __init__(
        self, type_hash: str | None = OURS, *, asks: bool = True, bounded: bool = True
    ) -> None:
        self.peers: list[Peer] = []
        self.matched = self.come = 0
        self.strangers = False
        node: Any = SimpleNamespace(subscribers=self._subscribers, graph=still_graph())
        kind = MessageType(KIND, object, Layout(KIND, ()), type_hash)
        end = end_of(node, kind, '/crane')
        self.tell = node.graph.look
        self.writer = writer_of(end, ROOM, asks=asks, bounded=bounded)
        self.writer._subscribers.open()
        self.handle = MagicMock()
        events = SimpleNamespace(look=lambda: (self.matched, self.come))
        self.writer._publisher = OwnPublisher(self.handle, events)

    def _subscribers(self, _topic: str) -> list[Peer]:
        if self.strangers:
            raise RouteError('somebody tells what cannot be read')
        return self.peers

    def enter(
        self,
        node: str,
        type_hash: str,
        kind: str = KIND,
        qos: QoS | None = None,
        vendor: bytes = bytes(2),
    ) -> None:
        gid = vendor + bytes([len(self.peers)] * 14)
        self.peers.append(Peer.of_qos(node, kind, gid, type_hash, profile(qos or QoS())))
        self.matched += 1
        self.come += 1

    @property
    def misread(self) -> str:
        return self.writer.readers().misread


def test_a_subscriber_of_another_definition_is_told_and_waited_out(
    caplog: pytest.LogCaptureFixture,
) -> None:
    graph = Graph()
    graph.enter('/new', OURS)
    assert graph.misread == ''
    graph.enter('/old', THEIRS)
    assert graph.misread == MISREAD, 'as soon as it has come'
    assert graph.writer.matches == (2, 0)
    [said] = caplog.messages
    assert said == (
        f'/crane: /old subscribes to it as {KIND} {THEIRS}, this route publishes {OURS}: '
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
    found = graph.writer.readers()
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


def test_readers_are_of_another_vendor_until_all_that_are_matched_are_known_not_to_be() -> None:
    fast_dds, cyclone = bytes.fromhex('010f'), bytes.fromhex('0110')
    graph = Graph()
    assert not graph.writer.readers().foreign
    graph.enter('/here', OURS, vendor=fast_dds)
    assert not graph.writer.readers().foreign
    graph.matched, graph.come = 2, 2
    assert graph.writer.readers().foreign, 'the graph does not show it yet'
    graph.enter('/there', OURS, vendor=cyclone)
    graph.matched, graph.come = 2, 2
    graph.tell()
    assert graph.writer.readers().foreign
    graph.matched, graph.come = 1, 2
    assert graph.writer.readers().foreign, 'it may be the one that is matched'
    del graph.peers[1]
    graph.tell()
    assert not graph.writer.readers().foreign
    graph.strangers = True
    graph.tell()
    assert graph.writer.readers().foreign, 'who they are is not known'


BEST_EFFORT = QoS(reliability='best_effort')


@pytest.fixture
def _no_age(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_history, '_AGE_S', 0.0)


def ended(graph: Graph, looks: int = 3) -> list[tuple[int, bool]]:
    """What each of some looks tells of what was published: how many, whether acknowledged."""
    found = [graph.writer.readers() for _ in range(looks)]
    return [(told.confirmed, told.acknowledged) for told in found]


@pytest.mark.usefixtures('_no_age')
@pytest.mark.parametrize(
    ('asks', 'readers', 'acknowledged'),
    [
        (True, [QoS()], True),
        (True, [QoS(), BEST_EFFORT], True),
        (True, [BEST_EFFORT], False),
        (True, [], False),
        (False, [QoS()], False),
    ],
    ids=['reliable', 'both', 'best effort', 'nobody', 'nobody asks'],
)
def test_guarantee_6c_only_what_a_reader_acknowledges_counts_as_acknowledged(
    *, asks: bool, readers: list[QoS], acknowledged: bool
) -> None:
    graph = Graph(asks=asks)
    for number, qos in enumerate(readers):
        graph.enter(f'/reader_{number}', OURS, qos=qos)
    graph.writer.readers()
    graph.writer.publish([b'a'])
    assert ended(graph) == [(0, False), (1, acknowledged), (1, acknowledged)]


@pytest.mark.usefixtures('_no_age')
def test_guarantee_6c_what_was_published_before_a_reliable_reader_came_it_has_not() -> None:
    graph = Graph()
    graph.enter('/lossy', OURS, qos=BEST_EFFORT)
    graph.writer.readers()
    graph.writer.publish([b'before'])
    graph.enter('/reliable', OURS)
    assert ended(graph, 2) == [(0, False), (1, False)]
    graph.writer.publish([b'then'])
    assert ended(graph, 2) == [(1, True), (2, True)]


@pytest.mark.usefixtures('_no_age')
def test_guarantee_6c_where_nobody_asks_offsets_follow_the_publication() -> None:
    """And yet what a reader may have lost that has just gone is published again."""
    graph = Graph(asks=False)
    graph.handle.wait_for_all_acked.side_effect = AssertionError('it would lie')
    graph.enter('/reader', OURS)
    graph.writer.publish([b'a'])
    assert ended(graph, 2) == [(0, False), (1, False)]
    graph.writer.publish([b'b'])
    graph.matched = 0
    assert graph.writer.readers().lost


@pytest.mark.usefixtures('_no_age')
def test_guarantee_6c_who_reads_is_not_known_where_the_graph_cannot_be_read() -> None:
    graph = Graph()
    graph.enter('/reader', OURS)
    graph.writer.readers()
    graph.strangers = True
    graph.tell()
    graph.writer.publish([b'a'])
    assert ended(graph, 2) == [(0, False), (1, False)]


@pytest.mark.usefixtures('_no_age')
@pytest.mark.parametrize(('bounded', 'taken'), [(True, 8), (False, ROOM)])
def test_where_no_history_is_bounded_no_more_are_published_until_all_are_acknowledged(
    *, bounded: bool, taken: int
) -> None:
    """A steady stream would have no pause, and no offset would ever follow."""
    graph = Graph(bounded=bounded)
    graph.enter('/reader', OURS)
    acknowledges = graph.handle.wait_for_all_acked
    acknowledges.return_value = False
    graph.writer.readers()
    assert graph.writer.publish([b'x'] * 8) == taken
    assert graph.writer.readers().confirmed == 0
    assert graph.writer.load == (ROOM, ROOM)
    assert Graph(asks=False, bounded=False).writer.load == (0, None), 'nothing bounds it'
    acknowledges.return_value = True
    assert [graph.writer.readers().confirmed for _ in range(2)][-1] == taken
    assert graph.writer.publish([b'x'])


def test_guarantee_1_of_a_batch_as_many_count_as_ros_has_taken() -> None:
    graph, taken = Graph(), list[bytes]()

    def publish(cdr: bytes) -> None:
        if cdr == b'full':
            raise rclpy_implementation.RCLError('cannot publish data, at ./rcl.c:1')
        if cdr == b'broken':
            raise rclpy_implementation.RCLError('publisher is invalid, at ./rcl.c:1')
        taken.append(cdr)

    graph.handle.handle.publish_raw.side_effect = publish
    assert graph.writer.publish([b'a', b'b', b'full', b'c']) == 2
    assert graph.writer.publish(iter([b'full'])) == 0
    graph.writer.raise_failure()
    assert graph.writer.publish([b'c', b'broken', b'd']) == 1
    assert (taken, graph.writer.load.queued) == ([b'a', b'b', b'c'], 3)
    with pytest.raises(RouteError, match=r'^publisher of /crane: publisher is invalid$'):
        graph.writer.raise_failure()
    graph.writer.raise_failure()
