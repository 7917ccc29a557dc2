"""The outer two of the five parts: kafka-producer and kafka-consumer, a process each.

Each is a function to be run by `multiprocessing`; it speaks with its parent through a connection.
Orders bear the time of their sending by the monotonic clock, which is the same for all processes
of one host.
"""

import contextlib
import signal
import time
from array import array
from collections.abc import Iterator, Sequence
from itertools import islice
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple

import msgspec
from confluent_kafka import (
    OFFSET_BEGINNING,
    Consumer,
    KafkaError,
    Message,
    Producer,
    TopicPartition,
)

from ros2_kafka_bridge.testing.orders import Order, encode, orders

PROBE: Final = -1
_STAMP: Final = 1_111_111_111_111_111_111
_BATCH: Final = 1000
_TELL_S: Final = 0.1
_POLL_S: Final = 0.05
_REQUEST_S: Final = 10.0
_FLUSH_S: Final = 60.0
_SAMPLE: Final = 2000
_SPIN_S: Final = 0.0002
_QUIET: Final = 3  # errors: what keeps a client waiting shows in the figures


class Sending(NamedTuple):
    """What a producer sends.

    Args:
        rate: Orders per second, 0 for as fast as possible.
        burst: Orders sent at once.
        total: How many.
    """

    rate: float
    burst: int
    total: int
    seed: int


class Sent(NamedTuple):
    """What a producer has sent.

    Args:
        taken: Orders that Kafka has confirmed.
        seconds: From the first one to the confirmation of the last.
    """

    taken: int
    seconds: float


class Received(NamedTuple):
    """What came to a consumer, in the order of coming.

    Args:
        sample: Of some records: place in the lists, broker's timestamp and ROS time in
            nanoseconds since 1970.
        wall_ns: What the clock since 1970 is ahead of the monotonic one.
    """

    order_ids: Sequence[int]
    sent_ns: Sequence[int]
    come_ns: Sequence[int]
    sample: Sequence[tuple[int, int, int]]
    wall_ns: int


# kafka-producer


def produce(
    parent: Connection, bootstrap_servers: str, topic: str, probed: str, sending: Sending
) -> None:
    """Send a probe to the topic `probed`; when told to, all orders to `topic`; tell `Sent`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    made = [halves(order) for order in islice(orders(sending.seed), sending.total)]
    taken = 0

    def on_delivery(error: KafkaError | None, _: Message) -> None:
        nonlocal taken
        taken += error is None

    producer = Producer(
        {
            'bootstrap.servers': bootstrap_servers,
            'enable.idempotence': True,
            'linger.ms': 0,
            'queue.buffering.max.messages': 0,
            'log_level': _QUIET,
        }
    )
    producer.list_topics(topic, _REQUEST_S)  # else its first order would wait for that
    producer.produce(probed, encode(Order(PROBE, 0, ())))
    producer.flush(_REQUEST_S)
    parent.send('probed')
    parent.recv()
    start_s = time.monotonic()
    for number, (head, tail) in enumerate(made):
        _wait_until(start_s + due_s(sending, number), producer)
        producer.produce(
            topic, b'%s%d%s' % (head, time.monotonic_ns(), tail), on_delivery=on_delivery
        )
    producer.flush(_FLUSH_S)
    seconds = time.monotonic() - start_s
    parent.send(Sent(taken, seconds))


def halves(order: Order) -> tuple[bytes, bytes]:
    """What stands before and behind the stamp of an encoded order."""
    head, _, tail = encode(Order(order.order_id, _STAMP, order.products)).partition(b'%d' % _STAMP)
    return head, tail


def due_s(sending: Sending, number: int) -> float:
    """When an order is to be sent, in seconds from the start."""
    if not sending.rate:
        return 0.0
    return (number // sending.burst) * sending.burst / sending.rate


def _wait_until(due_s: float, producer: Producer) -> None:
    producer.poll(0)
    while (left_s := due_s - time.monotonic()) > 0:
        time.sleep(max(_SPIN_S, min(left_s, _POLL_S)))
        producer.poll(0)


# kafka-consumer


class _Short(msgspec.Struct, gc=False):
    """Of an order, what is measured."""

    order_id: int
    created_ns: int


def consume(parent: Connection, bootstrap_servers: str, topic: str) -> None:
    """Read a topic; tell how many orders have come; when told to end, tell `Received`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    config: dict[str, Any] = {
        'bootstrap.servers': bootstrap_servers,
        'group.id': f'{topic}.experiment',
        'enable.auto.commit': False,
        'log_level': _QUIET,
    }
    with contextlib.closing(Consumer(config)) as consumer:
        place = TopicPartition(topic, 0, OFFSET_BEGINNING)
        consumer.assign([place])
        come = _Come()
        while not parent.poll():
            come.add(_records(consumer))
            come.tell(parent)
        parent.recv()  # nobody writes any more
        end = consumer.get_watermark_offsets(place, timeout=_REQUEST_S)[1]
        while come.read < end:
            come.add(_records(consumer))
        wall_ns = time.time_ns() - time.monotonic_ns()
        sample = list(_sample(consumer, topic, end))
    parent.send(Received(come.order_ids, come.sent_ns, come.come_ns, sample, wall_ns))


class _Come:
    """What has come."""

    def __init__(self) -> None:
        self.order_ids, self.sent_ns, self.come_ns = array('q'), array('q'), array('q')
        self.read = 0  # the next offset
        self._decode = msgspec.json.Decoder(_Short).decode
        self._tell_at_s = 0.0

    def add(self, records: Sequence[Message]) -> None:
        now_ns = time.monotonic_ns()
        for record in records:
            value = record.value()
            if record.error() is None and value is not None:
                order = self._decode(value)
                self.read = (record.offset() or 0) + 1
                self.order_ids.append(order.order_id)
                self.sent_ns.append(order.created_ns)
                self.come_ns.append(now_ns)

    def tell(self, parent: Connection) -> None:
        now_s = time.monotonic()
        if now_s >= self._tell_at_s:
            self._tell_at_s = now_s + _TELL_S
            parent.send(len(self.order_ids))


def _records(consumer: Consumer) -> Sequence[Message]:
    first = consumer.poll(_POLL_S)
    return () if first is None else (first, *consumer.consume(_BATCH, 0))


def _sample(consumer: Consumer, topic: str, end: int) -> Iterator[tuple[int, int, int]]:
    """Read the records again, and tell the times that the headers of some of them tell."""
    every = max(1, end // _SAMPLE)
    consumer.assign([TopicPartition(topic, 0, 1)])  # the first one is the probe
    place = 1
    while place < end:
        for record in _records(consumer):
            if record.error() is None:
                place = (record.offset() or 0) + 1
                told = record.headers() if place % every == 0 else None
                source_ns = dict(told or ()).get('ros.source_time_ns')
                if source_ns is not None:
                    yield place - 1, record.timestamp()[1] * 1_000_000, int(source_ns)
