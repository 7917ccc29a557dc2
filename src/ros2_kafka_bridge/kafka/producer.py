"""Producing to Kafka: idempotent, with a report for every record."""

import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Generic

from confluent_kafka import KafkaError, KafkaException, Message, Producer

from ros2_kafka_bridge.endpoints import Outgoing, Reports, Token
from ros2_kafka_bridge.errors import BridgeError, RecordTooLargeError
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.health import ClientHealth, check_files
from ros2_kafka_bridge.kafka.properties import LINGER_MS

_LARGEST_BYTES = 1_000_000  # librdkafka's default
_HURRY_S = 0.001  # nothing is hurried by a flush that is over before the client's thread wakes


class KafkaSink(Generic[Token]):
    """A `RecordSink` on a real broker.

    Args:
        properties: librdkafka properties of a producer.
        where: What to call it in errors (`topic orders`).
        log: Where to say what happens.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        where: str,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self._properties = dict(properties)
        self._where = where
        self._about = Client('WRITE', properties)
        self._health = ClientHealth(where, log, self._about)
        self._may_hurry = self._properties.get('linger.ms') == LINGER_MS
        self._producer: Producer | None = None
        self._confirmed: list[Token] = []
        self._failed: list[tuple[Token, BridgeError]] = []

    @property
    def away(self) -> str:
        """Why nothing can be produced just now; empty when all is well."""
        return self._health.away

    def open(self) -> None:
        """Make the client; it connects in the background.

        Raises:
            RouteError: librdkafka refuses the properties.
        """
        self._health.on_open()
        check_files(self._properties, self._where)
        with self._translated():
            self._producer = Producer(
                self._properties | {'error_cb': self._health.on_error},
                logger=logging.getLogger(f'{__name__}.librdkafka'),
            )

    def produce(self, record: Outgoing, token: Token) -> bool:
        """Hand over a record; False: the queue is full, nothing was taken."""
        try:
            self._client.produce(
                record.topic,
                record.value,
                record.key,
                headers=record.headers,
                on_delivery=partial(self._report, token),
            )
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
        with self._translated():  # a fatal error of the client is raised from here
            self._client.poll(timeout_s)
        if self._confirmed:
            self._health.on_contact()
        reports = Reports(self._confirmed, self._failed)
        self._confirmed, self._failed = [], []
        if not reports.confirmed and not reports.failed:
            self._health.raise_failure()
        return reports

    def hurry(self) -> None:
        """Send at once what lingers, unless the user has said how long it may."""
        if self._may_hurry:
            with self._translated():
                self._client.flush(_HURRY_S)

    def close(self) -> Iterable[Token]:
        """Give up what is not delivered; return the tokens that were delivered meanwhile."""
        if self._producer is None:
            return ()
        self._producer.purge()
        with suppress(KafkaException):  # fatal, and known
            self._producer.flush(1.0)
        self._producer = None
        delivered, self._confirmed, self._failed = self._confirmed, [], []
        return delivered

    @property
    def _client(self) -> Producer:
        assert self._producer is not None, 'the sink is open'
        return self._producer

    @contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except KafkaException as error:
            raise translate(error.args[0], self._where, self._about) from error

    def _report(self, token: Token, error: KafkaError | None, message: Message) -> None:
        if error is None:
            self._confirmed.append(token)
        elif error.code() == KafkaError.MSG_SIZE_TOO_LARGE:
            self._failed.append(
                (
                    token,
                    RecordTooLargeError(len(message), None, 'max.message.bytes of the topic'),
                )
            )
        else:
            self._failed.append((token, translate(error, self._where, self._about)))

    def _refusal(self, error: KafkaError, record: Outgoing) -> BridgeError:
        if error.code() == KafkaError.MSG_SIZE_TOO_LARGE:
            limit_bytes = int(self._properties.get('message.max.bytes', _LARGEST_BYTES))
            where = 'message.max.bytes of the producer'
            return RecordTooLargeError(len(record.value or b''), limit_bytes, where)
        if error.code() == KafkaError._FATAL:  # noqa: SLF001 (its public name)
            with self._translated():  # what it was for is still to be called back
                self._client.poll(0.0)
        return translate(error, self._where, self._about)
