"""How the source follows the publishers of a topic, with a graph and readers in memory."""

import contextlib
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_hash import TypeHash
from support.ros.ends import end_of, source_of, still_graph

from ros2_kafka_bridge.endpoints import Offer
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros import take as inner
from ros2_kafka_bridge.ros.node import _peer
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.source import RosSource
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
TYPE = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)
LATCHED, VOLATILE = b'L' * 16, b'V' * 16
RCLError = rclpy_implementation.RCLError


@dataclass
class Reader:
    """A subscription with what lies in its cache."""

    durability: str
    cache: list[tuple[bytes, dict[str, Any]]] = field(default_factory=list)
    alive: bool = True
    broken: Exception | None = None
    breaks_after: int = 0
    indestructible: Exception | None = None

    def give(self, gid: bytes, *numbers: int) -> None:
        for seq in numbers:
            told = {
                'publisher_gid': {'data': gid},
                'publication_sequence_number': seq,
                'source_timestamp': 0,
            }
            self.cache.append((b'%d' % seq, told))


class Graph:
    """A node whose publishers a test sets; it is its own handle."""

    def __init__(self) -> None:
        self.peers: list[Peer] = []
        self.readers: list[Reader] = []
        self.handle = self
        self.context = None
        self.endpoint_lock = threading.Lock()
        self.graph = still_graph()
        self.problem: Exception | None = None

    def publishers(self, topic: str) -> list[Peer]:
        del topic
        if self.problem is not None:
            raise self.problem
        return list(self.peers)

    def create_subscription(self, _: type, __: str, ___: object, qos: Any, **____: Any) -> Reader:
        reader = Reader(qos.durability.name.lower())
        self.readers.append(reader)
        return reader

    def destroy_subscription(self, reader: Reader) -> None:
        reader.alive = False
        if reader.indestructible is not None:
            raise reader.indestructible

    def reader(self, durability: str) -> Reader:
        [found] = [r for r in self.readers if r.alive and r.durability == durability]
        return found


def peer(gid: bytes, durability: str) -> Peer:
    return Peer('/node', TYPE.name, gid, '', 'reliable', durability, QoSProfile(depth=1))


def take(
    reader: Reader, limit: int, _most_bytes: int = 0
) -> tuple[list[tuple[bytes, dict[str, Any]]], bool]:
    assert reader.alive, 'taken from a destroyed subscription'
    if reader.broken is not None:
        raise reader.broken
    share = min(limit, reader.breaks_after or limit)
    taken, reader.cache = reader.cache[:share], reader.cache[share:]
    if reader.breaks_after:  # in the middle: told by the next take
        reader.breaks_after, reader.broken = 0, RCLError('no memory')
        return taken, False
    return taken, len(taken) < limit


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    monkeypatch.setattr(inner, 'take', take)
    monkeypatch.setattr(rcl, 'notify', lambda *_: True)
    monkeypatch.setattr(rcl, 'notify_nobody', lambda _: True)
    return Graph()


def make(
    graph: Graph, on_offer: Callable[[Offer], None] = lambda _: None, kind: MessageType = TYPE
) -> RosSource:
    node: Any = graph
    source = source_of(end_of(node, kind), on_offer=on_offer)
    source.open()
    return source


def reader_of(source: RosSource) -> TopicReader:
    [reader] = source._readers.values()
    return reader


def look(source: RosSource) -> list[int]:
    """What it takes once the graph has told, and so much time has passed that it looks again."""
    reader_of(source)._end.node.graph.look()
    reader_of(source)._look_at_s = 0.0
    return [message.seq for message in source.take(500, 0.0)]


def following(graph: Graph, *peers: Peer) -> RosSource:
    """A source that has seen these publishers."""
    graph.peers = list(peers)
    source = make(graph)
    look(source)
    return source


def test_a_subscription_closes_only_when_it_is_empty_after_its_publisher_has_gone(
    graph: Graph,
) -> None:
    source = following(graph, peer(LATCHED, 'transient_local'), peer(VOLATILE, 'volatile'))
    volatile = graph.reader('volatile')
    volatile.give(VOLATILE, *range(1, 1001))
    graph.peers.pop()
    received = [seq for _ in range(8) for seq in look(source)]
    assert received == list(range(1, 1001))
    assert not volatile.alive


def test_what_was_taken_is_kept_when_an_unknown_publisher_comes_up_and_kafka_is_away(
    graph: Graph,
) -> None:
    def away(offer: Offer) -> None:
        if offer.durability == 'transient_local':
            raise TransportError('Kafka is away')

    graph.peers = [peer(VOLATILE, 'volatile')]
    source = make(graph, away)
    graph.reader('volatile').give(VOLATILE, *range(1, 101))
    graph.reader('volatile').give(LATCHED, 5)
    graph.peers.append(peer(LATCHED, 'transient_local'))
    assert len(source.take(500, 0.0)) == 100
    graph.reader('volatile').give(VOLATILE, 101)
    assert look(source) == [101], 'the others are taken while Kafka is away'


def test_guarantee_8_kafka_is_asked_before_an_unknown_publisher_of_a_history_counts(
    graph: Graph,
) -> None:
    """Cyclone DDS sends a history to a volatile subscription, too."""
    asked: list[Offer] = []
    source = make(graph, asked.append)
    graph.reader('volatile').give(LATCHED, *range(1, 4))
    graph.peers.append(peer(LATCHED, 'transient_local'))
    assert [message.seq for message in source.take(500, 0.0)] == [1, 2, 3]
    assert asked == [('reliable', 'volatile'), ('reliable', 'transient_local')]
    graph.reader('transient_local').give(LATCHED, *range(1, 5))
    assert [message.seq for message in source.take(500, 0.0)] == [4]


def test_a_subscription_waits_less_for_kafka_where_no_other_publisher_waits_for_its_take(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr('ros2_kafka_bridge.ros.topic_reader.time.monotonic', lambda: clock[0])
    asked: list[str] = []

    def away(offer: Offer) -> None:
        if offer.durability == 'transient_local':
            asked.append(offer.durability)
            raise TransportError('Kafka is away')

    def tries(seconds: int) -> int:
        asked.clear()
        for _ in range(10 * seconds):
            clock[0] += 0.1
            source.take(10, 0.0)
        return len(asked)

    source = make(graph, away)
    assert tries(1) == 0
    graph.peers = [peer(LATCHED, 'transient_local')]
    graph.graph.look()
    assert 15 <= tries(20) <= 21
    graph.peers.append(peer(VOLATILE, 'volatile'))
    graph.graph.look()
    tries(2)
    assert 1 <= tries(20) <= 3


def test_a_subscription_that_had_to_wait_for_kafka_opens_when_it_is_back(graph: Graph) -> None:
    answers: list[Exception | None] = [TransportError('Kafka is away'), None]

    def sometimes(_: Offer) -> None:
        if (error := answers.pop(0)) is not None:
            raise error

    graph.peers = [peer(LATCHED, 'transient_local')]
    source = make(graph, sometimes)
    assert source.take(10, 0.0) == []
    reader_of(source)._postponed.clear()
    assert look(source) == []
    graph.reader('transient_local').give(LATCHED, 1, 2)
    assert look(source) == [1, 2]


def test_it_is_exhausted_only_when_every_reader_gave_less_than_asked(graph: Graph) -> None:
    graph.peers = [peer(VOLATILE, 'volatile')]
    source = make(graph)
    reader = graph.reader('volatile')
    reader.give(VOLATILE, *range(1, 4), *range(1, 4))
    assert [m.seq for m in source.take(3, 0.0)] == [1, 2, 3]
    assert not source.exhausted
    assert source.take(3, 0.0) == [], 'all of them were there already'
    assert not source.exhausted
    source.take(3, 0.0)
    assert source.exhausted


def test_what_one_subscription_gives_is_kept_where_another_one_fails_guarantee_1(
    graph: Graph,
) -> None:
    source = following(graph, peer(LATCHED, 'transient_local'), peer(VOLATILE, 'volatile'))
    graph.reader('transient_local').broken = RCLError('out of memory, at ./rcl.c:1')
    graph.reader('volatile').give(VOLATILE, 1, 2)
    assert look(source) == [1, 2]
    with pytest.raises(RouteError, match=r'^subscription of /t: out of memory$'):
        look(source)
    graph.reader('transient_local').broken = None
    graph.reader('volatile').give(VOLATILE, 3)
    graph.reader('transient_local').give(LATCHED, 1)
    assert sorted(look(source)) == [1, 3]
    assert all(reader.alive for reader in graph.readers)


def test_a_subscription_that_fails_again_and_again_is_made_anew_guarantee_5(graph: Graph) -> None:
    source = following(graph, peer(VOLATILE, 'volatile'))
    broken = graph.reader('volatile')
    broken.broken = RCLError('invalid')
    broken.give(VOLATILE, 1)
    for _ in range(2):
        assert broken.alive
        with pytest.raises(RouteError):
            look(source)
    assert not broken.alive
    graph.reader('volatile').give(VOLATILE, 2)  # it is there already: no publisher has to wait
    assert look(source) == [2]


def test_a_subscription_that_cannot_be_made_anew_is_kept(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = following(graph, peer(VOLATILE, 'volatile'))
    broken = graph.reader('volatile')
    broken.give(VOLATILE, 1)
    broken.broken = RCLError('no memory')

    def refuse(*_: object, **__: object) -> Reader:
        raise RCLError('no memory')

    with monkeypatch.context() as patch:
        patch.setattr(graph, 'create_subscription', refuse)
        for _ in range(5):
            with pytest.raises(RouteError):
                look(source)
    broken.broken = None
    assert look(source) == [1]


def test_what_went_with_a_subscription_is_not_said_to_be_the_publishers_fault(
    graph: Graph, caplog: pytest.LogCaptureFixture
) -> None:
    graph.peers = [peer(VOLATILE, 'volatile')]
    source = make(graph)
    graph.reader('volatile').give(VOLATILE, 1)
    look(source)
    graph.reader('volatile').broken = RCLError('invalid')
    for _ in range(2):
        with pytest.raises(RouteError):
            look(source)
    graph.reader('volatile').give(VOLATILE, 5, 8)
    assert look(source) == [5, 8]
    assert source.lost_upstream == 5
    ours, theirs = caplog.messages[-2:]
    assert ours.endswith('they lay in a subscription that ROS could not read any more')
    assert theirs.endswith('faster than its readers, or was out of reach')


def test_a_take_that_fails_in_the_middle_has_not_emptied_its_reader_guarantees_1_7(
    graph: Graph,
) -> None:
    source = following(graph, peer(VOLATILE, 'volatile'))
    reader = graph.reader('volatile')
    reader.give(VOLATILE, *range(1, 11))
    reader.breaks_after = 2
    graph.peers.clear()
    assert look(source) == [1, 2]
    assert not source.exhausted, 'a stop takes on'
    with pytest.raises(RouteError):
        look(source)
    assert not source.exhausted
    reader.broken = None
    graph.peers = [peer(LATCHED, 'transient_local')]
    assert look(source) == list(range(3, 11))
    assert source.exhausted


def test_what_was_taken_is_kept_where_the_graph_cannot_be_asked_for_its_publisher_guarantee_1(
    graph: Graph,
) -> None:
    source = following(graph, peer(VOLATILE, 'volatile'))
    graph.reader('volatile').give(b'U' * 16, 1, 2)
    graph.problem = RouteError('publishers of /t: no')
    for _ in range(2):
        with pytest.raises(RouteError, match='publishers of /t: no'):
            source.take(500, 0.0)
        assert not source.exhausted, 'a stop takes on'
    graph.reader('volatile').give(b'U' * 16, 3)
    assert reader_of(source).type_hash(b'W' * 16) is None, 'asked for each message of a batch'
    with pytest.raises(RouteError, match='publishers of /t: no'):
        source.take(500, 0.0)
    graph.problem = None
    graph.peers.append(peer(b'U' * 16, 'volatile'))
    assert look(source) == [1, 2, 3]
    assert source.exhausted


def test_a_subscription_that_cannot_be_destroyed_is_left_behind(
    graph: Graph, caplog: pytest.LogCaptureFixture
) -> None:
    graph.peers = [peer(LATCHED, 'transient_local'), peer(VOLATILE, 'volatile')]
    source = make(graph)
    graph.reader('transient_local').indestructible = RCLError('invalid, at ./rcl.c:1')
    graph.reader('volatile').indestructible = RCLError('invalid, at ./rcl.c:1')
    source.close()
    assert caplog.messages[-2:] == 2 * ['subscription of /t: invalid: left behind']


def test_a_take_that_fails_in_the_middle_returns_what_it_has_and_tells_the_next_time() -> None:
    class Handle(contextlib.nullcontext[None]):
        def __init__(self) -> None:
            super().__init__()
            self.messages: list[object] = [(b'a', {}), (b'b', {}), RCLError('no memory')]

        def take_message(self, *_: object) -> object:
            message = self.messages[0]
            if isinstance(message, RCLError):
                raise message
            return self.messages.pop(0)

    subscription: Any = SimpleNamespace(handle=Handle(), msg_type=object)
    taken, is_empty = inner.take(subscription, 500)
    assert (taken, is_empty) == ([(b'a', {}), (b'b', {})], False)
    with pytest.raises(RCLError):
        inner.take(subscription, 500)


def test_a_publisher_of_another_vendor_has_the_type_hash_of_the_type_here(graph: Graph) -> None:
    """It tells none, and rclpy prints the one that is not set as `INVALID`."""
    told = TopicEndpointInfo(
        node_name='node',
        topic_type=TYPE.name,
        topic_type_hash=TypeHash(),
        endpoint_gid=list(VOLATILE),
    )
    graph.peers = [_peer(told)]
    source = make(graph, kind=TYPE._replace(type_hash='RIHS01_ab'))
    assert reader_of(source).type_hash(VOLATILE) == 'RIHS01_ab'
