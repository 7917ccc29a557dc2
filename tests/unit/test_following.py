"""How the source follows the publishers of a topic, with a graph and readers in memory."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import pytest
from rclpy.qos import QoSProfile

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.formats.layout import Layout
from ros2_kafka_bridge.ros import take as inner
from ros2_kafka_bridge.ros.node import Peer
from ros2_kafka_bridge.ros.subscription import Offer, RosSource
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
TYPE = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)
LATCHED, VOLATILE = b'L' * 16, b'V' * 16


@dataclass
class Reader:
    """A subscription with what lies in its cache."""

    durability: str
    cache: list[tuple[bytes, dict[str, Any]]] = field(default_factory=list)
    alive: bool = True

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

    def publishers(self, topic: str) -> list[Peer]:
        del topic
        return list(self.peers)

    def create_subscription(self, _: type, __: str, ___: object, qos: Any, **____: Any) -> Reader:
        reader = Reader(qos.durability.name.lower())
        self.readers.append(reader)
        return reader

    def destroy_subscription(self, reader: Reader) -> None:
        reader.alive = False

    def reader(self, durability: str) -> Reader:
        [found] = [r for r in self.readers if r.alive and r.durability == durability]
        return found


def peer(gid: bytes, durability: str) -> Peer:
    return Peer('/node', TYPE.name, gid, '', 'reliable', durability, QoSProfile(depth=1))


def take(reader: Reader, limit: int) -> list[tuple[bytes, dict[str, Any]]]:
    assert reader.alive, 'taken from a destroyed subscription'
    taken, reader.cache = reader.cache[:limit], reader.cache[limit:]
    return taken


class NoWaiter(NamedTuple):
    context: object

    def wait(self, *_: object) -> None:
        pass


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    monkeypatch.setattr(inner, 'take', take)
    monkeypatch.setattr(inner, 'Waiter', NoWaiter)
    return Graph()


def make(graph: Graph, on_offer: Callable[[Offer], None] = lambda _: None) -> RosSource:
    node: Any = graph
    source = RosSource(node, '/t', TYPE, QoS(), LOG, on_offer=on_offer)
    source.open()
    return source


def look(source: RosSource) -> list[int]:
    source._graph_at_s = 0.0
    return [message.seq for message in source.take(500, 0.0)]


def test_a_subscription_closes_only_when_it_is_empty_after_its_publisher_has_gone(
    graph: Graph,
) -> None:
    graph.peers = [peer(LATCHED, 'transient_local'), peer(VOLATILE, 'volatile')]
    source = make(graph)
    look(source)
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
    source._graph_at_s = float('inf')
    assert len(source.take(500, 0.0)) == 100
    graph.reader('volatile').give(VOLATILE, 101)
    assert look(source) == [101], 'the others are taken while Kafka is away'


def test_a_subscription_that_had_to_wait_for_kafka_opens_when_it_is_back(graph: Graph) -> None:
    answers: list[Exception | None] = [TransportError('Kafka is away'), None]

    def sometimes(_: Offer) -> None:
        if (error := answers.pop(0)) is not None:
            raise error

    graph.peers = [peer(LATCHED, 'transient_local')]
    source = make(graph, sometimes)
    assert source.take(10, 0.0) == []
    source._postponed.clear()
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
