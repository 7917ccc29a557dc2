"""Kafka topics that are filled, watched and counted."""

import contextlib
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Final, NamedTuple

from confluent_kafka import (
    Consumer,
    ConsumerGroupState,
    KafkaException,
    Producer,
    TopicPartition,
)
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    ConsumerGroupDescription,
    NewTopic,
)

from rig.topics import records
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.testing.orders import decode

_REQUEST_S: Final = 10.0
_QUIET: Final = 3  # errors: what the clients of a benchmark warn of interests nobody
_FILL_S: Final = 120.0


class Tally(NamedTuple):
    """What came out at the end.

    Args:
        delivered: Different orders.
        duplicated: Records of an order that had come before.
        out_of_order: Orders that came behind a later one.
        first_ms: When the broker appended the first record, since 1970.
        last_ms: When it appended the last one.
    """

    delivered: int
    duplicated: int
    out_of_order: int
    first_ms: int
    last_ms: int


@contextmanager
def topics(bootstrap_servers: str, names: Sequence[str], **config: str) -> Iterator[None]:
    """Create topics of one partition, with the broker's clock; delete them at the end.

    Args:
        bootstrap_servers: Of the broker.
        names: Of the topics.
        config: Of each, with `_` for `.`.

    Raises:
        TransportError: The broker does not answer.
    """
    admin = AdminClient({'bootstrap.servers': bootstrap_servers, 'log_level': _QUIET})
    properties = {name.replace('_', '.'): value for name, value in config.items()}
    properties['message.timestamp.type'] = 'LogAppendTime'
    new = [NewTopic(name, num_partitions=1, config=properties) for name in names]
    with _ctrl_c_held_back():
        asked = admin.create_topics(new)
    for made in asked.values():
        try:
            made.result(_REQUEST_S)
        except TimeoutError as error:
            no_answer = f'{bootstrap_servers}: no answer within {_REQUEST_S:g} s: is Kafka there?'
            raise TransportError(no_answer) from error
    try:
        yield
    finally:
        for deleted in admin.delete_topics(list(names)).values():
            deleted.result(_REQUEST_S)


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Let Ctrl-C wait: the C code of confluent-kafka would make a ValueError of it."""
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def reading(bootstrap_servers: str, topic: str) -> Callable[[], bool]:
    """Make what tells whether a consumer group has given the topic to one of its members."""
    admin = AdminClient({'bootstrap.servers': bootstrap_servers, 'log_level': _QUIET})

    def of_topic(group: ConsumerGroupDescription) -> bool:
        return any(
            place.topic == topic
            for member in group.members
            if member.assignment is not None
            for place in member.assignment.topic_partitions
        )

    def look() -> bool:
        listed = admin.list_consumer_groups(states={ConsumerGroupState.STABLE})
        names = [group.group_id for group in listed.result(_REQUEST_S).valid]
        described = admin.describe_consumer_groups(names) if names else {}
        return any(of_topic(group.result(_REQUEST_S)) for group in described.values())

    def is_read() -> bool:
        try:
            with _ctrl_c_held_back():
                return look()
        except KafkaException:  # a group that ends meanwhile, a broker that is slow to say
            return False

    return is_read


def fill(bootstrap_servers: str, topic: str, values: Sequence[bytes]) -> None:
    """Produce the values in order, and wait until all are there."""
    producer = Producer(
        {
            'bootstrap.servers': bootstrap_servers,
            'log_level': _QUIET,
            'enable.idempotence': True,
            'linger.ms': 20,
            'queue.buffering.max.messages': 0,
        }
    )
    for value in values:
        producer.produce(topic, value)
    left = producer.flush(_FILL_S)
    if left:
        raise TimeoutError(f'{topic}: {left} orders were not taken within {_FILL_S:.0f} s')


class EndOffset:
    """Asks how many records a topic of one partition holds; a small request to the broker."""

    def __init__(self, bootstrap_servers: str, topic: str) -> None:
        self._client = Consumer({'bootstrap.servers': bootstrap_servers, 'group.id': topic})
        self._partition = TopicPartition(topic, 0)
        self._last = 0

    def __call__(self) -> int:
        """Ask; a broker that cannot tell just now leaves the last answer."""
        with contextlib.suppress(KafkaException):
            answer = self._client.get_watermark_offsets(self._partition, timeout=_REQUEST_S)
            self._last = answer[1]
        return self._last

    def close(self) -> None:
        """Let the connection go."""
        self._client.close()


def count(bootstrap_servers: str, topic: str, end: int) -> Tally:
    """Read a topic up to offset `end` and count what is in it."""
    seen: set[int] = set()
    duplicated = out_of_order = 0
    highest = -1
    times_ms: list[int] = []
    for record in islice(records(bootstrap_servers, topic), end):
        order_id = decode(record.value() or b'').order_id
        times_ms.append(record.timestamp()[1])
        if order_id in seen:
            duplicated += 1
        elif order_id < highest:
            out_of_order += 1
        seen.add(order_id)
        highest = max(highest, order_id)
    return Tally(len(seen), duplicated, out_of_order, min(times_ms), max(times_ms))
