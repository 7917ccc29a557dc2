"""The system outside of ROS: it sends orders to a topic, and reads those that come back."""

import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import closing
from typing import Final, Self

from confluent_kafka import (
    OFFSET_BEGINNING,
    Consumer,
    KafkaError,
    KafkaException,
    Message,
    Producer,
    TopicPartition,
)

from ros2_kafka_bridge.demo.tally import Arrival
from ros2_kafka_bridge.logs.lines import client_log
from ros2_kafka_bridge.testing.orders import Order, decode, encode, orders

SEED: Final = 1
PROBE: Final = -1
_BATCH: Final = 500
_WAIT_S: Final = 0.05
_FLUSH_S: Final = 10.0
_REQUEST_S: Final = 5.0
PARTITIONS_S: Final = 15.0
# A sender that was held up catches up this much and no more: a burst that the rate does not say
# would be blamed on those who carry it.
_BURST_S: Final = 0.01


class Sender:
    """Sends orders evenly, from a thread of its own.

    Args:
        properties: Of its Kafka client.
        topic: Where they go, into partition 0.
        rate: Orders per second.
        count: How many.
    """

    def __init__(self, properties: Mapping[str, str], topic: str, rate: float, count: int) -> None:
        self.produced = 0  # taken by the broker
        self.sent = 0
        self.started_s = 0.0
        self.ended_s = 0.0
        self._topic = topic
        self._rate = rate
        self._count = count
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='sender', daemon=True)
        self._properties = {**properties, 'enable.idempotence': True}
        self._client: Producer | None = None

    def __enter__(self) -> Self:
        self._client = Producer(self._properties, logger=client_log(__name__))
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._producer.purge()
        if self._thread.ident:
            self._thread.join()
        self._producer.close()
        self._client = None

    def probe(self) -> None:
        """Send one order that does not count."""
        value = encode(Order(PROBE, time.time_ns(), ()))
        self._producer.produce(self._topic, value, partition=0)

    def start(self) -> None:
        """Begin to send."""
        self.started_s = time.monotonic()
        self._thread.start()

    def stop(self) -> None:
        """Send no more."""
        self._stop.set()

    @property
    def sends(self) -> bool:
        """Whether it still sends, or waits for the broker to take what it has sent."""
        return self._thread.is_alive()

    @property
    def rate(self) -> float:
        """Orders per second that were really sent."""
        until_s = self.ended_s or time.monotonic()
        return self.sent / max(until_s - self.started_s, 1 / self._rate)

    @property
    def _producer(self) -> Producer:
        assert self._client is not None, 'the sender is not open'
        return self._client

    def _run(self) -> None:
        made = orders(SEED)
        due_s = self.started_s
        while self.sent < self._count and self._wait(due_s):
            self._send(encode(next(made)))
            due_s = max(due_s + 1 / self._rate, time.monotonic() - _BURST_S)
        self.ended_s = max(due_s, time.monotonic())
        self._producer.flush(_FLUSH_S)

    def _wait(self, until_s: float) -> bool:
        """Wait for a moment; tells whether to go on."""
        left_s = until_s - time.monotonic()
        self._producer.poll(0)
        return not (self._stop.wait(left_s) if left_s > 0 else self._stop.is_set())

    def _send(self, value: bytes) -> None:
        while not self._stop.is_set():
            try:
                self._producer.produce(
                    self._topic, value, partition=0, on_delivery=self._on_delivery
                )
            except BufferError:
                self._producer.poll(_WAIT_S)
            else:
                self.sent += 1
                return

    def _on_delivery(self, error: KafkaError | None, _: Message) -> None:
        self.produced += error is None


class Receiver:
    """Reads a topic from its beginning, from a thread of its own.

    Args:
        properties: Of its Kafka client.
        topic: What to read.
    """

    def __init__(self, properties: Mapping[str, str], topic: str) -> None:
        self.arrivals: deque[Arrival] = deque()
        self.started_s = 0.0  # when the first order was sent: arrivals count from here
        self.probed = threading.Event()
        self.failure = ''
        self.deleted = 0  # records that were gone before they were read
        self._topic = topic
        self._ending = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='receiver', daemon=True)
        self._next: dict[int, int] = {}  # offsets, by partition
        own = {
            'group.id': f'{topic}.demo',
            'enable.auto.commit': False,
            'auto.offset.reset': 'earliest',
        }
        self._properties = {**properties, **own}

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def finish(self) -> None:
        """Read up to what is the end of the topic now, then end."""
        self._ending.set()

    @property
    def reads(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def _run(self) -> None:
        with closing(Consumer(self._properties, logger=client_log(__name__))) as consumer:
            try:
                partitions = self._assign(consumer)
                while not self._ending.is_set() and not self._closing.is_set():
                    self._read(consumer)
                ends = {p: _end(consumer, self._topic, p) for p in partitions}
                while not self._closing.is_set() and not _reached(consumer, self._topic, ends):
                    self._read(consumer)
            except KafkaException as error:
                self.failure = f'reading {self._topic}: {error.args[0].str()}'

    def _assign(self, consumer: Consumer) -> list[int]:
        partitions = self._partitions(consumer)
        consumer.assign([TopicPartition(self._topic, p, OFFSET_BEGINNING) for p in partitions])
        return partitions

    def _partitions(self, consumer: Consumer) -> list[int]:
        """Ask until they are there: each broker of a cluster hears of a new topic in its time."""
        deadline_s = time.monotonic() + PARTITIONS_S
        while not self._closing.is_set():
            found = consumer.list_topics(self._topic, timeout=_REQUEST_S).topics[self._topic]
            if found.partitions:
                return list(found.partitions)
            if time.monotonic() > deadline_s:
                raise KafkaException(found.error or KafkaError(KafkaError.LEADER_NOT_AVAILABLE))
            self._closing.wait(_WAIT_S)
        return []

    def _read(self, consumer: Consumer) -> None:
        first = consumer.poll(_WAIT_S)
        if first is None:
            return
        records = (first, *consumer.consume(_BATCH, 0))
        now_ns, now_s = time.time_ns(), time.monotonic() - self.started_s
        for record in records:
            value = record.value()
            if record.error() is None and value is not None:
                self._count_gap(record.partition() or 0, record.offset() or 0)
                self._note(decode(value), now_ns, now_s)

    def _count_gap(self, partition: int, offset: int) -> None:
        # There are no gaps of another kind: a demonstration's topic holds no transactions.
        self.deleted += max(0, offset - self._next.get(partition, 0))
        self._next[partition] = offset + 1

    def _note(self, order: Order, now_ns: int, now_s: float) -> None:
        if order.order_id == PROBE:
            self.probed.set()
        else:
            latency_s = (now_ns - order.created_ns) / 1e9
            self.arrivals.append(Arrival(order.order_id, now_s, latency_s))


def _end(consumer: Consumer, topic: str, partition: int) -> int:
    answer = consumer.get_watermark_offsets(TopicPartition(topic, partition), timeout=_REQUEST_S)
    return answer[1] if answer else 0


def _reached(consumer: Consumer, topic: str, ends: Mapping[int, int]) -> bool:
    here = consumer.position([TopicPartition(topic, partition) for partition in ends])
    return all(max(0, place.offset) >= ends[place.partition] for place in here)
