"""The streams of orders that a run keeps flowing, and the configuration of the bridge for them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

from benchmarks.faults.memberships import Membership

MESSAGE_TYPE: Final = 'std_msgs/msg/String'
PARTITIONS: Final = 3
READER_CACHE: Final = 500
WINDOW: Final = 500
SUBSCRIBER_CACHE: Final = 100
LARGEST_BYTES: Final = 100_000

Durability = Literal['volatile', 'transient_local']
Spool = Literal['when_away', 'always']


class Stream(NamedTuple):
    """Numbered orders from one end to the other.

    Args:
        name: Unique; the name of its route, too.
        words: For the table.
        durability: Of its ROS publisher; None where the orders come from Kafka.
        spool: Mode of the disk spool of its route; None where it has none.
        lines: Orders n, n + lines, n + 2 * lines ... are one line, in which order is promised.
    """

    name: str
    words: str
    durability: Durability | None
    spool: Spool | None = None
    lines: int = 1

    @property
    def is_from_kafka(self) -> bool:
        """Whether it goes from Kafka to ROS."""
        return self.durability is None

    @property
    def kafka_topic(self) -> str:
        """Its topic in Kafka."""
        return f'faults.{self.name}'

    @property
    def ros_topic(self) -> str:
        """Its topic in ROS."""
        return f'/faults/{self.name}'

    @property
    def dead_letter_topic(self) -> str:
        """Where its dead letters go."""
        return f'{self.kafka_topic}.dead-letters'

    @property
    def in_bridge(self) -> int:
        """Messages that only the memory of a running bridge holds, at most."""
        return READER_CACHE if self.spool == 'always' else READER_CACHE + WINDOW


FROM_KAFKA: Final = Stream('to_ros', 'Kafka -> ROS', None, lines=PARTITIONS)
LATCHED: Final = Stream('latched', 'ROS -> Kafka, TRANSIENT_LOCAL', 'transient_local')
VOLATILE: Final = Stream('volatile', 'ROS -> Kafka, VOLATILE', 'volatile')
SPOOLED: Final = Stream(
    'spooled', 'ROS -> Kafka, VOLATILE, spool when_away', 'volatile', 'when_away'
)
SPOOLED_ALWAYS: Final = Stream(
    'spooled_always', 'ROS -> Kafka, VOLATILE, spool always', 'volatile', 'always'
)
STREAMS: Final[Mapping[str, Stream]] = MappingProxyType(
    {stream.name: stream for stream in (FROM_KAFKA, LATCHED, VOLATILE, SPOOLED, SPOOLED_ALWAYS)}
)


def configuration(
    bootstrap_servers: str,
    streams: Sequence[Stream],
    spools: Path,
    membership: Membership,
    *,
    is_exclusive: bool,
) -> dict[str, Any]:
    """The bridge's configuration: a route for each stream."""
    exclusive = {'exclusive': True} if is_exclusive else {}
    return {
        'name': 'faults',
        'kafka': {'bootstrap.servers': bootstrap_servers, **membership.client},
        **membership.bridge,
        'defaults': {'format': 'text', 'max_message_bytes': LARGEST_BYTES, **exclusive},
        'routes': [_route(stream, spools) for stream in streams],
    }


def _route(stream: Stream, spools: Path) -> dict[str, Any]:
    ros = {'ros': stream.ros_topic, 'type': MESSAGE_TYPE}
    kafka: dict[str, Any] = {'kafka': stream.kafka_topic}
    if stream.is_from_kafka:
        source = {**kafka, 'start': 'earliest'}
        return {'name': stream.name, 'from': source, 'to': ros, 'max_in_flight': WINDOW}
    route = {
        'name': stream.name,
        'from': {**ros, 'max_samples': READER_CACHE},
        'to': kafka,
        'max_in_flight': WINDOW,
    }
    if stream.spool is not None:
        route['spool'] = {'path': str(spools / stream.name), 'mode': stream.spool}
    return route
