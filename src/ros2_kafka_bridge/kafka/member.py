"""A member of a consumer group: how it joins and leaves, what it is given, what it loses.

A client that is of no use any more is replaced here; what the route had come to goes over.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from confluent_kafka import (
    OFFSET_BEGINNING,
    Consumer,
    KafkaError,
    KafkaException,
    Message,
    TopicPartition,
)

from ros2_kafka_bridge.endpoints import Rebalance
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.commits import Commits, committed_of
from ros2_kafka_bridge.kafka.draining import drain, poll_while
from ros2_kafka_bridge.kafka.held_back import HeldBack
from ros2_kafka_bridge.kafka.partitions import Partitions
from ros2_kafka_bridge.kafka.recorder import Recorder
from ros2_kafka_bridge.kafka.statistics import read
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topic_partitions import at, at_stored, in_words, numbers_of
from ros2_kafka_bridge.kafka.topic_watch import TopicWatch
from ros2_kafka_bridge.kafka.watchdog import Watchdog
from ros2_kafka_bridge.threads import unattended

_REQUEST_S: Final = 10.0
_LEAVE_S: Final = 2.0
_LOOK_EVERY_S: Final = 2.0
_LOOK_S: Final = 0.5
_LONG_LOOK_S: Final = 1.0  # what is not there is said of Kafka
_CLOSE_S: Final = 5.0
_AT_ONCE_S: Final = 30.0  # one more client sooner is left to the route, which waits between two
_SHUT_OUT_WORDS: Final = 'Static consumer fenced'  # librdkafka's, whatever the code
_SHUT_OUT: Final = (
    'the group has taken a late request for another member: begins anew with another'
)


class Member:
    """A place in a group, held by one client after the other.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: That it reads.
        partitions: Where to keep what it is given.
        watch: Of the topic.
        health: What the client says of itself.
        log: Where to say what happens.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        partitions: Partitions,
        watch: TopicWatch,
        health: ClientHealth,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self.rebalances = 0  # how often partitions came or went
        self.commits: Commits  # of the client
        self._properties = dict(properties)
        self._topic = topic
        self._partitions = partitions
        self._watch = watch
        self._health = health
        self._log = log
        self._watchdog = Watchdog(topic, float(properties.get('fetch.wait.max.ms', 500)) / 1000)
        self._held_back = HeldBack(topic, partitions)
        self._consumer: Consumer | None = None
        self._recorder: Recorder  # of the client
        self._clients = 0  # made so far: what an old one still says does not count
        self._rebalance: Rebalance
        self._look_at_s = 0.0
        self._anew_at_s = -_AT_ONCE_S
        self._is_shut_out = False  # of the group
        self._is_paused = False
        self._reads_some = False  # some partitions came while the others were paused
        self._is_leaving = False
        self._has_joined = False

    @property
    def client(self) -> Consumer:
        """Its client."""
        assert self._consumer is not None, 'the source is open'
        return self._consumer

    @property
    def away(self) -> str:
        """Why nothing can be read just now; empty when all is well."""
        return self._health.away or self._watchdog.reason

    @property
    def held_back(self) -> str:
        """Why Kafka gives out nothing though it is there; empty while nothing is asked for."""
        return '' if self._is_paused else self._held_back.reason

    @property
    def is_in_group(self) -> bool:
        """Whether it knows which partitions it has."""
        return not self._watchdog.joins

    @property
    def hears_ends(self) -> bool:
        """Whether it is told, while it reads, where its partitions end."""
        return not self._health.away and (self._is_paused or not self._held_back.hides_ends)

    @property
    def is_answered(self) -> bool | None:
        """Whether Kafka answers, though it may not let it into the group; None: not heard yet."""
        if self._health.away or self._watchdog.is_there is False:
            return False
        return self._health.is_heard or None

    @property
    def is_paused(self) -> bool:
        """Whether it stays without reading on."""
        return self._is_paused

    @property
    def is_outside(self) -> bool:
        """Whether it owes commits for partitions that it has lost with its place in the group."""
        return self._partitions.owe_lost and self._watchdog.is_outside

    # To join, and to leave

    def join(self, rebalance: Rebalance) -> None:
        """Join the group.

        Raises:
            KafkaException: librdkafka refuses the properties.
            RouteError: A file that they name cannot be read.
        """
        self._rebalance = rebalance
        self._health.on_open()
        check_files(self._properties, f'topic {self._topic}')
        self._begin()

    def _begin(self) -> None:
        """Join the group with a new client."""
        self._clients += 1
        self._watchdog.begin()
        self._watch.begin()
        self._recorder = Recorder(logging.getLogger(f'{__name__}.librdkafka'))
        self._is_leaving = self._is_paused = self._has_joined = self._is_shut_out = False
        callbacks = {
            'error_cb': self._own(self.on_error),
            'stats_cb': self._own(self._on_statistics),
            'throttle_cb': self._own(lambda it: self._held_back.on_throttle(it.throttle_time)),
            'on_commit': self._own(self._on_commit),
        }
        self._consumer = Consumer(self._properties | callbacks, logger=self._recorder)
        self.commits = Commits(
            self._consumer, self._topic, self._partitions, self._health, self._log
        )
        self._consumer.subscribe(
            [self._topic],
            on_assign=self._own(self._on_assign),
            on_revoke=self._own(self._on_revoke),
            on_lost=self._own(self._on_lost),
        )

    def _own(self, callback: Callable[..., None]) -> Callable[..., None]:
        """A callback of the client that is made now; for nothing once there is another."""
        client = self._clients

        def called(*said: Any) -> None:
            if client == self._clients:
                callback(*said)

        return called

    def leave(self) -> None:
        """Leave the group; what is to be committed has been."""
        if self._consumer is None:
            return
        self._is_leaving = True
        # Who leaves while it joins stays a member for Kafka: the next one would wait for it.
        poll_while(self.client, lambda: not (self._has_joined or self._health.away), _LEAVE_S)
        self._clients += 1  # its callbacks have no say any more
        # A member with a name stays in the group when it closes, but not when it unsubscribes.
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self._consumer.unsubscribe()
        drain(self._consumer, _LEAVE_S, has_left=True)
        self.commits.close_client_within(_CLOSE_S)
        self._consumer = None
        self._partitions.clear()

    # To read, or not

    def poll(self, timeout_s: float) -> Message | None:
        """Wait up to `timeout_s` for what comes next; None: nothing, or another client begins.

        Raises:
            KafkaException: The client is of no use any more.
            RouteError: That was found out otherwise.
        """
        if self.leave_old_topic():
            return None
        try:
            first = self.client.poll(timeout_s)
        except KafkaException as error:  # fatal for the client
            if not self._note_whether_shut_out(error.args[0]):
                raise
            first = None
        if self._health.has_failed and self.leave_old_topic(at_once=True):
            return None  # a partition that the new topic has not, for one
        self._health.raise_failure()
        if self._is_shut_out or (first is None and self._health.has_lost_brokers):
            self._replace_useless_client(_SHUT_OUT if self._is_shut_out else BROKERS_LOST)
            return None
        if first is None:
            self._look_for_broker()
            self._look_whether_useless()
        return first

    def read_on(self) -> None:
        """Read all partitions."""
        if self._is_paused:
            self.client.resume(self.client.assignment())
            self._is_paused = False

    def pause(self) -> None:
        """Read nothing, also of partitions that have come meanwhile."""
        if not self._is_paused or self._reads_some:
            self.client.pause(self.client.assignment())
            self._is_paused, self._reads_some = True, False

    def begin_at(self, number: int, offset: int) -> None:
        """Read a partition from an offset on."""
        self.client.incremental_unassign(at_stored(self._topic, [number]))
        self.client.incremental_assign(at(self._topic, {number: offset}))
        self._reads_some = True

    def forget_one(self, number: int) -> None:
        """Forget what is known of a partition that it keeps: its topic was made anew."""
        self._rebalance.detached(frozenset({number}))
        self._resume([number])
        self._partitions.reset(number)

    # What the group says

    def _on_assign(self, _: Consumer, assigned: list[TopicPartition]) -> None:
        self._reads_some = self._has_joined = True
        self.rebalances += bool(assigned)
        self._watchdog.on_assign()
        self._health.on_contact()
        numbers = numbers_of(assigned)
        self._partitions.assign(numbers)
        self._log.info('reads %s', in_words(self._topic, numbers))
        if numbers:
            self._set_places(numbers)

    def _on_revoke(self, _: Consumer, revoked: list[TopicPartition]) -> None:
        if self._is_leaving:
            return
        self.rebalances += bool(revoked)
        numbers = numbers_of(revoked)
        self._log.info('hands over %s', in_words(self._topic, numbers))
        self._rebalance.revoked(numbers)
        self._resume(numbers)
        self._partitions.forget(numbers)

    def _on_lost(self, _: Consumer, lost: list[TopicPartition]) -> None:
        numbers = numbers_of(lost)
        self._log.warning(
            'lost %s: Kafka has not heard of this bridge, another may read on',
            in_words(self._topic, numbers),
        )
        self._lose(numbers)

    def _lose(self, numbers: frozenset[int]) -> None:
        self.rebalances += 1
        self._watchdog.on_lost()
        self._rebalance.lost(numbers)
        self._resume(numbers)
        self._partitions.lose(numbers)

    def _set_places(self, numbers: frozenset[int]) -> None:
        """Go on where partitions were lost and nobody read on, and at 0 of a topic made anew."""
        try:
            committed = self.client.committed(at_stored(self._topic, numbers), timeout=_REQUEST_S)
            told = committed_of(committed)
            gone = self._watch.find_gone({n: told[n].of if n in told else None for n in numbers})
            resumed = self._partitions.resume({n: told[n] for n in told.keys() - gone})
            if others := resumed | dict.fromkeys(gone, OFFSET_BEGINNING):
                rest = at_stored(self._topic, numbers - others.keys())
                self.client.incremental_assign(rest + at(self._topic, others))
            if resumed:
                self.commits.begin(resumed)
        except KafkaException as error:
            self._health.fail(error.args[0], 'the offsets of its group cannot be read')
        self._partitions.forget_lost(numbers)

    def _resume(self, numbers: Iterable[int]) -> None:
        # librdkafka keeps a partition paused over its loss: it would come back and never be read.
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self.client.resume(at_stored(self._topic, numbers))

    # Whether the client is of use

    def on_error(self, error: KafkaError) -> None:
        """Take an error of the client, wherever it was told."""
        if not self._note_whether_shut_out(error):
            self._health.on_error(error)

    def _on_commit(self, error: KafkaError | None, answers: list[TopicPartition]) -> None:
        self.commits.on_answer(error, answers)

    def _on_statistics(self, text: str) -> None:
        self._recorder.on_statistics(text)
        statistics = read(text)
        self._health.on_statistics(statistics)
        if statistics.is_connected:
            self._health.on_contact()  # a quiet topic would not tell
        self._held_back.on_ends(statistics.ends)
        self._watch.on_metadata(statistics.metadata_age_s)

    def _note_whether_shut_out(self, error: KafkaError) -> bool:
        """Whether the group has shut this client out: for a late request, its name is its own."""
        self._is_shut_out = self._is_shut_out or _SHUT_OUT_WORDS in error.str()
        return self._is_shut_out

    def _look_for_broker(self) -> None:
        """Ask whether a broker that was away is back: a quiet topic would not tell.

        Whoever waits for the group asks, too: one that stands still looks as if it were there.
        """
        now_s = time.monotonic()
        if (self._health.away or self._watchdog.joins_for_long) and now_s >= self._look_at_s:
            self._look_at_s = now_s + _LOOK_EVERY_S
            within_s = _LOOK_S if self._health.away else _LONG_LOOK_S
            self._watchdog.is_there = self._health.ask(self.client, self._topic, within_s)

    def _look_whether_useless(self) -> None:
        """Look at a client from which nothing comes; one that is given up says what it did."""
        try:
            self._watchdog.look_whether_outside(self._health.away)
            if not (self._is_paused or self._health.away or self._held_back.is_throttled):
                self._watchdog.look_whether_stuck(self.client, self._partitions.reached)
        except RouteError:
            self._recorder.tell(self._log)
            raise

    def is_topic_replaced(self, *, at_once: bool) -> bool:
        """Whether the topic that it reads was made anew, as `TopicWatch.is_replaced`."""
        return not self._health.away and self._watch.is_replaced(at_once=at_once)

    def leave_old_topic(self, *, at_once: bool = False) -> bool:
        """Begin anew with another client where its topic was: this one knows the old one."""
        if not self.is_topic_replaced(at_once=at_once):
            return False
        self.forget_old_topic()
        self._replace_client('its topic was made anew: begins anew with another Kafka client')
        return True

    def forget_old_topic(self) -> None:
        """Forget all of a topic that is gone, and tell the group to begin at 0."""
        self._rebalance.detached(self._partitions.numbers)
        self.commits.begin_anew(self._watch.now)

    def _replace_useless_client(self, reason: str) -> None:
        """Put another client in the place of one that has failed.

        What it read and the route has confirmed is not read again, unless another bridge reads on.

        Raises:
            RouteError: The last one has failed, too.
        """
        before_s, self._anew_at_s = self._anew_at_s, time.monotonic()
        if self._anew_at_s - before_s < _AT_ONCE_S:
            raise RouteError(f'topic {self._topic}: {reason}')
        self._replace_client(reason)

    def _replace_client(self, reason: str) -> None:
        old = self.client
        self._log.warning('%s', reason)
        if self._partitions:
            self._lose(self._partitions.numbers)
        self._health.on_new_client()
        commits = self.commits
        try:
            self._begin()
        finally:
            if self._partitions.are_lost:
                self._watchdog.on_lost()
            if self._consumer is not old:
                with contextlib.suppress(RuntimeError):  # no more threads: left behind
                    unattended.start('old consumer', commits.close_client)
