"""How a member of a group commits: in passing, waited for, or in the middle of a hand-over."""

import contextlib
import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka.client_health import ClientHealth
from ros2_kafka_bridge.kafka.draining import close
from ros2_kafka_bridge.kafka.partitions import Committed, Partitions
from ros2_kafka_bridge.kafka.topic_id import TopicId
from ros2_kafka_bridge.threads import unattended

if TYPE_CHECKING:
    import threading

_AGAIN_S: Final = 0.5
_LAST_LOOK_S: Final = 1.0
_DRAIN_S: Final = 2.0
_BEGIN_S: Final = 5.0
# Offsets of a group by KIP-848 age from their own commit: that of a quiet partition would be gone
# as soon as its last member has left (offsets.retention.minutes, 7 days).
_RENEW_S: Final = 3600.0


class Commits:
    """The commits of one client: of what its partitions have come to, and the group has not got.

    One at a time, and none while Kafka is away: what librdkafka still holds when it is back can
    reach a broker that has given this member up, which ends the client.

    Args:
        client: A member of its group.
        topic: That it reads.
        partitions: That it has.
        health: Of the client.
        log: Where to say what cannot be committed.
    """

    def __init__(
        self,
        client: Consumer,
        topic: str,
        partitions: Partitions,
        health: ClientHealth,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self._client = client
        self._topic = topic
        self._partitions = partitions
        self._health = health
        self._log = log
        self._is_at_work = False  # not heard of yet
        self._renew_at_s = time.monotonic() + _RENEW_S
        self._late: list[threading.Thread] = []

    def soon(self) -> None:
        """Commit without waiting for it; now and then also what the group has got."""
        is_due = time.monotonic() >= self._renew_at_s
        offsets = self._partitions.positions if is_due else self._news()
        if not offsets or self._is_at_work or self._health.away:
            return
        try:
            self.begin(offsets)
            if is_due:
                self._renew_at_s = time.monotonic() + _RENEW_S
        except KafkaException as error:
            self._log.warning('cannot commit now: %s', error.args[0].str())

    def begin(self, offsets: Mapping[int, int]) -> None:
        """Commit an offset of each partition, without waiting for it.

        Raises:
            KafkaException: That is not possible.
        """
        self._client.commit(offsets=self._places(offsets), asynchronous=True)
        self._is_at_work = True

    def now(self, timeout_s: float) -> bool:
        """Commit and wait; tells whether the group has all."""
        # librdkafka's own synchronous commit waits for a broker without any limit.
        deadline_s = time.monotonic() + timeout_s
        again_s = 0.0
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            self._client.pause(self._client.assignment())
        while self._news() and (now_s := time.monotonic()) < deadline_s:
            if now_s >= again_s and not self._is_at_work:
                if self._health.away:
                    self._health.ask(
                        self._client, self._topic, min(_LAST_LOOK_S, deadline_s - now_s)
                    )
                self.soon()
                again_s = now_s + _AGAIN_S
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                self._client.poll(0.05)
        return not self._news()

    def before_revoke(self) -> None:
        """Commit from inside a rebalance, where polling for the answer is not possible.

        Nor is it waited for: while a callback of the client runs, confluent-kafka keeps every
        other thread that commits waiting (tried, 2.16). librdkafka does: it joins again, so that
        another can get the partitions, only once each commit was answered (rdkafka_assignment.c).
        """
        if news := self._news():
            try:
                self.begin(news)
            except KafkaException as error:
                self._log.warning('cannot commit before the hand-over: %s', error.args[0].str())

    def within(self, seconds: float, offsets: Mapping[int, int]) -> None:
        """Commit, and wait until the group has it.

        librdkafka waits without any limit for a broker that stands still (SIGSTOP: 75 s and
        more), so this has a thread of its own.

        Raises:
            KafkaException: It was refused, or took too long: then it may still be done.
        """
        problems: list[KafkaException] = []
        places = self._places(offsets)

        def commit() -> None:
            try:
                self._client.commit(offsets=places, asynchronous=False)
            except KafkaException as error:
                problems.append(error)

        try:
            thread = unattended.start('commit', commit)
        except RuntimeError as error:
            raise _failure(KafkaError._CRIT_SYS_RESOURCE, str(error)) from error  # noqa: SLF001
        thread.join(seconds)
        if thread.is_alive():
            self._late.append(thread)
            text = f'the broker has not answered a commit within {seconds:g} s'
            raise _failure(KafkaError._TIMED_OUT, text)  # noqa: SLF001 (its public name)
        if problems and self._note_refusal(problems[0].args[0]):
            self.within(seconds, offsets)
        elif problems:
            raise problems[0]

    def begin_anew(self, of: TopicId | None) -> None:
        """Forget all partitions, and commit that they begin at 0: their topic was made anew.

        Args:
            of: The topic that is there now.
        """
        begin = dict.fromkeys(self._partitions.numbers, 0)
        self._partitions.begin_anew(of)
        # Without an offset, whoever reads them next would begin where `start` says.
        with contextlib.suppress(KafkaException):
            self.within(_BEGIN_S, begin)
        self._partitions.clear()

    def on_answer(self, error: KafkaError | None, answers: Sequence[TopicPartition]) -> None:
        """Take what became of a commit that was not waited for (librdkafka's `on_commit`)."""
        self._is_at_work = False
        if error is not None:
            self._note_refusal(error)
            self._log.warning('cannot commit now: %s', error.str())
            return
        self._health.on_contact()
        good = [answer for answer in answers if answer.error is None and answer.offset >= 0]
        self._partitions.note_committed({answer.partition: answer.offset for answer in good})

    def close_client(self) -> None:
        """Close the client, once none of its commits is at work any more."""
        for thread in self._late:
            thread.join()
        close(self._client, _DRAIN_S, has_left=False)

    def close_client_within(self, seconds: float) -> None:
        """Close the client, or leave it behind: one that is not in its group may wait for ever."""
        try:
            ended = unattended.ends_within(seconds, 'old consumer', self.close_client)
        except RuntimeError:  # no more threads
            ended = False
        if not ended:
            self._log.warning('the Kafka client of %s does not end: left behind', self._topic)

    def _news(self) -> dict[int, int]:
        return self._partitions.news

    def _places(self, offsets: Mapping[int, int]) -> list[TopicPartition]:
        metadata = self._partitions.metadata
        return [TopicPartition(self._topic, n, at, metadata(n)) for n, at in offsets.items()]

    def _note_refusal(self, error: KafkaError) -> bool:
        """Whether another commit may be taken: without metadata (offset.metadata.max.bytes)."""
        is_too_large = error.code() == KafkaError.OFFSET_METADATA_TOO_LARGE
        may_be_taken = is_too_large and self._partitions.have_metadata
        self._partitions.have_metadata = self._partitions.have_metadata and not is_too_large
        return may_be_taken


def committed_of(answers: Iterable[TopicPartition]) -> dict[int, Committed]:
    """What a group has got, by partition; those of which it has nothing are left out.

    Raises:
        KafkaException: It was not told of one of them, which is not to have none.
    """
    told = list(answers)
    for answer in told:
        if answer.error is not None:
            raise KafkaException(answer.error)
    return {
        answer.partition: Committed(answer.offset, TopicId.of_metadata(answer.metadata))
        for answer in told
        if answer.offset >= 0
    }


def offsets_of(answers: Iterable[TopicPartition]) -> dict[int, int]:
    """The offsets alone; what it raises is that of `committed_of`."""
    return {number: told.offset for number, told in committed_of(answers).items()}


def _failure(code: int, text: str) -> KafkaException:
    return KafkaException(KafkaError(code, text))
