"""The records of one Kafka topic, read as a member of a group."""

import contextlib
import logging
import threading
import time
import uuid
from collections.abc import Mapping, Sequence
from typing import Any, cast

from confluent_kafka import (
    OFFSET_INVALID,
    Consumer,
    KafkaError,
    KafkaException,
    Message,
    TopicPartition,
)

from ros2_kafka_bridge.endpoints import Rebalance, Record
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.kafka.beginnings import Beginnings
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.health import ClientHealth, check_files

_REQUEST_S = 10.0
_LEAVE_S = 2.0
_AGAIN_S = 0.5
_LOOK_EVERY_S = 2.0
_LOOK_S = 0.2
_REJOIN_MS = 30_000
_OUTSIDE_S = 45.0
_CLOSE_S = 5.0
_STUCK_LOOK_S = 10.0


class KafkaSource:
    """A `RecordSource` on a real topic.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: The topic to read.
        start: `latest` or `earliest`: where a topic begins that the group never read.
        log: Where to say what happens.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        start: str,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        # A member that knows its name gets its place back at once when the broker was away longer
        # than the session; another would wait until the broker gives up the old one.
        # The group waits for so long for a member that does not join again.
        rejoin_ms = max(_REJOIN_MS, int(properties.get('session.timeout.ms', 0)))
        own = {
            'group.instance.id': uuid.uuid4().hex,
            'enable.partition.eof': True,
            'max.poll.interval.ms': rejoin_ms,
        }
        self._properties = own | dict(properties)
        self._topic = topic
        self._beginnings = Beginnings(topic, start, log)
        self._log = log
        self._about = Client('READ', self._properties)
        self._health = ClientHealth(f'topic {topic}', log, self._about)
        self._consumer: Consumer | None = None
        self._rebalance: Rebalance
        self._committed: dict[int, int] = {}
        self._positions: dict[int, int] = {}  # as they were to be committed last
        self._left: dict[int, tuple[int, int]] = {}  # of lost partitions: committed and position
        self._gone: set[int] = set()  # partitions handed over while records were read
        self._look_at_s = 0.0
        self._held = False
        self._fresh = False  # some partitions came while the others were held
        self._closing = False
        self._outside_since_s: float | None = None  # without a place in the group that it had
        self._behind: dict[
            int, int
        ] = {}  # partitions that hold more than was read, at the last look
        self._stuck_look_at_s = 0.0
        self.ends: dict[int, int] = {}

    @property
    def lost_upstream(self) -> int:
        """Records that the topic no longer held when the bridge came to read them."""
        return self._beginnings.lost

    @property
    def away(self) -> str:
        """Why nothing can be read just now; empty when all is well."""
        return self._health.away

    def open(self, rebalance: Rebalance) -> None:
        """Join the group.

        Raises:
            RouteError: librdkafka refuses the properties.
        """

        def on_assign(_: Consumer, partitions: list[TopicPartition]) -> None:
            self._fresh = True
            self._outside_since_s = None
            self._gone -= _numbers(partitions)
            self._log.info('reads %s', _names(self._topic, partitions))
            self._go_on(partitions)

        def on_revoke(_: Consumer, partitions: list[TopicPartition]) -> None:
            if self._closing:
                return
            self._log.info('hands over %s', _names(self._topic, partitions))
            rebalance.revoked(_numbers(partitions))
            self._forget(partitions)

        def on_lost(_: Consumer, partitions: list[TopicPartition]) -> None:
            self._log.warning(
                'lost %s: Kafka has not heard of this bridge, another may read on',
                _names(self._topic, partitions),
            )
            self._outside_since_s = time.monotonic()
            rebalance.lost(_numbers(partitions))
            for number in _numbers(partitions) & self._positions.keys():
                self._left[number] = self._committed.get(number, 0), self._positions[number]
            self._forget(partitions)

        self._rebalance = rebalance
        self._outside_since_s = None
        self._behind = {}
        self._stuck_look_at_s = time.monotonic() + _STUCK_LOOK_S
        self._closing = self._held = False
        self._health.on_open()
        check_files(self._properties, f'topic {self._topic}')
        callbacks = {'error_cb': self._health.on_error, 'on_commit': self._on_commit}
        try:
            self._consumer = Consumer(
                self._properties | callbacks, logger=logging.getLogger(f'{__name__}.librdkafka')
            )
            self._consumer.subscribe(
                [self._topic], on_assign=on_assign, on_revoke=on_revoke, on_lost=on_lost
            )
        except KafkaException as error:
            raise self._translated(error) from error

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Wait up to `timeout_s` for the first record, then return what is there."""
        if self._held:
            self._client.resume(self._client.assignment())
            self._held = False
        return self._read(limit, timeout_s)

    def hold(self) -> Sequence[Record]:
        """Stay a member of the group without reading on."""
        if not self._held or self._fresh:
            self._client.pause(self._client.assignment())
            self._held, self._fresh = True, False
        return self._read(1, 0.0)

    def commit(self, positions: Mapping[int, int]) -> None:
        """Commit the next offset to read of each partition, without waiting for it."""
        self._positions.update(positions)
        news = self._news(positions)
        if not news:
            return
        try:
            self._client.commit(offsets=news, asynchronous=True)
        except KafkaException as error:
            self._log.warning('cannot commit now: %s', error.args[0].str())

    def commit_now(self, positions: Mapping[int, int], timeout_s: float) -> bool:
        """Commit and wait; False when it was not confirmed in time."""
        # librdkafka's own synchronous commit waits for a broker without any limit.
        deadline_s = time.monotonic() + timeout_s
        again_s = 0.0
        self._client.pause(self._client.assignment())
        while self._news(positions) and (now_s := time.monotonic()) < deadline_s:
            if now_s >= again_s:
                self.commit(positions)
                again_s = now_s + _AGAIN_S
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                self._client.poll(0.05)
        return not self._news(positions)

    def commit_before_revoke(self, positions: Mapping[int, int]) -> None:
        """Commit from inside a rebalance, where polling for the answer is not possible."""
        news = self._news(positions)
        if not news:
            return
        try:
            if self.away:  # librdkafka would wait for the broker without limit
                self._client.commit(offsets=news, asynchronous=True)
            else:
                self._client.commit(offsets=news, asynchronous=False)
        except KafkaException as error:
            self._log.warning('cannot commit before the hand-over: %s', error.args[0].str())

    def lag(self, positions: Mapping[int, int]) -> int:
        """How many records of the assigned partitions come behind `positions`."""
        total = 0
        for partition in self._client.assignment():
            _, end = self._client.get_watermark_offsets(partition, cached=True)
            position = positions.get(partition.partition)
            if end >= 0 and position is not None:
                total += max(0, end - position)
        return total

    def close(self) -> None:
        """Leave the group; what is to be committed has been."""
        if self._consumer is not None:
            self._closing = True
            # A member with a name stays in the group when it closes, but not when it unsubscribes.
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                self._consumer.unsubscribe()
            deadline_s = time.monotonic() + _LEAVE_S
            while self._consumer.assignment() and time.monotonic() < deadline_s:
                with contextlib.suppress(KafkaException):
                    self._consumer.poll(0.01)
            self._close_client(self._consumer)
            self._consumer = None
            for known in (
                self._committed, self._positions, self._left, self.ends, self._beginnings.wanted,
            ):  # fmt: skip
                known.clear()

    def _close_client(self, consumer: Consumer) -> None:
        """Close a client, or leave it behind: one that is not in its group may wait for ever."""
        closing = threading.Thread(target=consumer.close, daemon=True)
        closing.start()
        closing.join(_CLOSE_S)
        if closing.is_alive():
            self._log.warning('the Kafka client of %s does not end: left behind', self._topic)

    @property
    def _client(self) -> Consumer:
        assert self._consumer is not None, 'the source is open'
        return self._consumer

    def _translated(self, error: KafkaException) -> BridgeError:
        return translate(error.args[0], f'topic {self._topic}', self._about)

    def _read(self, limit: int, timeout_s: float) -> Sequence[Record]:
        # consume() waits its whole timeout unless all `limit` records come; poll() does not.
        try:
            first = self._client.poll(timeout_s)
        except KafkaException as error:  # fatal for the client
            raise self._translated(error) from error
        self._health.raise_failure()
        if self.away and first is None:
            self._look_for_broker()
        if first is None:
            self._look_whether_outside()
            self._look_whether_stuck()
            return ()
        self._gone.clear()
        batch = [first, *self._client.consume(limit - 1, 0.0)] if limit > 1 else [first]
        if first.partition() in self._gone:
            del batch[0]
        if self._beginnings.wanted or any(message.error() for message in batch):
            batch = [message for message in batch if self._is_record(message)]
        else:
            self._health.on_contact()
        # The stubs do not tell that headers are a list; they are.
        return cast('Sequence[Record]', batch)

    def _look_whether_outside(self) -> None:
        """Give up a client that does not find back into its group.

        Seen with brokers that stood still for a little longer than the session: librdkafka says
        that the partitions are lost, and then waits for ever.
        """
        if self._outside_since_s is None:
            return
        now_s = time.monotonic()
        if self.away:
            self._outside_since_s = now_s
        elif now_s - self._outside_since_s > _OUTSIDE_S:
            raise RouteError(
                f'topic {self._topic}: lost its partitions {_OUTSIDE_S:.0f} s ago and does not '
                'get back into its group: begins anew'
            )

    def _look_whether_stuck(self) -> None:
        """Give up a client that does not read what its partitions hold.

        Seen with topics whose leader was not known yet when their reading began: librdkafka says
        nothing, and never asks for the records.
        """
        now_s = time.monotonic()
        if now_s < self._stuck_look_at_s or self._held or self.away:
            return
        self._stuck_look_at_s = now_s + _STUCK_LOOK_S
        behind = {p: at for p, at in self._reached().items() if self._holds_more(p, at)}
        if any(self._behind.get(partition) == at for partition, at in behind.items()):
            raise RouteError(
                f'topic {self._topic}: holds records that the Kafka client does not read: '
                'begins anew'
            )
        self._behind = behind

    def _reached(self) -> dict[int, int]:
        """How far each partition was read, of those where that is known."""
        places = self._client.position(self._client.assignment())
        known = {**self._committed, **self._positions}
        reached = {p.partition: max(p.offset, known.get(p.partition, -1)) for p in places}
        return {p: max(at, self.ends.get(p, -1)) for p, at in reached.items() if at >= 0}

    def _holds_more(self, partition: int, at: int) -> bool:
        here = TopicPartition(self._topic, partition)
        try:
            _, end = self._client.get_watermark_offsets(here, timeout=_LOOK_S)
        except KafkaException:  # the broker does not answer: that is another matter
            return False
        return bool(end > at)

    def _look_for_broker(self) -> None:
        """Ask whether the broker is back: a quiet topic would not tell."""
        now_s = time.monotonic()
        if now_s >= self._look_at_s:
            self._look_at_s = now_s + _LOOK_EVERY_S
            with contextlib.suppress(KafkaException):
                self._client.list_topics(self._topic, timeout=_LOOK_S)
                self._health.on_contact()

    def _is_record(self, message: Message) -> bool:
        error = message.error()
        if error is None:
            self._note_reached(message)
            return True
        if error.code() == KafkaError._AUTO_OFFSET_RESET:  # noqa: SLF001 (its public name)
            self._place(message.partition() or 0, message.offset())
            return False
        if error.code() == KafkaError._MAX_POLL_EXCEEDED:  # noqa: SLF001
            return False
        if error.code() == KafkaError._PARTITION_EOF:  # noqa: SLF001
            self._health.on_contact()
            self._note_reached(message)
            if message.partition() not in self._gone:
                self.ends[message.partition() or 0] = message.offset() or 0
            return False
        if error.code() == KafkaError.UNKNOWN_TOPIC_OR_PART:
            self._beginnings.expect_new_topic()
        self._health.on_error(error)
        self._health.raise_failure()
        return False

    def _note_reached(self, message: Message) -> None:
        partition = message.partition() or 0
        if partition in self._beginnings.wanted:
            self._beginnings.reached(self._client, partition, message.offset() or 0)

    def _place(self, partition: int, wanted: int | None) -> None:
        """Set where to read a partition whose stored offset is missing or out of range."""
        known = {**self._committed, **self._positions}.get(partition)
        try:
            self.ends.pop(partition, None)
            beginning = self._beginnings.find(self._client, partition, wanted, known)
            if beginning.anew:
                self._forget([TopicPartition(self._topic, partition)])
                self._rebalance.lost(frozenset({partition}))
                news = self._places({partition: beginning.offset})
                self._client.commit(offsets=news, asynchronous=True)
            self._client.incremental_unassign(self._places({partition: OFFSET_INVALID}))
            self._client.incremental_assign(self._places({partition: beginning.offset}))
        except KafkaException as error:
            raise translate(error.args[0], f'{self._topic}[{partition}]', self._about) from error
        self._fresh = True

    def _go_on(self, partitions: list[TopicPartition]) -> None:
        """Begin at once more assigned partitions where they were left, if nobody read on there."""
        numbers = _numbers(partitions) & self._left.keys()
        left = {number: self._left.pop(number) for number in numbers}
        if not left:
            return
        here = self._places(dict.fromkeys(left, OFFSET_INVALID))
        try:
            resumed = {
                p.partition: position
                for p in self._client.committed(here, timeout=_REQUEST_S)
                for known, position in [left[p.partition]]
                if known <= p.offset < position
            }
            if resumed:
                stored = dict.fromkeys(_numbers(partitions), OFFSET_INVALID)
                self._client.incremental_assign(self._places(stored | resumed))
                self._client.commit(offsets=self._places(resumed), asynchronous=True)
        except KafkaException as error:
            self._log.warning('begins at the committed offsets: %s', error.args[0].str())

    def _places(self, offsets: Mapping[int, int]) -> list[TopicPartition]:
        return [TopicPartition(self._topic, p, offset) for p, offset in offsets.items()]

    def _news(self, positions: Mapping[int, int]) -> list[TopicPartition]:
        return [
            TopicPartition(self._topic, partition, offset)
            for partition, offset in positions.items()
            if self._committed.get(partition, OFFSET_INVALID) != offset
        ]

    def _on_commit(self, error: KafkaError | None, partitions: list[TopicPartition]) -> None:
        if error is not None:
            self._log.warning('cannot commit now: %s', error.str())
            return
        self._health.on_contact()
        self._committed.update(
            {p.partition: p.offset for p in partitions if p.error is None and p.offset >= 0}
        )

    def _forget(self, partitions: list[TopicPartition]) -> None:
        for partition in partitions:
            self._gone.add(partition.partition)
            self._beginnings.forget(partition.partition)
            for known in (self._committed, self._positions, self.ends):
                known.pop(partition.partition, None)


def _numbers(partitions: list[TopicPartition]) -> frozenset[int]:
    return frozenset(p.partition for p in partitions)


def _names(topic: str, partitions: list[TopicPartition]) -> str:
    return f'{topic}[{", ".join(str(p.partition) for p in sorted(partitions))}]'
