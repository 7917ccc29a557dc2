"""The Kafka of a run: topics, what they hold in the end, and when brokers are back."""

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple, Self

from confluent_kafka import Consumer, KafkaException, Message, TopicPartition

from benchmarks.faults import orders
from benchmarks.faults.checker import Seen
from benchmarks.faults.streams import LARGEST_BYTES, Stream
from rig.local_cluster import LocalCluster
from rig.topics import headers, records

_QUIET: Final = 3
_LOOK_S: Final = 0.01
_GROUPS: Final = '__consumer_offsets'
_GROUPS_S: Final = 40.0
_LOG: Final = logging.getLogger(__name__)

# No record is too old to be kept, or too far ahead of its time to be taken.
_ANY_TIME: Final = {
    'message.timestamp.after.max.ms': str(2**62),
    'message.timestamp.before.max.ms': str(2**62),
    'retention.ms': '-1',
}
_BROKERS_TIME: Final = {'message.timestamp.type': 'LogAppendTime'}


class Kept(NamedTuple):
    """A record that a topic holds in the end.

    Args:
        number: Of its order; None where it cannot be told.
        time_ns: When the broker took it, since 1970.
        place: Publisher and number there, as the bridge's headers tell.
    """

    number: int | None
    time_ns: int
    place: tuple[str, int] | None


class Doorbell:
    """Notes when ports begin to accept connections."""

    def __init__(self, addresses: Sequence[tuple[str, int]]) -> None:
        self._addresses = addresses
        self._opened_ns: dict[tuple[str, int], int] = {}
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._ring, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def opened_ns(self, count: int) -> int:
        """When so many of them accepted connections; now, where they do not yet."""
        times_ns = sorted(self._opened_ns.values())
        return times_ns[count - 1] if len(times_ns) >= count else time.time_ns()

    def _ring(self) -> None:
        while not self._done.is_set() and len(self._opened_ns) < len(self._addresses):
            for address in self._addresses:
                if address not in self._opened_ns and _accepts(address):
                    self._opened_ns[address] = time.time_ns()
            self._done.wait(_LOOK_S)


def _accepts(address: tuple[str, int]) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex(address) == 0


def start_again(cluster: LocalCluster, nodes: Sequence[int]) -> int:
    """Start nodes that were killed, all at once.

    Returns:
        When enough of them to take records accepted connections, in nanoseconds since 1970; where
        they let nobody into a group, when they did again.
    """
    addresses = [_address(server) for server in cluster.bootstrap_servers.split(',')]
    enough = len(nodes) // 2 + 1
    with (
        Doorbell([addresses[node] for node in nodes]) as bell,
        ThreadPoolExecutor(len(nodes)) as threads,
    ):
        list(threads.map(cluster.start, nodes))
        back_ns = bell.opened_ns(enough)
    return _revive_groups(cluster) or back_ns


def _revive_groups(cluster: LocalCluster) -> int | None:
    """See that Kafka lets members into groups, as who runs it would.

    Kafka 4.3.0 can end for good what loads the groups of a broker, where that becomes the leader
    of their topic twice within a moment: the first load fails when the second has begun, and the
    second one's end is ignored (CoordinatorRuntime: `Ignored load completion ... because context
    is in FAILED state`). No client gets into a group then, until that broker is started again.

    Returns:
        When it did again, where it had to be helped; None where not.
    """
    if _has_groups(cluster):
        return None
    node = cluster.leader(_GROUPS)
    _LOG.warning('the group coordinator of broker %d has failed: the broker is restarted', node)
    cluster.kill(node)
    cluster.start(node)
    _has_groups(cluster)
    return time.time_ns()


def _has_groups(cluster: LocalCluster) -> bool:
    """Whether Kafka tells within a while what a group has committed."""
    config = {
        'bootstrap.servers': cluster.bootstrap_servers,
        'group.id': 'faults.reader',
        'log_level': _QUIET,
    }
    deadline_s = time.monotonic() + _GROUPS_S
    with contextlib.closing(Consumer(config)) as consumer:
        while time.monotonic() < deadline_s:
            with contextlib.suppress(KafkaException):
                [told] = consumer.committed([TopicPartition(_GROUPS, 0)], timeout=1.0)
                if told.error is None:
                    return True
            time.sleep(_LOOK_S)
    return False


def _address(server: str) -> tuple[str, int]:
    host, _, port = server.rpartition(':')
    return host, int(port)


def create_topics(cluster: LocalCluster, stream: Stream) -> None:
    """Create the topics of a stream."""
    config = _ANY_TIME if stream.is_from_kafka else _BROKERS_TIME
    cluster.create_topic(stream.kafka_topic, stream.lines, config=config)
    # A letter must fit with all that was added to it.
    room = {'max.message.bytes': str(20 * LARGEST_BYTES), **_BROKERS_TIME}
    cluster.create_topic(stream.dead_letter_topic, config=room)


def arrived(bootstrap_servers: str, stream: Stream) -> list[Kept]:
    """What the topic of a stream to Kafka holds, in its order."""
    return [_kept(record) for record in records(bootstrap_servers, stream.kafka_topic)]


def dead_lettered(
    bootstrap_servers: str, stream: Stream, arrived_there: Sequence[Kept]
) -> list[Seen]:
    """The orders in the dead-letter topic of a stream, as far as they can be told.

    Args:
        bootstrap_servers: Where to read.
        stream: Whose they are.
        arrived_there: What the topic of a stream to Kafka holds: a publisher's numbers and those
            of its orders go up together, which tells the number of a letter without a value.
    """
    firsts = {
        kept.place[0]: kept.number - kept.place[1]
        for kept in arrived_there
        if kept.place is not None and kept.number is not None
    }
    letters = list(records(bootstrap_servers, stream.dead_letter_topic))
    numbers: dict[tuple[int, int], int] = {}
    if stream.is_from_kafka and letters:
        for record in records(bootstrap_servers, stream.kafka_topic, stream.lines):
            place = _origin(record.partition(), record.offset())
            numbers[place] = int(headers(record, 'replace')[orders.NUMBER_HEADER])
    found = []
    for record in letters:
        kept = _kept(record)
        told = headers(record, 'replace')
        number = None
        if kept.place is not None and kept.place[0] in firsts:
            number = firsts[kept.place[0]] + kept.place[1]
        if stream.is_from_kafka:
            number = numbers[_origin(told['dead_letter.partition'], told['dead_letter.offset'])]
        if number is not None:
            found.append(Seen(number, kept.time_ns))
    return found


def _origin(partition: object, offset: object) -> tuple[int, int]:
    return int(str(partition)), int(str(offset))


def _kept(record: Message) -> Kept:
    told = headers(record, 'replace')
    gid, seq = told.get('ros.gid'), told.get('ros.seq')
    place = (gid, int(seq)) if gid is not None and seq is not None else None
    number = orders.number_of(record.value() or b'')
    return Kept(number, record.timestamp()[1] * 1_000_000, place)
