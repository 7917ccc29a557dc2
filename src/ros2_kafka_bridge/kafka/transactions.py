"""Writing several records to Kafka at once: all of them, or none."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Final, NamedTuple, Self

from confluent_kafka import KafkaError, KafkaException, Message, Producer

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import BridgeError, RecordError, RouteError, TransportError
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.properties import canonical
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.logs.lines import client_log
from ros2_kafka_bridge.threads.stop import Stop

TRANSACTION_S: Final = 20.0
"""How long a transaction may stay open: so long a killed one holds up readers of its topics."""

_STEP_S: Final = 0.5
_REPEAT_MS: Final = 1000
_LATE_S: Final = 0.7  # of the time until a repeat librdkafka takes off a fifth at most
_OPEN_S: Final = 15.0
_COMMIT_S: Final = 15.0
_LAST_ANSWERS_S: Final = 5.0
_POLL_S: Final = 0.1
_LARGEST_BYTES: Final = 1_000_000_000
_ANY_PARTITION: Final = -1
_FENCED: Final = {
    KafkaError._FENCED,  # noqa: SLF001 (its public name)
    KafkaError.PRODUCER_FENCED,
    KafkaError.INVALID_PRODUCER_EPOCH,
}
_FAILED_BEFORE: Final = {
    KafkaError._STATE,  # noqa: SLF001
    KafkaError._FATAL,  # noqa: SLF001
}
_NO_CAUSE: Final = {
    *_FAILED_BEFORE,
    KafkaError._PURGE_QUEUE,  # noqa: SLF001
    KafkaError._PURGE_INFLIGHT,  # noqa: SLF001
    KafkaError._INCONSISTENT,  # noqa: SLF001
    KafkaError.OUT_OF_ORDER_SEQUENCE_NUMBER,
}


class Send(NamedTuple):
    """A record and its partition; None leaves that to the key."""

    record: Outgoing
    partition: int | None


class Parcel(NamedTuple):
    """Records that belong together: all are written, or none.

    Args:
        number: Tells the parcels apart.
    """

    number: int
    sends: Sequence[Send]


class RefusedParcel(NamedTuple):
    """A parcel that Kafka will never take, and why."""

    parcel: Parcel
    error: RecordError


class Written(NamedTuple):
    """What became of parcels; all that is not here was written.

    Args:
        refused: Those that Kafka will never take.
        left: Those for which others have to be opened first: see `Transactions.spent`.
    """

    refused: list[RefusedParcel]
    left: list[Parcel]


class Transactions:
    """Writes parcels in transactions; whoever opens one of the same id shuts out the one before.

    Args:
        properties: librdkafka properties of a producer.
        transactional_id: Who may write, one at a time.
        stop: Ends the waiting at its second step.

    Attributes:
        spent: These write no more: open others, and look anew what is written, since somebody else
            may have had a turn. So it is where only another client can end what is open, and where
            an end was answered so late that librdkafka may have asked for it twice. What is still
            on its way then would end the next transaction of this client in its middle: to brokers
            they are one and the same, since librdkafka (2.16) gives all of a client one epoch.
    """

    def __init__(self, properties: Mapping[str, Any], transactional_id: str, stop: Stop) -> None:
        own: dict[str, Any] = {
            'transactional.id': transactional_id,
            'transaction.timeout.ms': int(TRANSACTION_S * 1000),
            'message.timeout.ms': int(TRANSACTION_S * 1000),
            'enable.idempotence': True,
            'acks': 'all',
            # So that what was answered sooner was asked for once.
            'retry.backoff.ms': _REPEAT_MS,
            'retry.backoff.max.ms': _REPEAT_MS,
            # Each on its own, and judged by the broker alone: none is refused for the others.
            'batch.num.messages': 1,
            'message.max.bytes': _LARGEST_BYTES,
        }
        users = {name: value for name, value in properties.items() if canonical(name) not in own}
        self._properties = users | own
        self._id = transactional_id
        self._stop = stop
        self._about = Client('WRITE', properties)
        self._producer: Producer | None = None
        self._failed: dict[int, KafkaError] = {}
        self.spent = False
        self._gap = False  # in the numbers of the client's records, as the broker sees them

    def __enter__(self) -> Self:
        """Shut out whoever wrote before, and wait until what it began has ended.

        Raises:
            TransportError: The broker does not answer in time.
            RouteError: This user may not write transactions.
        """
        check_files(self._properties, 'the Kafka client')
        try:
            self._producer = Producer(self._properties, logger=client_log(__name__))
            self._repeat(self._client.init_transactions, _OPEN_S)
        except KafkaException as error:
            raise self._translated(error.args[0]) from error
        return self

    def __exit__(self, *_: object) -> None:
        # What is open is left to the next one, or to the broker's time-out: never committed here.
        self._let_go()

    def _let_go(self) -> None:
        """End a client, once the answers that are on their way to it have come.

        librdkafka (2.16) frees the text of a fatal error as it ends, and again where an answer
        says only then that another has taken over (`rd_kafka_txn_set_fatal_error`): the process
        is aborted.
        """
        producer, self._producer = self._producer, None
        if producer is None:
            return
        began_s = time.monotonic()
        try:
            producer.purge(in_flight=False)
            while len(producer) and time.monotonic() - began_s < self._last_answers_s:
                # Not `flush`, which fails where a callback runs after that of a fatal error.
                with suppress(KafkaException):  # known, or told by what is reported
                    producer.poll(_POLL_S)
        finally:
            # confluent-kafka means it the other way round: this one waits for the broker threads.
            producer.purge(blocking=False)

    @property
    def _last_answers_s(self) -> float:
        return _STEP_S if self._stop.at_once else _LAST_ANSWERS_S

    def write(self, parcels: Sequence[Parcel]) -> Written:
        """Write parcels in one transaction, without those that Kafka refuses.

        Raises:
            TransportError: The broker is away; whether they are written is known to Kafka alone.
            RouteError: This user may not write, or another has taken over. Nothing is written.
        """
        refused: list[RefusedParcel] = []
        left = list(parcels)
        while left and not self.spent:
            bad = self._attempt(left)
            if bad is None:
                left = []
                break
            refused += bad
            numbers = {one.parcel.number for one in bad}
            left = [parcel for parcel in left if parcel.number not in numbers]
        return Written(refused, left)

    @property
    def _client(self) -> Producer:
        assert self._producer is not None, 'the transactions are open'
        return self._producer

    def _attempt(self, parcels: Sequence[Parcel]) -> list[RefusedParcel] | None:
        """Write them all; None: they are written. Otherwise which to leave out of the next try."""
        self._failed = {}
        try:
            self._client.begin_transaction()
            for parcel in parcels:
                self._produce(parcel)
            self._wait_for_answers()
            self._end(self._client.commit_transaction)
        except KafkaException as error:
            return self._after(self._reason(error.args[0]), parcels)
        return None

    def _wait_for_answers(self) -> None:
        """Wait for records, while their answers come: what takes long is then the commit."""
        waiting = before = len(self._client)
        while waiting and not self._stop.at_once:
            self._client.poll(_STEP_S)
            waiting = len(self._client)
            if waiting >= before:
                return
            before = waiting

    def _end(self, call: Callable[[float], Any]) -> None:
        began_s = time.monotonic()
        try:
            self._repeat(call, _COMMIT_S)
        finally:
            self.spent = self.spent or time.monotonic() - began_s > _LATE_S

    def _produce(self, parcel: Parcel) -> None:
        for record, number in parcel.sends:
            deadline_s = time.monotonic() + _COMMIT_S
            while True:
                try:
                    self._client.produce(
                        record.topic,
                        record.value,
                        record.key,
                        partition=_ANY_PARTITION if number is None else number,
                        headers=record.headers,
                        on_delivery=partial(self._report, parcel.number),
                    )
                    break
                except BufferError:
                    self._client.poll(0.1)
                    if time.monotonic() > deadline_s:
                        raise TransportError('Kafka takes no more records') from None
                except KafkaException as error:
                    self._note(parcel.number, error.args[0])
                    raise
            self._client.poll(0)

    def _report(self, number: int, error: KafkaError | None, _: Message) -> None:
        if error is not None:
            self._note(number, error)

    def _note(self, number: int, error: KafkaError) -> None:
        """Keep why a parcel has failed, rather than what that did to the rest of it."""
        known = self._failed.get(number)
        if known is None or known.code() in _NO_CAUSE:
            self._failed[number] = error

    def _reason(self, error: KafkaError) -> KafkaError:
        """Why a transaction has failed that takes no more records: the commit tells."""
        if error.code() not in _FAILED_BEFORE:
            return error
        try:
            self._client.commit_transaction(_STEP_S)  # refused at once
        except KafkaException as reason:
            found: KafkaError = reason.args[0]
            return found
        return error

    def _after(self, error: KafkaError, parcels: Sequence[Parcel]) -> list[RefusedParcel]:
        """End a transaction that has failed; tells which parcels to leave out of the next try."""
        self._check_shut_out(error)
        if error.fatal() or not self._abort():
            self._let_go()
            for failed in self._failed.values():  # an answer that has come only now
                self._check_shut_out(failed)
            self.spent = True  # the next client of this name ends what is open
        errors = {number: self._translated(failed) for number, failed in self._failed.items()}
        bad = [
            RefusedParcel(parcel, cause)
            for parcel in parcels
            if isinstance(cause := errors.get(parcel.number), RecordError)
        ]
        if bad:
            self._gap = True
            return bad
        told = [failed for failed in self._failed.values() if failed.code() not in _NO_CAUSE]
        if self._gap and not told and error.code() == KafkaError.OUT_OF_ORDER_SEQUENCE_NUMBER:
            # The client has counted the record that was refused, the broker has not; with the end
            # of this transaction both begin anew.
            self._gap = False
            return []
        raise self._translated(told[0] if told else error)

    def _abort(self) -> bool:
        """Abort; False where Kafka never began the transaction, or refused a part of it."""
        try:
            self._end(self._client.abort_transaction)
        except KafkaException as error:
            self._check_shut_out(error.args[0])
            return False
        return True

    def _check_shut_out(self, error: KafkaError) -> None:
        if error.code() in _FENCED:
            raise self._translated(error)

    def _repeat(self, call: Callable[[float], Any], patience_s: float) -> None:
        """Call again while it only takes time: librdkafka goes on where it was."""
        deadline_s = time.monotonic() + patience_s
        while True:
            try:
                call(_STEP_S)
            except KafkaException as error:
                if not error.args[0].retriable():
                    raise
                if time.monotonic() > deadline_s or self._stop.at_once:
                    text = 'Kafka does not answer, or another has taken over'
                    text = 'stopped' if self._stop.at_once else text
                    raise TransportError(f'{text} ({error.args[0].str()})') from error
            else:
                return

    def _translated(self, error: KafkaError) -> BridgeError:
        if error.code() in _FENCED:
            return RouteError(
                f'another has taken over as {self._id}, or Kafka was away for longer than '
                f'{TRANSACTION_S:g} s'
            )
        if error.code() == KafkaError.TRANSACTIONAL_ID_AUTHORIZATION_FAILED:
            return RouteError(
                f'{error.str()}; give this user WRITE and DESCRIBE on the transactional id '
                f'{self._id} (ACL)'
            )
        return translate(error, 'Kafka refuses', self._about)
