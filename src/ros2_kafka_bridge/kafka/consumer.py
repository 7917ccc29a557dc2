"""The records of one Kafka topic, read as a member of a group."""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.commits import Commits
from ros2_kafka_bridge.kafka.errors import Client, translate
from ros2_kafka_bridge.kafka.lag import Lag
from ros2_kafka_bridge.kafka.properties import Membership, member_name
from ros2_kafka_bridge.kafka.recorder import Recorder, with_recording
from ros2_kafka_bridge.kafka.statistics import read, with_statistics
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.watchdog import Watch
from ros2_kafka_bridge.threads import unattended

_REQUEST_S = 10.0
_LEAVE_S = 2.0
_AGAIN_S = 0.5
_LOOK_EVERY_S = 2.0
_LOOK_S = 0.5
_LAST_LOOK_S = 1.0
_REJOIN_MS = 30_000
_CLOSE_S = 5.0
_HAND_OVER_S = 2.0
_AT_ONCE_S = 30.0  # one more client sooner is left to the route, which waits between two
_SHUT_OUT_WORDS = 'Static consumer fenced'  # librdkafka's, whatever the code
_SHUT_OUT = 'the group has taken a late request for another member: begins anew with another'


class KafkaSource:
    """A `RecordSource` on a real topic.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: The topic to read.
        start: `latest` or `earliest`: where a topic begins that the group never read.
        log: Where to say what happens.
        membership: Of the group.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        start: str,
        log: logging.LoggerAdapter[logging.Logger],
        membership: Membership = 'static',
    ) -> None:
        # The group waits for so long for a member that does not join again.
        rejoin_ms = max(_REJOIN_MS, int(properties.get('session.timeout.ms', 0)))
        own = {
            'enable.partition.eof': True,
            'max.poll.interval.ms': rejoin_ms,
            **member_name(properties, membership),
        }
        self._properties = with_recording(with_statistics(own | dict(properties)))
        self._topic = topic
        self._beginnings = Beginnings(topic, start, log)
        self._log = log
        self._about = Client('READ', self._properties)
        self._health = ClientHealth(f'topic {topic}', log, self._about)
        self._watch = Watch(topic, float(properties.get('fetch.wait.max.ms', 500)) / 1000)
        self._lag = Lag()
        self._consumer: Consumer | None = None
        self._commits: Commits  # of the client
        self._recorder: Recorder  # of the client
        self._clients = 0  # made so far: what an old one still says does not count
        self._rebalance: Rebalance
        self._assigned: set[int] = set()  # a client that is shut out does not tell
        self._committed: dict[int, int] = {}
        self._positions: dict[int, int] = {}  # as they were to be committed last
        self._left: dict[int, tuple[int, int]] = {}  # of lost partitions: committed and position
        self._gone: set[int] = set()  # partitions handed over while records were read
        self._look_at_s = 0.0
        self._anew_at_s = -_AT_ONCE_S
        self._is_shut_out = False  # of the group
        self._is_committing = False  # not heard of yet
        self._held = False
        self._fresh = False  # some partitions came while the others were held
        self._closing = False
        self._joined = False
        self.rebalances = 0
        self.ends: dict[int, int] = {}

    @property
    def lost_upstream(self) -> int:
        """Records that the topic no longer held when the bridge came to read them."""
        return self._beginnings.lost

    @property
    def away(self) -> str:
        """Why nothing can be read just now; empty when all is well."""
        return self._health.away or self._watch.reason

    def open(self, rebalance: Rebalance) -> None:
        """Join the group.

        Raises:
            RouteError: librdkafka refuses the properties.
        """
        self._rebalance = rebalance
        self._health.on_open()
        check_files(self._properties, f'topic {self._topic}')
        self._begin()

    def _begin(self) -> None:
        """Join the group with a new client."""
        self._clients += 1
        self._watch.begin()
        self._recorder = Recorder(logging.getLogger(f'{__name__}.librdkafka'))
        self._closing = self._held = self._joined = False
        self._is_shut_out = self._is_committing = False
        callbacks = {
            'error_cb': self._own(self._on_error),
            'stats_cb': self._own(self._on_statistics),
            'on_commit': self._own(self._on_commit),
        }
        try:
            self._consumer = Consumer(self._properties | callbacks, logger=self._recorder)
            self._commits = Commits(self._consumer)
            self._consumer.subscribe(
                [self._topic],
                on_assign=self._own(self._on_assign),
                on_revoke=self._own(self._on_revoke),
                on_lost=self._own(self._on_lost),
            )
        except KafkaException as error:
            raise self._translated(error) from error

    def _own(self, callback: Callable[..., None]) -> Callable[..., None]:
        """A callback of the client that is made now; for nothing once there is another."""
        client = self._clients

        def called(*said: Any) -> None:
            if client == self._clients:
                callback(*said)

        return called

    def _on_assign(self, _: Consumer, partitions: list[TopicPartition]) -> None:
        self._fresh = self._joined = True
        self.rebalances += bool(partitions)
        self._watch.on_assign()
        self._health.on_contact()
        self._gone -= _numbers(partitions)
        self._assigned |= _numbers(partitions)
        self._log.info('reads %s', _names(self._topic, partitions))
        self._go_on(partitions)

    def _on_revoke(self, _: Consumer, partitions: list[TopicPartition]) -> None:
        if self._closing:
            return
        self.rebalances += bool(partitions)
        self._log.info('hands over %s', _names(self._topic, partitions))
        self._rebalance.revoked(_numbers(partitions))
        self._assigned -= _numbers(partitions)
        self._forget(partitions)

    def _on_lost(self, _: Consumer, partitions: list[TopicPartition]) -> None:
        self._log.warning(
            'lost %s: Kafka has not heard of this bridge, another may read on',
            _names(self._topic, partitions),
        )
        self._lose(partitions)

    def _lose(self, partitions: list[TopicPartition]) -> None:
        """Forget partitions, but for how far the route had come."""
        numbers = _numbers(partitions)
        self.rebalances += 1
        self._watch.on_lost()
        self._positions.update(self._rebalance.lost(numbers))
        self._assigned -= numbers
        for number in numbers & self._positions.keys():
            self._left[number] = self._committed.get(number, 0), self._positions[number]
        self._forget(partitions)

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Wait up to `timeout_s` for the first record, then return what is there.

        Raises:
            RouteError: The client is of no use any more.
        """
        with self._translating():
            if self._held:
                self._client.resume(self._client.assignment())
                self._held = False
            return self._read(limit, timeout_s)

    def hold(self) -> Sequence[Record]:
        """Stay a member of the group without reading on.

        Raises:
            RouteError: The client is of no use any more.
        """
        with self._translating():
            if not self._held or self._fresh:
                self._client.pause(self._client.assignment())
                self._held, self._fresh = True, False
            return self._read(1, 0.0)

    def commit(self, positions: Mapping[int, int]) -> None:
        """Commit the next offset to read of each partition, without waiting for it.

        One at a time, and none while Kafka is away: what librdkafka still holds when it is back
        can reach a broker that has given this member up, which ends the client.
        """
        self._positions.update(positions)
        news = self._news(positions)
        if not news or self._is_committing or self._health.away:
            return
        try:
            self._commit_soon(news)
        except KafkaException as error:
            self._log.warning('cannot commit now: %s', error.args[0].str())

    def commit_now(self, positions: Mapping[int, int], timeout_s: float) -> bool:
        """Commit and wait; False when it was not confirmed in time, or the partitions are lost."""
        # librdkafka's own synchronous commit waits for a broker without any limit.
        deadline_s = time.monotonic() + timeout_s
        again_s = 0.0
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self._client.pause(self._client.assignment())
        while self._news(positions) and (now_s := time.monotonic()) < deadline_s:
            if now_s >= again_s and not self._is_committing:
                if self._health.away:
                    self._ask_broker(min(_LAST_LOOK_S, deadline_s - now_s))
                self.commit(positions)
                again_s = now_s + _AGAIN_S
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                self._client.poll(0.05)
        lost = bool(self._left) and self._watch.is_outside
        return not lost and not self._news(positions)

    def commit_before_revoke(self, positions: Mapping[int, int]) -> None:
        """Commit from inside a rebalance, where polling for the answer is not possible."""
        news = self._news(positions)
        if not news:
            return
        try:
            if self._health.away:
                self._commit_soon(news)
            else:
                self._commits.within(_HAND_OVER_S, news)
        except KafkaException as error:
            self._log.warning('cannot commit before the hand-over: %s', error.args[0].str())

    def lag(self, positions: Mapping[int, int]) -> int:
        """How many records of the assigned partitions come behind `positions`.

        Raises:
            RouteError: The client is of no use any more.
        """
        ask = self._held and not self._health.away
        with self._translating():
            return self._lag.count(self._client, positions, ask=ask)

    def close(self) -> None:
        """Leave the group; what is to be committed has been."""
        if self._consumer is not None:
            self._closing = True
            # Who leaves while it joins stays a member for Kafka: the next one would wait for it.
            self._poll_while(lambda: not self._joined and not self._health.away)
            # A member with a name stays in the group when it closes, but not when it unsubscribes.
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                self._consumer.unsubscribe()
            self._poll_while(lambda: bool(self._client.assignment()))
            self._clients += 1  # one that is left behind has no say any more
            self._close_client()
            self._consumer = None
            self._lag.clear()
            for known in (
                self._committed, self._positions, self._left, self.ends, self._beginnings.wanted,
            ):  # fmt: skip
                known.clear()
            self._assigned.clear()

    def _poll_while(self, condition: Callable[[], bool]) -> None:
        """Let the client work for a moment, without taking records."""
        deadline_s = time.monotonic() + _LEAVE_S
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            while condition() and time.monotonic() < deadline_s:
                self._client.poll(0.01)

    def _close_client(self) -> None:
        """Close a client, or leave it behind: one that is not in its group may wait for ever."""
        try:
            ended = unattended.ends_within(_CLOSE_S, 'old consumer', self._commits.close_client)
        except RuntimeError:  # no more threads
            ended = False
        if not ended:
            self._log.warning('the Kafka client of %s does not end: left behind', self._topic)

    @property
    def _client(self) -> Consumer:
        assert self._consumer is not None, 'the source is open'
        return self._consumer

    @contextlib.contextmanager
    def _translating(self) -> Iterator[None]:
        try:
            yield
        except KafkaException as error:
            raise self._translated(error) from error

    def _translated(self, error: KafkaException) -> BridgeError:
        return translate(error.args[0], f'topic {self._topic}', self._about)

    def _read(self, limit: int, timeout_s: float) -> Sequence[Record]:
        # consume() waits its whole timeout unless all `limit` records come; poll() does not.
        try:
            first = self._client.poll(timeout_s)
        except KafkaException as error:  # fatal for the client
            if not self._note_whether_shut_out(error.args[0]):
                raise self._translated(error) from error
            first = None
        self._health.raise_failure()
        if self._is_shut_out or (first is None and self._health.has_lost_brokers):
            self._begin_anew(self._client)
            return ()
        if self._health.away and first is None:
            self._look_for_broker()
        if first is None:
            self._look_whether_useless()
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

    def _look_whether_useless(self) -> None:
        """Look at a client from which nothing comes; one that is given up says what it did."""
        try:
            self._watch.look_whether_outside(self._health.away)
            if not self._held and not self._health.away and self._watch.is_due():
                self._watch.look_whether_stuck(self._client, self._reached())
        except RouteError:
            self._recorder.tell(self._log)
            raise

    def _begin_anew(self, old: Consumer) -> None:
        """Put another client in the place of one that is of no use any more.

        What it read and the route has confirmed is not read again, unless another bridge reads on.

        Raises:
            RouteError: The last one was of no use either.
        """
        reason = _SHUT_OUT if self._is_shut_out else BROKERS_LOST
        before_s, self._anew_at_s = self._anew_at_s, time.monotonic()
        if self._anew_at_s - before_s < _AT_ONCE_S:
            raise RouteError(f'topic {self._topic}: {reason}')
        self._log.warning('%s', reason)
        if self._assigned:
            self._lose(self._places(dict.fromkeys(self._assigned, OFFSET_INVALID)))
        self._health.on_new_client()
        commits = self._commits
        try:
            self._begin()
        finally:
            if self._left:
                self._watch.on_lost()
            if self._consumer is not old:
                with contextlib.suppress(RuntimeError):  # no more threads: left behind
                    unattended.start('old consumer', commits.close_client)

    def _note_whether_shut_out(self, error: KafkaError) -> bool:
        """Whether the group has shut this client out: for a late request, its name is its own."""
        self._is_shut_out = self._is_shut_out or _SHUT_OUT_WORDS in error.str()
        return self._is_shut_out

    def _on_error(self, error: KafkaError) -> None:
        if not self._note_whether_shut_out(error):
            self._health.on_error(error)

    def _on_statistics(self, text: str) -> None:
        self._recorder.on_statistics(text)
        self._health.on_statistics(read(text))

    def _reached(self) -> dict[int, int]:
        """How far each partition was read, of those where that is known."""
        places = self._client.position(self._client.assignment())
        known = {**self._committed, **self._positions}
        reached = {p.partition: max(p.offset, known.get(p.partition, -1)) for p in places}
        return {p: max(at, self.ends.get(p, -1)) for p, at in reached.items() if at >= 0}

    def _look_for_broker(self) -> None:
        """Ask whether the broker is back: a quiet topic would not tell."""
        now_s = time.monotonic()
        if now_s >= self._look_at_s:
            self._look_at_s = now_s + _LOOK_EVERY_S
            self._ask_broker(_LOOK_S)

    def _ask_broker(self, within_s: float) -> None:
        with contextlib.suppress(KafkaException):
            self._client.list_topics(self._topic, timeout=within_s)
            self._health.on_contact()

    def _is_record(self, message: Message) -> bool:
        error = message.error()
        if error is None:
            self._health.on_contact()
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
        self._on_error(error)
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
            beginning = self._beginnings.find(
                self._client, self._commits, partition, wanted, known
            )
            if beginning.anew:
                self._rebalance.lost(frozenset({partition}))
                self._forget([TopicPartition(self._topic, partition)])
                self._commit_soon(self._places({partition: beginning.offset}))
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
                self._positions.update(resumed)
                self._commit_soon(self._places(resumed))
        except KafkaException as error:
            self._log.warning('begins at the committed offsets: %s', error.args[0].str())

    def _commit_soon(self, offsets: list[TopicPartition]) -> None:
        self._client.commit(offsets=offsets, asynchronous=True)
        self._is_committing = True

    def _places(self, offsets: Mapping[int, int]) -> list[TopicPartition]:
        return [TopicPartition(self._topic, p, offset) for p, offset in offsets.items()]

    def _news(self, positions: Mapping[int, int]) -> list[TopicPartition]:
        return [
            TopicPartition(self._topic, partition, offset)
            for partition, offset in positions.items()
            if self._committed.get(partition, OFFSET_INVALID) != offset
        ]

    def _on_commit(self, error: KafkaError | None, partitions: list[TopicPartition]) -> None:
        self._is_committing = False
        if error is not None:
            self._log.warning('cannot commit now: %s', error.str())
            return
        self._health.on_contact()
        self._committed.update(
            {
                p.partition: p.offset
                for p in partitions
                # An answer may come when another bridge reads on already.
                if p.error is None and p.offset >= 0 and p.partition in self._assigned
            }
        )

    def _forget(self, partitions: list[TopicPartition]) -> None:
        # librdkafka keeps a partition paused over its loss: it would come back and never be read.
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self._client.resume(partitions)
        for partition in partitions:
            self._gone.add(partition.partition)
            self._beginnings.forget(partition.partition)
            self._lag.forget(partition.partition)
            for known in (self._committed, self._positions, self.ends):
                known.pop(partition.partition, None)


def _numbers(partitions: list[TopicPartition]) -> frozenset[int]:
    return frozenset(p.partition for p in partitions)


def _names(topic: str, partitions: list[TopicPartition]) -> str:
    return f'{topic}[{", ".join(str(p.partition) for p in sorted(partitions))}]'
