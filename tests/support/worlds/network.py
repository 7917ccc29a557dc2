"""A DDS network in memory: publishers of a topic, subscriptions of one node, and its graph."""

import select
from collections import deque
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_hash import TypeHash
from support.worlds.kafka import Clock

from ros2_kafka_bridge.endpoints import Offer
from ros2_kafka_bridge.threads.wakeup import Wakeup

if TYPE_CHECKING:
    from collections.abc import Callable

RCLError = rclpy_implementation.RCLError
UNTOLD_S = 0.01


def is_match(offered: Offer, asked: Offer) -> bool:
    """Whether DDS lets a publisher and a subscription talk."""
    return (offered.reliability == 'reliable' or asked.reliability == 'best_effort') and (
        offered.durability == 'transient_local' or asked.durability == 'volatile'
    )


@dataclass(eq=False)
class Publisher:
    """A publisher that numbers what it sends.

    Args:
        number: Which makes its gid.
        offer: Its QoS.
        type_name: What it sends.
        type_hash: Of that; None where it tells none.
        is_lossy: Whether a subscription may miss some of its messages.
        depth: How many messages its history holds.
        sent: Its newest number.
        is_shown: Whether the graph shows it.
        is_near: Whether others reach it.
        has_gone: Whether it is no more.
    """

    number: int
    offer: Offer
    type_name: str
    type_hash: bytes | None = None
    is_lossy: bool = False
    depth: int = 1_000_000
    sent: int = 0
    is_shown: bool = False
    is_near: bool = True
    has_gone: bool = False
    gid: bytes = field(init=False)
    info: TopicEndpointInfo = field(init=False)

    def __post_init__(self) -> None:
        self.gid = bytes([self.number]) * 16
        told = TypeHash() if self.type_hash is None else TypeHash(1, self.type_hash)
        self.info = TopicEndpointInfo(
            node_name=f'node_{self.number}',
            node_namespace='/',
            topic_type=self.type_name,
            topic_type_hash=told,
            endpoint_gid=list(self.gid),
            qos_profile=QoSProfile(
                history=HistoryPolicy.KEEP_ALL,
                reliability=ReliabilityPolicy[self.offer.reliability.upper()],
                durability=DurabilityPolicy[self.offer.durability.upper()],
            ),
        )

    @property
    def sends_to(self) -> tuple[str, ...]:
        """Who gets its history: with another vendor than Fast DDS, also who does not ask."""
        asking = (self.offer.durability,) if self.offer.durability != 'volatile' else ()
        return ('volatile', *asking) if asking and self.number % 2 else asking

    @property
    def is_there(self) -> bool:
        return self.is_near and not self.has_gone

    @property
    def history(self) -> range:
        return range(max(1, self.sent - self.depth + 1), self.sent + 1)


class Sample(NamedTuple):
    """A message in a cache.

    Args:
        publisher: Who has sent it.
        seq: Its number there.
        unseen: Whether it came while the graph did not show its publisher to the node.
    """

    publisher: Publisher
    seq: int
    unseen: bool


class Reader:
    """A subscription and its own handle, with a cache in the order of each publisher."""

    def __init__(self, network: 'Network', msg_type: type, offer: Offer) -> None:
        self.handle = self
        self.msg_type = msg_type
        self.offer = offer
        self.is_open = True
        self.fails_after = 0  # so many messages
        self.failures = 0  # to come
        self.failed = 0  # in a row, until now
        self.wakeup: Wakeup | None = None  # rung as something comes
        self._network = network
        self._lines: dict[Publisher, deque[Sample]] = {}

    def __enter__(self) -> Self:
        assert self.is_open, 'a destroyed subscription is used'
        return self

    def __exit__(self, *_: object) -> None:
        pass

    @property
    def cache(self) -> list[Sample]:
        return [sample for line in self._lines.values() for sample in line]

    def put(self, sample: Sample) -> None:
        self._lines.setdefault(sample.publisher, deque()).append(sample)
        self.ring()

    def ring(self) -> None:
        if self.wakeup is not None and self._lines:
            self.wakeup.ring()

    def take_message(self, msg_type: type, raw: bool) -> object:  # noqa: FBT001 (rclpy's)
        assert raw
        assert msg_type is self.msg_type
        if self.failures and not self.fails_after:
            self.failures -= 1
            self.failed += 1
            raise RCLError('no memory')
        self.fails_after = max(0, self.fails_after - 1)
        self.failed = 0
        if not self._lines:
            return None
        publisher = self._network.random.choice(list(self._lines))
        line = self._lines[publisher]
        sample = line.popleft()
        if not line:
            del self._lines[publisher]
        self._network.on_taken(self, sample)
        return self._network.told_of(sample)


class Poll:
    """That of the kernel, but time passes in the network: what comes meanwhile, and when it ends.

    Args:
        network: In which something may come before the wait begins, or as it has just ended.
    """

    def __init__(self, network: 'Network') -> None:
        self._network = network
        self._poll = select.epoll()
        self.register = self._poll.register

    def poll(self, timeout_s: float) -> list[tuple[int, int]]:
        network = self._network
        comes, network.meanwhile = network.meanwhile, lambda: None
        if network.random.random() < 0.7:
            comes()
            comes = network.meanwhile
        found = self._poll.poll(0.0)
        if not found:
            is_empty = not any(reader.cache for reader in network.open_readers)
            assert is_empty or timeout_s <= UNTOLD_S, 'it sleeps beside what has come'
            network.clock.sleep(timeout_s)
        comes()
        return found


class Network:
    """All of it; it is also the node's handle.

    Args:
        seed: Of what comes first, and of what is lost on the way.
        has_gid: Whether the middleware tells the publisher of a message.
    """

    def __init__(self, seed: int, *, has_gid: bool) -> None:
        self.clock = Clock()
        self.random = Random(seed)  # noqa: S311 (no secret)
        self.handle = self.context = self
        self.publishers: list[Publisher] = []
        self.readers: list[Reader] = []
        self.told: list[Publisher] = []  # by the graph, last
        self.followed: list[Publisher] = []  # the same, as the source has acted on it
        self.trouble: Exception | None = None  # of the graph
        self.told_trouble: Exception | None = None  # the same, as it was asked last
        self.refuses = self.sticks = self.is_mute = False
        self.meanwhile: Callable[[], None] = lambda: None  # while somebody waits
        self.on_taken: Callable[[Reader, Sample], None]
        self.on_told: Callable[[], None]
        self.on_created: Callable[[Reader], None]
        self.on_destroyed: Callable[[Reader], None]
        self.has_gid = has_gid

    @property
    def open_readers(self) -> list[Reader]:
        return [reader for reader in self.readers if reader.is_open]

    def told_of(self, sample: Sample) -> tuple[bytes, dict[str, Any]]:
        gid, seq = sample.publisher.gid, sample.seq
        told: dict[str, Any] = {'publication_sequence_number': seq, 'source_timestamp': 1000 * seq}
        if self.has_gid:
            told |= {'publisher_gid': {'data': gid}}
        return b'%d:%d' % (sample.publisher.number, seq), told

    # What publishers do

    def publish(self, publisher: Publisher, count: int) -> None:
        if publisher.has_gone:
            return
        for _ in range(count):
            publisher.sent += 1
            for reader in self._matched(publisher):
                if not (publisher.is_lossy and self.random.random() < 0.3):
                    self._send(publisher, publisher.sent, reader)

    def come_near(self, publisher: Publisher) -> None:
        if not publisher.is_near:
            publisher.is_near = True
            for reader in self._matched(publisher):
                self._send_history(publisher, reader)

    def _matched(self, publisher: Publisher) -> list[Reader]:
        return [reader for reader in self.open_readers if self._is_matched(publisher, reader)]

    def _is_matched(self, publisher: Publisher, reader: Reader) -> bool:
        return (
            publisher.is_there
            and publisher.type_name == publisher_type(reader)
            and is_match(publisher.offer, reader.offer)
        )

    def _send_history(self, publisher: Publisher, reader: Reader) -> None:
        if reader.offer.durability in publisher.sends_to:
            for seq in publisher.history:
                self._send(publisher, seq, reader)

    def _send(self, publisher: Publisher, seq: int, reader: Reader) -> None:
        reader.put(Sample(publisher, seq, publisher not in self.followed))

    # What the graph does

    def show(self, publisher: Publisher) -> None:
        """Let the graph catch up with a publisher."""
        publisher.is_shown = publisher.is_there

    def happens(self, what: str) -> None:
        """Let something fail from now on, or be well again."""
        match what:
            case 'graph':  # catches up
                for publisher in self.publishers:
                    self.show(publisher)
            case 'stranger':
                self.trouble = UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte')
            case 'no graph':
                self.trouble = RCLError('no graph')
            case 'graph again':
                self.trouble = None
            case 'no subscription':
                self.refuses = True
            case 'sticks':
                self.sticks = True
            case 'no ringing':
                self.is_mute = True
            case _:
                assert what == 'well'
                self.refuses = self.sticks = self.is_mute = False

    def heal(self) -> None:
        """End all failures."""
        self.trouble = None
        self.refuses = self.sticks = self.is_mute = False
        for reader in self.readers:
            reader.failures = reader.fails_after = 0

    # What rcl does

    def notify(self, reader: Reader, wakeup: Wakeup) -> bool:
        assert reader.is_open
        if not self.is_mute:
            reader.wakeup = wakeup
            reader.ring()
        return not self.is_mute

    def notify_nobody(self, reader: Reader) -> bool:
        assert reader.is_open
        reader.wakeup = None
        return True

    # The handle of the node

    def get_publishers_info_by_topic(self, topic: str) -> list[TopicEndpointInfo]:
        assert topic == '/t'
        self.told_trouble = self.trouble
        if self.trouble is not None:
            raise self.trouble
        self.told = [it for it in self.publishers if it.is_shown]
        self.on_told()
        return [publisher.info for publisher in self.told]

    def create_subscription(
        self, msg_type: type, topic: str, _: object, qos: QoSProfile, *, raw: bool, **__: object
    ) -> Reader:
        assert (topic, raw) == ('/t', True)
        if self.refuses:
            raise RCLError('no memory')
        offer = Offer(qos.reliability.name.lower(), qos.durability.name.lower())
        reader = Reader(self, msg_type, offer)
        self.on_created(reader)
        self.readers.append(reader)
        for publisher in self.publishers:
            if self._is_matched(publisher, reader):
                self._send_history(publisher, reader)
        return reader

    def destroy_subscription(self, reader: Reader) -> None:
        assert reader.is_open, 'destroyed twice'
        assert reader.wakeup is None, 'it may ring for ever'
        reader.is_open = False
        self.on_destroyed(reader)
        if self.sticks:
            raise RCLError('is in use')


def publisher_type(reader: Reader) -> str:
    """The name of the type that a reader takes."""
    return str(reader.msg_type.__doc__)
