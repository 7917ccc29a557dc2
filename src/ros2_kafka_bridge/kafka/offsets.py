"""How far a group has come in the partitions of a topic, in four steps.

1. What was handed out ends. Who reads tells how far: all before that offset have ended
   (`advance`).
2. The position of a partition moves there, and on behind what is no record, where all that was
   handed out has ended.
3. The positions that the group has not got are committed.
4. The group answers: it has them.

A source keeps its offsets nowhere else: who reads, joins, measures the lag or looks for a
beginning asks here. They outlive a client: what was lost is gone on with where nobody has read on
meanwhile (`resume`).
"""

import contextlib
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, Protocol

from confluent_kafka import KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.kafka.partition import Committed, Partition
from ros2_kafka_bridge.kafka.topic_id import TopicId
from ros2_kafka_bridge.logs.lines import Log

_AGAIN_S: Final = 0.5
_LAST_LOOK_S: Final = 1.0
_BEGIN_S: Final = 5.0
# Offsets of a group by KIP-848 age from their own commit: that of a quiet partition would be gone
# as soon as its last member has left (offsets.retention.minutes, 7 days).
_RENEW_S: Final = 3600.0


class _HasOffset(Protocol):
    """A record as far as it is looked at here."""

    def partition(self) -> int | None:
        """Number of its partition."""

    def offset(self) -> int | None:
        """Its offset in the partition."""


class Offsets:
    """The offsets of the partitions that a source has, and of those that it has lost.

    Args:
        topic: That it reads.
        log: Where to say what cannot be committed.
    """

    def __init__(self, topic: str, log: Log) -> None:
        self.topic = topic
        self._log = log
        self._here: dict[int, Partition] = {}
        self._lost: dict[int, Partition] = {}
        self._client: GroupClient
        self._unanswered = 0  # commits
        self._takes_metadata = True  # False where a broker takes none so long
        self._renew_at_s = 0.0

    def use(self, client: GroupClient) -> None:
        """Commit with another client from now on."""
        self._client = client
        self._unanswered = 0
        self._renew_at_s = time.monotonic() + _RENEW_S

    def __contains__(self, number: object) -> bool:
        return number in self._here

    def __iter__(self) -> Iterator[Partition]:
        return iter(self._here.values())

    def __len__(self) -> int:
        return len(self._here)

    def __getitem__(self, number: int) -> Partition:
        return self._here[number]

    def get(self, number: int | None) -> Partition | None:
        """Where one stands; None where it is not here."""
        return None if number is None else self._here.get(number)

    @property
    def numbers(self) -> frozenset[int]:
        """Which are here."""
        return frozenset(self._here)

    @property
    def are_lost(self) -> bool:
        """Whether some were lost of which something was read, and are not here again."""
        return bool(self._lost)

    @property
    def owe_lost(self) -> bool:
        """Whether of a lost one the group has not got how far it had come."""
        return any(partition.position != partition.committed for partition in self._lost.values())

    @property
    def are_cut_off(self) -> bool:
        """Whether records of some are missing, and nothing was read behind them yet."""
        return any(partition.wanted is not None for partition in self)

    @property
    def positions(self) -> dict[int, int]:
        """The position of each where that is known."""
        return {p.number: p.position for p in self if p.position is not None}

    @property
    def uncommitted(self) -> dict[int, int]:
        """The positions that the group has not got."""
        return {n: at for n, at in self.positions.items() if at != self._here[n].committed}

    @property
    def reached(self) -> dict[int, int]:
        """How far each was read where that is known."""
        return {p.number: p.reached for p in self if p.reached is not None}

    # What comes and goes

    def assign(self, numbers: Iterable[int]) -> None:
        """Begin with partitions of which nothing is known."""
        for number in numbers:
            self._here.setdefault(number, Partition(number))

    def resume(self, numbers: Iterable[int], told: Mapping[int, Committed]) -> dict[int, int]:
        """Go on with partitions that were lost, if nobody has read on; the others begin.

        Args:
            numbers: Those that have come.
            told: What the group has got of them, and of the topic that is there.

        Returns:
            The positions of those that go on.
        """
        self.note_committed({number: it.offset for number, it in told.items()})
        resumed = {}
        for number in numbers:
            lost = self._lost.pop(number, None)
            if (
                lost is not None
                and lost.position is not None
                and number in told
                and lost.of == self._here[number].of
                and (lost.committed or 0) <= told[number].offset < lost.position
            ):
                resumed[number] = lost.position
        self.advance(resumed)
        return resumed

    def begin_at(self, number: int, position: int) -> None:
        """Forget what is known of one that stays, and begin with it anew."""
        self._here[number] = Partition(number, position=position, of=self._here[number].of)

    def begin_anew(self, of: TopicId | None) -> None:
        """Forget all partitions, and commit that they begin at 0: their topic was made anew.

        Args:
            of: The topic that is there now.
        """
        for number in self._here:
            self._here[number] = Partition(number, of=of)
        # Without an offset, whoever reads them next would begin where `start` says.
        with contextlib.suppress(KafkaException):
            self.commit_within(_BEGIN_S, dict.fromkeys(self._here, 0))
        self.clear()

    def forget(self, numbers: Iterable[int]) -> None:
        """Forget partitions that were handed over."""
        for number in numbers:
            self._here.pop(number, None)

    def lose(self, numbers: Iterable[int]) -> None:
        """Forget partitions, but for how far the route had come."""
        for number in numbers:
            partition = self._here.pop(number, None)
            if partition is not None and partition.position is not None:
                self._lost[number] = partition

    def clear(self) -> None:
        """Forget all."""
        self._here.clear()
        self._lost.clear()

    # 1. and 2. What is read, and ends

    def hand_out(self, records: Sequence[_HasOffset]) -> None:
        """Note records that go to the route now, in the order of reading."""
        last = {record.partition() or 0: record for record in records}
        for number, record in last.items():
            if (partition := self._here.get(number)) is not None:
                if partition.position is None:
                    # What is missing before it is not passed over until it was counted.
                    missing = partition.wanted
                    partition.position = _first(records, number) if missing is None else missing
                partition.read = (record.offset() or 0) + 1

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note positions: all before them have ended."""
        for number, position in positions.items():
            if (partition := self._here.get(number)) is not None:
                partition.advance(position)

    def reach_end(self, number: int, end: int) -> None:
        """Note that there is nothing left before `end`."""
        if (partition := self._here.get(number)) is not None:
            partition.reach_end(end)

    # 3. What is committed

    def commit(self) -> None:
        """Commit without waiting for it; now and then also what the group has got.

        One at a time, and none while Kafka is away: what librdkafka still holds when it is back
        can reach a broker that has given this member up, which ends the client.
        """
        if self._unanswered or self._client.health.away:
            return
        is_due = time.monotonic() >= self._renew_at_s
        if self._begin_commit(self.positions if is_due else self.uncommitted) and is_due:
            self._renew_at_s = time.monotonic() + _RENEW_S

    def commit_before_revoke(self) -> None:
        """Commit from inside a rebalance, where polling for the answer is not possible.

        Nor is it waited for: while a callback of the client runs, confluent-kafka keeps every
        other thread that commits waiting (tried, 2.16). librdkafka does: it joins again, so that
        another can get the partitions, only once each commit was answered (rdkafka_assignment.c).
        """
        self._begin_commit(self.uncommitted, when='before the hand-over')

    def _begin_commit(self, offsets: Mapping[int, int], when: str = 'now') -> bool:
        if not offsets:
            return False
        try:
            self._client.consumer.commit(offsets=self._places(offsets), asynchronous=True)
        except KafkaException as error:
            self._log.warning('cannot commit %s: %s', when, error.args[0].str())
            return False
        self._unanswered += 1
        return True

    def commit_now(self, timeout_s: float) -> bool:
        """Commit and wait; tells whether the group has all."""
        # librdkafka's own synchronous commit waits for a broker without any limit.
        client, health = self._client.consumer, self._client.health
        deadline_s, again_s = time.monotonic() + timeout_s, 0.0
        with contextlib.suppress(KafkaException):  # fatal for the client, and known
            client.pause(client.assignment())
        while self.uncommitted and (now_s := time.monotonic()) < deadline_s:
            if now_s >= again_s and not self._unanswered:
                if health.away:
                    health.ask(client, self.topic, min(_LAST_LOOK_S, deadline_s - now_s))
                self.commit()
                again_s = now_s + _AGAIN_S
            with contextlib.suppress(KafkaException):  # fatal for the client, and known
                client.poll(0.05)
        return not self.uncommitted

    def commit_within(self, within_s: float, offsets: Mapping[int, int]) -> None:
        """Commit these, and wait until the group has them.

        Raises:
            KafkaException: It was refused, or took too long: then it may still be done.
        """
        try:
            self._client.commit(within_s, self._places(offsets))
        except KafkaException as error:
            if not self._note_refusal(error.args[0]):
                raise
            self._client.commit(within_s, self._places(offsets))

    def _places(self, offsets: Mapping[int, int]) -> list[TopicPartition]:
        metadata = self.metadata
        return [TopicPartition(self.topic, n, at, metadata(n)) for n, at in offsets.items()]

    def metadata(self, number: int) -> str:
        """What is committed beside an offset; of one that is not here, that of the others."""
        known = self._here.get(number) or next(iter(self), None)
        if known is None or known.of is None or not self._takes_metadata:
            return ''
        return known.of.metadata

    # 4. What the group answers

    def on_answer(self, error: KafkaError | None, answers: Sequence[TopicPartition]) -> None:
        """Take what became of a commit that was not waited for (librdkafka's `on_commit`)."""
        self._unanswered = max(0, self._unanswered - 1)
        if error is not None:
            self._note_refusal(error)
            self._log.warning('cannot commit now: %s', error.str())
            return
        self._client.health.on_contact()
        good = [answer for answer in answers if answer.error is None and answer.offset >= 0]
        self.note_committed({answer.partition: answer.offset for answer in good})

    def note_committed(self, offsets: Mapping[int, int]) -> None:
        """Note what the group has got; an answer may come when another reads on already."""
        for number, offset in offsets.items():
            if (partition := self._here.get(number)) is not None:
                partition.committed = offset

    def _note_refusal(self, error: KafkaError) -> bool:
        """Whether another commit may be taken: without metadata (offset.metadata.max.bytes)."""
        is_too_large = error.code() == KafkaError.OFFSET_METADATA_TOO_LARGE
        may_be_taken = is_too_large and self._takes_metadata
        self._takes_metadata = self._takes_metadata and not is_too_large
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


def _first(records: Sequence[_HasOffset], number: int) -> int:
    """The offset of the first of them in a partition."""
    return next(record.offset() or 0 for record in records if (record.partition() or 0) == number)
