"""Producing to Kafka: idempotent, with a report for every record."""

import logging
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Generic

from confluent_kafka import KafkaError, KafkaException, Message, Producer

from ros2_kafka_bridge.endpoints import Load, Outgoing, Reports, Token
from ros2_kafka_bridge.errors import (
    BridgeError,
    RecordTooLargeError,
    RouteError,
    TransportError,
)
from ros2_kafka_bridge.kafka.client_health import BLIP_S, BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.errors import Client, translate, translated
from ros2_kafka_bridge.kafka.properties import LINGER_MS
from ros2_kafka_bridge.kafka.statistics import read, with_statistics
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topics import topic_limit_bytes
from ros2_kafka_bridge.logs.lines import Log

_LARGEST_BYTES = 1_000_000  # librdkafka's default, of a batch and of a message
_QUEUE = 'queue.buffering.max.messages'
_LARGEST_QUEUE = 100_000  # librdkafka's default
_PASSED_OVER = 'Kafka may have taken a later record as the first of a partition: written again'
_IDLE_BLIP_S = 9.0  # beyond two reports of the client, where nothing else tells
_HURRY_S = 0.001  # nothing is hurried by a flush that is over before the client's thread wakes


class KafkaSink(Generic[Token]):
    """A `RecordSink` on a real broker.

    Args:
        properties: librdkafka properties of a producer.
        topic: Where the records go.
        log: Where to say what happens.
        fits_topic: Whether to make no batch larger than the topic allows: a broker refuses all
            of it.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        log: Log,
        *,
        fits_topic: bool = False,
    ) -> None:
        self._properties = with_statistics(properties)
        self._topic = topic
        self._fits_topic = fits_topic
        self._limit_bytes: int | None = None  # of the topic, once it is known
        self._where = where = f'topic {topic}'
        self._about = Client('WRITE', properties)
        self._health = ClientHealth(where, log, self._about)
        self._may_hurry = self._properties.get('linger.ms') == LINGER_MS
        self._producer: Producer | None = None
        self._is_idempotent = str(self._properties.get('enable.idempotence')).lower() == 'true'
        self._answering: set[int | None] = set()  # partitions that have told an offset
        self._confirmed: list[Token] = []
        self._failed: list[tuple[Token, BridgeError]] = []
        self.round_trip_s: tuple[float, float] | None = None  # to the broker, in the last seconds

    @property
    def away(self) -> str:
        """Why nothing can be produced just now; empty when all is well."""
        # A connection that is made anew is told of late where nothing is sent.
        is_seen = self.load.queued or self._health.away_for_s > _IDLE_BLIP_S
        return self._health.away if is_seen else ''

    @property
    def reached(self) -> bool:
        """Whether Kafka has ever answered."""
        return self._health.reached

    @property
    def answers(self) -> bool | None:
        """Whether it does now; None: not heard yet."""
        return False if self.away else self._health.is_heard or None

    @property
    def load(self) -> Load:
        """What is on its way, of what may be."""
        queued = 0 if self._producer is None else len(self._producer)
        return Load(queued, int(self._properties.get(_QUEUE, _LARGEST_QUEUE)))

    def open(self) -> None:
        """Make the client; it connects in the background.

        Raises:
            RouteError: librdkafka refuses the properties.
        """
        self._health.on_open()
        self._answering.clear()
        check_files(self._properties, self._where)
        own: dict[str, Any] = {
            'error_cb': self._health.on_error,
            'stats_cb': self._on_statistics,
        }
        if self._fits_topic:
            own['batch.size'] = self._batch_bytes()
        with translated(self._where, self._about):
            self._producer = Producer(
                self._properties | own,
                logger=logging.getLogger(f'{__name__}.librdkafka'),
            )

    def produce(self, record: Outgoing, token: Token) -> bool:
        """Hand over a record; False: nothing was taken, the queue is full.

        Until a first record is confirmed, one is a full queue: of several on the way to a
        partition that is just beginning, Kafka may refuse the first and take the second, as it
        knows nothing of this producer yet. librdkafka then reports both as delivered.
        """
        producer, (topic, key, value, headers) = self._client, record
        if not self._answering and self._is_idempotent and len(producer):
            return False
        try:
            on_delivery = partial(self._report, token)
            producer.produce(topic, value, key, headers=headers, on_delivery=on_delivery)
        except BufferError:
            return False
        except KafkaException as error:
            raise self._refusal(error.args[0], record) from error
        return True

    def poll(self, timeout_s: float) -> Reports[Token]:
        """Wait up to `timeout_s` for delivery reports and return them.

        Raises:
            RouteError: The client cannot go on; what it has reported is kept for `close`.
        """
        with translated(self._where, self._about):  # what is fatal for the client
            self._client.poll(timeout_s)
        if self._confirmed:
            self._health.on_contact()
        reports = Reports(self._confirmed, self._failed)
        self._confirmed, self._failed = [], []
        if not reports.confirmed and not reports.failed:
            self._health.raise_failure(BLIP_S if self.load.queued else _IDLE_BLIP_S)
            if self._health.has_lost_brokers:
                raise RouteError(f'{self._where}: {BROKERS_LOST}')
        return reports

    def hurry(self) -> None:
        """Send at once what lingers, unless the user has said how long it may."""
        if self._may_hurry:
            with translated(self._where, self._about):
                self._client.flush(_HURRY_S)

    def close(self) -> Iterable[Token]:
        """Give up what is not delivered; return the tokens that were delivered meanwhile."""
        if self._producer is None:
            return ()
        with suppress(KafkaException):  # fatal, and known
            self._producer.purge()
        with suppress(KafkaException):
            self._producer.flush(1.0)
        self._producer = None
        delivered, self._confirmed, self._failed = self._confirmed, [], []
        return delivered

    def _batch_bytes(self) -> int:
        if self._limit_bytes is None:
            self._limit_bytes = topic_limit_bytes(self._about.properties, self._topic)
        wanted_bytes = int(self._properties.get('batch.size', _LARGEST_BYTES))
        return min(self._limit_bytes or _LARGEST_BYTES, wanted_bytes)

    @property
    def _client(self) -> Producer:
        assert self._producer is not None, 'the sink is open'
        return self._producer

    def _on_statistics(self, text: str) -> None:
        statistics = read(text)
        self.round_trip_s = statistics.round_trip_s
        self._health.on_statistics(statistics)
        if statistics.is_connected and not self.load.queued:
            self._health.on_contact()  # where nothing is sent, nothing else tells that it is back

    def _report(self, token: Token, error: KafkaError | None, message: Message) -> None:
        if error is None and (message.partition() in self._answering or self._is_there(message)):
            self._confirmed.append(token)
        elif error is None:
            self._failed.append((token, TransportError(f'{self._where}: {_PASSED_OVER}')))
        elif error.code() == KafkaError.MSG_SIZE_TOO_LARGE:
            self._failed.append(
                (
                    token,
                    RecordTooLargeError(len(message), None, 'max.message.bytes of the topic'),
                )
            )
        else:
            self._failed.append((token, translate(error, self._where, self._about)))

    def _is_there(self, message: Message) -> bool:
        """Whether a record that was reported as delivered is in its partition.

        librdkafka reports a record that was refused without an offset, as soon as a later one is
        taken: it must have been written before, and the answer lost. That is so unless the
        partition knew nothing of this producer: then Kafka takes any record as its first.
        """
        partition = message.partition()
        if message.offset() is not None:
            self._answering.add(partition)
        return partition in self._answering or not self._is_idempotent

    def _refusal(self, error: KafkaError, record: Outgoing) -> BridgeError:
        if error.code() == KafkaError.MSG_SIZE_TOO_LARGE:
            limit_bytes = int(self._properties.get('message.max.bytes', _LARGEST_BYTES))
            where = 'message.max.bytes of the producer'
            return RecordTooLargeError(len(record.value or b''), limit_bytes, where)
        if error.code() == KafkaError._FATAL:  # noqa: SLF001 (its public name)
            with translated(self._where, self._about):  # the cause is still to be called back
                self._client.poll(0.0)
        return translate(error, self._where, self._about)
