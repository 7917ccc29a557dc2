"""A member of a consumer group: how it joins and leaves, what it is given, what it loses.

A client that is of no use any more is replaced here; what the route had come to goes over.
"""

import contextlib
import logging
import time
from collections.abc import Iterable, Mapping
from typing import Any, Final

from confluent_kafka import (
    OFFSET_BEGINNING,
    Consumer,
    KafkaException,
    Message,
)

from ros2_kafka_bridge.endpoints import Rebalance
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.kafka.held_back import HeldBack
from ros2_kafka_bridge.kafka.offsets import Offsets, committed_of
from ros2_kafka_bridge.kafka.statistics import Statistics
from ros2_kafka_bridge.kafka.topic_partitions import at, at_stored, in_words
from ros2_kafka_bridge.kafka.topic_watch import TopicWatch
from ros2_kafka_bridge.kafka.watchdog import Watchdog
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.threads.wakeup import Wakeup

_PIECE_S: Final = 0.2
_REQUEST_S: Final = 10.0
_LEAVE_S: Final = 9.0
_LIBRARY: Final = f'{__name__}.librdkafka'
_AT_ONCE_S: Final = 30.0  # one more client sooner is left to the route, which waits between two
_SHUT_OUT: Final = (
    'the group has taken a late request for another member: begins anew with another'
)


class Member:
    """A place in a group, held by one client after the other.

    Args:
        properties: librdkafka properties of a consumer with its group.
        offsets: Of the topic that it reads.
        watch: Of the topic.
        health: What the client says of itself.
        log: Where to say what happens.
        wakeup: Ends a wait for what comes next.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        offsets: Offsets,
        watch: TopicWatch,
        health: ClientHealth,
        log: Log,
        wakeup: Wakeup,
    ) -> None:
        self.rebalances = 0  # how often partitions came or went
        self.is_paused = False  # whether it stays without reading on
        self._properties = dict(properties)
        self._topic = topic = offsets.topic
        self._offsets = offsets
        self._watch = watch
        self._health = health
        self._log = log
        self._wakeup = wakeup
        self._watchdog = Watchdog(topic, float(properties.get('fetch.wait.max.ms', 500)) / 1000)
        self._held_back = HeldBack(offsets)
        self._client: GroupClient | None = None
        self._rebalance: Rebalance
        self._anew_at_s = -_AT_ONCE_S
        self._reads_some = False  # some partitions came while the others were paused

    @property
    def client(self) -> GroupClient:
        """Its client."""
        assert self._client is not None, 'the source is open'
        return self._client

    @property
    def consumer(self) -> Consumer:
        """The library's part of it."""
        return self.client.consumer

    @property
    def away(self) -> str:
        """Why nothing can be read just now; empty when all is well."""
        return self._health.away or self._watchdog.reason

    @property
    def held_back(self) -> str:
        """Why Kafka gives out nothing though it is there; empty while nothing is asked for."""
        return '' if self.is_paused else self._held_back.reason

    @property
    def is_in_group(self) -> bool:
        """Whether it knows which partitions it has."""
        return not self._watchdog.joins

    @property
    def hears_ends(self) -> bool:
        """Whether it is told, while it reads, where its partitions end."""
        return not self._health.away and (self.is_paused or not self._held_back.hides_ends)

    @property
    def is_answered(self) -> bool | None:
        """Whether Kafka answers, though it may not let it into the group; None: not heard yet."""
        if self._health.away or self._watchdog.is_there is False:
            return False
        return self._health.is_heard or None

    @property
    def is_outside(self) -> bool:
        """Whether it owes commits for partitions that it has lost with its place in the group."""
        return self._offsets.owe_lost and self._watchdog.is_outside

    # To join, and to leave

    def join(self, rebalance: Rebalance) -> None:
        """Join the group.

        Raises:
            KafkaException: librdkafka refuses the properties.
            RouteError: A file that they name cannot be read.
        """
        self._rebalance = rebalance
        self._health.on_open()
        self._begin()

    def _begin(self) -> None:
        """Join the group with a new client."""
        logger = logging.getLogger(_LIBRARY)
        client = GroupClient(self._properties, self._topic, self._health, logger)
        client.open(
            self._on_statistics,
            throttle_cb=lambda it: self._held_back.on_throttle(it.throttle_time),
            on_commit=self._offsets.on_answer,
        )
        self._client = client
        self.is_paused = False
        self._watchdog.begin()
        self._watch.begin()
        self._offsets.use(client)
        client.subscribe(self._on_assign, self._on_revoke, self._on_lost)

    def leave(self) -> None:
        """Leave the group; what is to be committed has been."""
        if self._client is None:
            return
        if not self._client.end(_LEAVE_S, leaves=True):
            self._log.warning('the Kafka client of %s does not end: left behind', self._topic)
        self._client = None
        self._offsets.clear()

    # To read, or not

    def poll(self, timeout_s: float) -> Message | None:
        """Wait up to `timeout_s` for what comes next; None: nothing, or another client begins.

        Raises:
            KafkaException: The client is of no use any more.
            RouteError: That was found out otherwise.
        """
        if self.leave_old_topic():
            return None
        client = self.client
        try:
            first = self._next(client.consumer, timeout_s)
        except KafkaException as error:  # fatal for the client
            client.on_error(error.args[0])
            if not client.is_shut_out:
                raise
            first = None
        if self._health.has_failed and self.leave_old_topic(at_once=True):
            return None  # a partition that the new topic has not, for one
        self._health.raise_failure()
        if client.is_shut_out or (first is None and self._health.has_lost_brokers):
            self._replace_useless_client(_SHUT_OUT if client.is_shut_out else BROKERS_LOST)
            return None
        if first is None:
            self._watchdog.look_for_broker(client.consumer, self._health)
            self._look_whether_useless()
        return first

    def _next(self, consumer: Consumer, timeout_s: float) -> Message | None:
        """Wait in pieces: nobody but Kafka ends the wait of a client."""
        while timeout_s > _PIECE_S:
            first = consumer.poll(_PIECE_S)
            if first is not None or self._must_look:
                return first
            if self._wakeup.is_rung:
                self._wakeup.clear()
                return None
            timeout_s -= _PIECE_S
        return consumer.poll(timeout_s)

    @property
    def _must_look(self) -> bool:
        """Whether something has happened that no wait may hold up."""
        health = self._health
        has_trouble = bool(health.away) or health.has_failed or health.has_lost_brokers
        return has_trouble or self.client.is_shut_out or self._watch.is_asking

    def read_on(self) -> None:
        """Read all partitions."""
        if self.is_paused:
            self.consumer.resume(self.consumer.assignment())
            self.is_paused = False

    def pause(self) -> None:
        """Read nothing, also of partitions that have come meanwhile."""
        if not self.is_paused or self._reads_some:
            self.consumer.pause(self.consumer.assignment())
            self.is_paused, self._reads_some = True, False

    def begin_at(self, number: int, offset: int) -> None:
        """Read a partition from an offset on."""
        self.consumer.incremental_unassign(at_stored(self._topic, [number]))
        self.consumer.incremental_assign(at(self._topic, {number: offset}))
        self._reads_some = True

    def begin_anew_at(self, number: int, offset: int) -> None:
        """Forget what is known of a partition that it keeps, and read it from an offset on."""
        self._rebalance.detached(frozenset({number}))
        self._resume([number])
        self._offsets.begin_at(number, offset)
        self._offsets.commit()
        self.begin_at(number, offset)

    # What the group says

    def _on_assign(self, numbers: frozenset[int]) -> None:
        self._reads_some = True
        self.rebalances += bool(numbers)
        self._watchdog.on_assign()
        self._health.on_contact()
        self._offsets.assign(numbers)
        self._log.info('reads %s', in_words(self._topic, numbers))
        if numbers:
            self._set_places(numbers)

    def _on_revoke(self, numbers: frozenset[int]) -> None:
        """Hand partitions over: the next reader begins where the group was told last.

        1. The route ends what it can, tells how far that is, and gives back the rest.
        2. The group is told; the client waits for its answer before it lets go of them.
        3. Nothing of them is known here any more.
        """
        self.rebalances += bool(numbers)
        self._log.info('hands over %s', in_words(self._topic, numbers))
        self._rebalance.revoked(numbers)
        self._offsets.commit_before_revoke()
        self._resume(numbers)
        self._offsets.forget(numbers)

    def _on_lost(self, numbers: frozenset[int]) -> None:
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
        self._offsets.lose(numbers)

    def _set_places(self, numbers: frozenset[int]) -> None:
        """Go on where partitions were lost and nobody read on, and at 0 of a topic made anew."""
        try:
            stored = at_stored(self._topic, numbers)
            told = committed_of(self.consumer.committed(stored, timeout=_REQUEST_S))
            gone = self._watch.find_gone({n: told[n].of if n in told else None for n in numbers})
            resumed = self._offsets.resume(numbers, {n: told[n] for n in told.keys() - gone})
            if others := resumed | dict.fromkeys(gone, OFFSET_BEGINNING):
                rest = at_stored(self._topic, numbers - others.keys())
                self.consumer.incremental_assign(rest + at(self._topic, others))
                self._offsets.commit()
        except KafkaException as error:
            self._health.fail(error.args[0], 'the offsets of its group cannot be read')

    def _resume(self, numbers: Iterable[int]) -> None:
        # librdkafka keeps a partition paused over its loss: it would come back and never be read.
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self.consumer.resume(at_stored(self._topic, numbers))

    # Whether the client is of use

    def _on_statistics(self, statistics: Statistics) -> None:
        self._held_back.on_ends(statistics.ends)
        self._watch.on_metadata(statistics.metadata_age_s)

    def _look_whether_useless(self) -> None:
        """Look at a client from which nothing comes; one that is given up says what it did."""
        try:
            self._watchdog.look_whether_outside(self._health.away)
            if not (self.is_paused or self._health.away or self._held_back.is_throttled):
                self._watchdog.look_whether_stuck(self.consumer, self._offsets.reached)
        except RouteError:
            self.client.recorder.tell(self._log)
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
        self._rebalance.detached(self._offsets.numbers)
        self._offsets.begin_anew(self._watch.known)

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
        if self._offsets:
            self._lose(self._offsets.numbers)
        self._health.on_new_client()
        try:
            self._begin()
        finally:
            if self._offsets.are_lost:
                self._watchdog.on_lost()
            if self._client is not old:
                old.end(0.0, leaves=False)
