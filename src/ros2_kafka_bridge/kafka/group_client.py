"""One client of a consumer group, from its making to its end.

Whoever has a place in a group has one after the other: one that is of no use any more is replaced,
and what it still says counts for nothing.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka.client_health import ClientHealth
from ros2_kafka_bridge.kafka.recorder import Recorder, with_recording
from ros2_kafka_bridge.kafka.statistics import Statistics, read, with_statistics
from ros2_kafka_bridge.kafka.tls import check_files
from ros2_kafka_bridge.kafka.topic_partitions import numbers_of
from ros2_kafka_bridge.threads import unattended

if TYPE_CHECKING:
    import threading

_JOIN_S: Final = 2.0
_DRAIN_S: Final = 2.0
_SHUT_OUT_WORDS: Final = 'Static consumer fenced'  # librdkafka's, whatever the code
_STEP_S: Final = 0.01


def close(client: Consumer, within_s: float) -> None:
    """Close a client that was told all that waits for it, which may take so long."""
    drain(client, within_s)
    with contextlib.suppress(KafkaException):  # fatal for the client, and known
        client.close()


def poll_while(client: Consumer, condition: Callable[[], bool], within_s: float) -> None:
    """Let a client work for a moment, without taking records; what it raises is as for `drain`."""
    deadline_s = time.monotonic() + within_s
    with contextlib.suppress(KafkaException, SystemError):
        while condition() and time.monotonic() < deadline_s:
            client.poll(_STEP_S)


def drain(client: Consumer, within_s: float, *, has_left: bool = False) -> None:
    """Let a client call back all that waits for that; records that come are dropped.

    A rebalance that still waits when a client is closed is called back from inside of the close.
    What the answer asks of the client then may be purged with the client's own queue, and waited
    for for ever, with Python's lock held: each thread of the process stands still (librdkafka,
    its issue 4041; tried, 2.16).

    What it raises is passed over: that it is of no use any more is known. Of a partition that it
    is told to give up and has not got, it raises a KafkaError, and a SystemError where a call back
    meets that (tried, confluent-kafka 2.16).

    Args:
        client: Nobody else uses it any more.
        within_s: How long that may take.
        has_left: Whether it has unsubscribed: then it has to lose its partitions, too.
    """
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        try:
            if client.poll(_STEP_S) is None and not (has_left and client.assignment()):
                return
        except (KafkaException, SystemError):
            time.sleep(_STEP_S)


OnPartitions = Callable[[frozenset[int]], None]
"""Told the numbers of partitions."""


class GroupClient:
    """A client of a group; all calls but those of its end come from one thread.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: To subscribe to.
        health: What it says of itself, and its predecessors said.
        logger: For librdkafka's own lines.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        health: ClientHealth,
        logger: logging.Logger,
    ) -> None:
        self.consumer: Consumer
        self.health = health
        self.recorder = Recorder(logger)
        self.is_shut_out = False  # of its group, for a late request: its name is its own no more
        self._properties = with_recording(with_statistics(properties))
        self._topic = topic
        self._on_report: Callable[[Statistics], None] | None = None
        self._is_joining = False
        self._is_retired = False
        self._late: list[threading.Thread] = []  # with a commit that nobody waits for any more

    def open(
        self,
        on_report: Callable[[Statistics], None] | None = None,
        **callbacks: Callable[..., None],
    ) -> None:
        """Make the client.

        Args:
            on_report: Takes each report of the client.
            callbacks: More of librdkafka's, by their property.

        Raises:
            KafkaException: librdkafka refuses the properties.
            RouteError: A file that they name cannot be read.
        """
        check_files(self._properties, f'topic {self._topic}')
        self._on_report = on_report
        own: dict[str, Callable[..., None]] = {
            'error_cb': self.on_error,
            'stats_cb': self._on_statistics,
            **callbacks,
        }
        until_retired = {name: self._until_retired(callback) for name, callback in own.items()}
        self.consumer = Consumer(self._properties | until_retired, logger=self.recorder)

    def subscribe(
        self, on_assign: OnPartitions, on_revoke: OnPartitions, on_lost: OnPartitions
    ) -> None:
        """Join the group."""

        def telling(callback: OnPartitions) -> Callable[..., None]:
            def called(_: Consumer, places: list[TopicPartition]) -> None:
                self._is_joining = False
                if not self._is_retired:
                    callback(numbers_of(places))

            return called

        self.consumer.subscribe(
            [self._topic],
            on_assign=telling(on_assign),
            on_revoke=telling(on_revoke),
            on_lost=telling(on_lost),
        )
        self._is_joining = True  # what is called back comes at a poll

    def commit(self, within_s: float, places: Sequence[TopicPartition]) -> None:
        """Commit, and wait until the group has it.

        librdkafka waits without any limit for a broker that stands still (SIGSTOP: 75 s and
        more), so this has a thread of its own.

        Raises:
            KafkaException: It was refused, or took too long: then it may still be done.
        """
        problems: list[KafkaException] = []

        def commit() -> None:
            try:
                self.consumer.commit(offsets=list(places), asynchronous=False)
            except KafkaException as error:
                problems.append(error)

        try:
            thread = unattended.start('commit', commit)
        except RuntimeError as error:
            raise _failure(KafkaError._CRIT_SYS_RESOURCE, str(error)) from error  # noqa: SLF001
        thread.join(within_s)
        if thread.is_alive():
            self._late.append(thread)
            text = f'the broker has not answered a commit within {within_s:g} s'
            raise _failure(KafkaError._TIMED_OUT, text)  # noqa: SLF001 (its public name)
        if problems:
            raise problems[0]

    def on_error(self, error: KafkaError) -> None:
        """Take an error of the client, wherever it was told."""
        self.is_shut_out = self.is_shut_out or _SHUT_OUT_WORDS in error.str()
        if not self.is_shut_out:
            self.health.on_error(error)

    def end(self, within_s: float, *, leaves: bool) -> bool:
        """End it; what takes longer is left behind.

        Args:
            within_s: How long to wait for it: one that is not in its group may wait for ever.
            leaves: Whether its place is to be free; else the next one of its name has it.

        Returns:
            Whether it has ended.
        """
        self._is_retired = True
        join_s = min(_JOIN_S, within_s / 2)

        def end() -> None:
            if leaves:
                self._leave(join_s)
            for thread in self._late:
                thread.join()
            close(self.consumer, _DRAIN_S)

        try:
            return unattended.ends_within(within_s, f'old client of {self._topic}', end)
        except RuntimeError:  # this process may have no more threads
            if leaves:
                self._leave(join_s)
            return False

    def _leave(self, join_s: float) -> None:
        # Who leaves while it joins stays a member for Kafka: the next one would wait for it.
        poll_while(self.consumer, lambda: self._is_joining and not self.health.away, join_s)
        # A member with a name stays in the group when it closes, but not when it unsubscribes.
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self.consumer.unsubscribe()
        drain(self.consumer, _DRAIN_S, has_left=True)

    def _until_retired(self, callback: Callable[..., None]) -> Callable[..., None]:
        def called(*said: Any) -> None:
            if not self._is_retired:
                callback(*said)

        return called

    def _on_statistics(self, text: str) -> None:
        self.recorder.on_statistics(text)
        statistics = read(text)
        self.health.on_statistics(statistics)
        if statistics.is_connected:
            self.health.on_contact()  # a quiet topic would not tell
        if self._on_report is not None:
            self._on_report(statistics)


def _failure(code: int, text: str) -> KafkaException:
    return KafkaException(KafkaError(code, text))
