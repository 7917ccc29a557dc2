"""The records of one Kafka topic, read as a member of a group, and how many are still to be read.

Its place in the group is the matter of `member`; where its partitions stand, and what of that is
committed, that of `offsets`.
"""

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition

from ros2_kafka_bridge.endpoints import Rebalance, Record
from ros2_kafka_bridge.kafka.beginnings import Beginnings
from ros2_kafka_bridge.kafka.client_health import ClientHealth
from ros2_kafka_bridge.kafka.errors import Client, is_missing_topic, translated
from ros2_kafka_bridge.kafka.member import Member
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.partition import Partition
from ros2_kafka_bridge.kafka.properties import Membership, member_name
from ros2_kafka_bridge.kafka.topic_id import TopicIds
from ros2_kafka_bridge.kafka.topic_watch import TopicWatch
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.threads.wakeup import Wakeup

_REJOIN_MS: Final = 30_000
_EVERY_S: Final = 5.0
_FIRST_S: Final = 2.0  # mostly, reading has told by then
_LOOK_S: Final = 0.2


class Lag:
    """Counts what a reader has not read yet, also while it reads nothing.

    Args:
        offsets: Of the partitions that it has.
    """

    def __init__(self, offsets: Offsets) -> None:
        self._offsets = offsets
        self._look_at_s = time.monotonic() + _FIRST_S

    def count(self, client: Consumer, *, ask: bool) -> int | None:
        """How many records of the partitions come behind what has ended.

        Also those that a transaction without an end still holds back. None where it is not known
        of a partition how far it was read, or where it ends.

        Args:
            client: Of the reader.
            ask: Whether to ask the broker where partitions end, every few seconds: a client that
                does not read hears of it in no other way.
        """
        if ask or any(partition.next is None for partition in self._offsets):
            self._look(client, ends=ask)
        total = 0
        for partition in self._offsets:
            _, end = client.get_watermark_offsets(self._topic_partition(partition), cached=True)
            end = max(end, -1 if partition.told_end is None else partition.told_end)
            if end < 0 or partition.next is None:
                return None
            total += max(0, end - partition.next)
        return total

    def _look(self, client: Consumer, *, ends: bool) -> None:
        """Ask for what reading has not told: committed offsets, and `ends` if nothing is read.

        While something is, a question for ends would wait behind it.
        """
        now_s = time.monotonic()
        if now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _EVERY_S
        here = self._offsets
        unread = [self._topic_partition(partition) for partition in here if partition.next is None]
        with contextlib.suppress(KafkaException):  # the broker does not answer: the last ones hold
            if unread:
                told = client.committed(unread, timeout=_LOOK_S)
                here.note_committed({p.partition: p.offset for p in told if p.offset >= 0})
            for partition in here if ends else ():
                _, partition.told_end = client.get_watermark_offsets(
                    self._topic_partition(partition), timeout=_LOOK_S
                )

    def _topic_partition(self, partition: Partition) -> TopicPartition:
        return TopicPartition(self._offsets.topic, partition.number)


class KafkaSource:
    """A `RecordSource` on a real topic.

    Args:
        properties: librdkafka properties of a consumer with its group.
        topic: The topic to read.
        start: `latest` or `earliest`: where a topic begins that the group never read.
        ids: Tells whether the topic was made anew.
        log: Where to say what happens.
        membership: Of the group.
        wakeup: Ends a wait for records.
    """

    def __init__(
        self,
        properties: Mapping[str, Any],
        topic: str,
        start: str,
        ids: TopicIds,
        log: Log,
        membership: Membership = 'static',
        wakeup: Wakeup | None = None,
    ) -> None:
        # The group waits for so long for a member that does not join again.
        rejoin_ms = max(_REJOIN_MS, int(properties.get('session.timeout.ms', 0)))
        own = {
            'enable.partition.eof': True,
            'max.poll.interval.ms': rejoin_ms,
            **member_name(properties, membership),
        }
        properties = own | dict(properties)
        self._topic = topic
        self._about = Client('READ', properties)
        self._health = ClientHealth(f'topic {topic}', log, self._about, reads=True)
        self._offsets = Offsets(topic, log)
        self._beginnings = Beginnings(start, self._offsets, log)
        self._lag = Lag(self._offsets)
        on_new = self._beginnings.expect_new_topic
        watch = TopicWatch(ids, self._offsets, log, on_new)
        self._member = Member(
            properties, self._offsets, watch, self._health, log, wakeup or Wakeup()
        )

    @property
    def lost_upstream(self) -> int:
        """Records that the topic no longer held when the bridge came to read them."""
        return self._beginnings.lost

    @property
    def rebalances(self) -> int:
        """How often partitions came or went."""
        return self._member.rebalances

    @property
    def away(self) -> str:
        """Why nothing can be read just now; empty when all is well."""
        return self._member.away

    @property
    def held_back(self) -> str:
        """Why Kafka gives out nothing, though it is there; empty where it does."""
        return self._member.held_back

    @property
    def reached(self) -> bool:
        """Whether Kafka has ever answered."""
        return self._health.reached

    @property
    def answers(self) -> bool | None:
        """Whether it does now, though it may not let this bridge into its group."""
        return self._member.is_answered

    def open(self, rebalance: Rebalance) -> None:
        """Join the group.

        Raises:
            RouteError: librdkafka refuses the properties.
        """
        with self._translated():
            self._member.join(rebalance)

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Wait up to `timeout_s` for the first record, then return what is there.

        Raises:
            RouteError: The client is of no use any more.
        """
        with self._translated():
            self._member.read_on()
            return self._read(limit, timeout_s)

    def stay(self) -> Sequence[Record]:
        """Stay a member of the group without reading on; rarely a few records still come.

        Raises:
            RouteError: The client is of no use any more.
        """
        with self._translated():
            self._member.pause()
            return self._read(1, 0.0)

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note the next offset to read of partitions: all before it have ended."""
        self._offsets.advance(positions)

    def commit(self) -> None:
        """Commit how far each partition has come, without waiting for it."""
        self._offsets.commit()

    def commit_now(self, timeout_s: float) -> bool:
        """Commit and wait; False when it was not confirmed in time, or the partitions are lost.

        At a stop: Kafka deletes the offsets of the group with a topic, and without one the next
        run would begin where `start` says.
        """
        if timeout_s > 0 and self._member.is_topic_replaced(at_once=True):
            self._member.forget_old_topic()
        return self._offsets.commit_now(timeout_s) and not self._member.is_outside

    def lag(self) -> int | None:
        """How many records of the partitions come behind what has ended.

        None where that is not known: without a place in the group, while Kafka is away or lets
        the client wait, and of partitions that have not answered yet or whose leader is away.

        Raises:
            RouteError: The client is of no use any more.
        """
        if not (self._member.is_in_group and self._member.hears_ends):
            return None
        with self._translated():
            return self._lag.count(self._member.consumer, ask=self._member.is_paused)

    def close(self) -> None:
        """Leave the group; what is to be committed has been."""
        self._member.leave()

    def _translated(self) -> contextlib.AbstractContextManager[None]:
        return translated(f'topic {self._topic}', self._about)

    def _read(self, limit: int, timeout_s: float) -> Sequence[Record]:
        # consume() waits its whole timeout unless all `limit` records come; poll() does not.
        first = self._member.poll(timeout_s)
        if first is None:
            return ()
        batch, partition = [first], self._offsets.get(first.partition())
        if limit > 1:
            batch += self._member.consumer.consume(limit - 1, 0.0)
            if self._offsets.get(first.partition()) is not partition:
                del batch[0]  # handed over meanwhile
        errors = [message.error() for message in batch]
        if self._offsets.are_cut_off or any(errors):
            batch = self._records(batch)
        else:
            self._offsets.hand_out(batch)
            self._health.on_contact()
        # The stubs do not tell that headers are a list; they are.
        return cast('Sequence[Record]', batch)

    def _records(self, batch: list[Message]) -> list[Message]:
        """Pick the records out of what the client tells in their midst, and act on the rest."""
        records = [message for message in batch if message.error() is None]
        # First: a partition is at its end only where these have ended, too.
        self._offsets.hand_out(records)
        client = self._member.consumer
        for message in batch:
            if self._member.consumer is not client:
                return []  # it has left a topic that is gone: nothing of that counts any more
            error = message.error()
            if error is None:
                self._health.on_contact()
                self._note_reached(message)
            else:
                self._take_event(message, error)
        return records if self._member.consumer is client else []

    def _take_event(self, message: Message, error: KafkaError) -> None:
        number, offset = message.partition() or 0, message.offset()
        if error.code() == KafkaError._AUTO_OFFSET_RESET:  # noqa: SLF001 (its public name)
            if number in self._offsets:
                self._set_beginning(self._offsets[number], offset)
        elif error.code() == KafkaError._PARTITION_EOF:  # noqa: SLF001
            self._health.on_contact()
            self._note_reached(message)
            if offset is not None:
                self._offsets.reach_end(number, offset)
        elif error.code() != KafkaError._MAX_POLL_EXCEEDED:  # noqa: SLF001
            if is_missing_topic(error):
                self._beginnings.expect_new_topic()
            self._member.client.on_error(error)
            self._health.raise_failure()

    def _note_reached(self, message: Message) -> None:
        number = message.partition() or 0
        if number in self._offsets and self._offsets[number].wanted is not None:
            self._beginnings.on_reached(
                self._member.consumer, self._offsets[number], message.offset() or 0
            )

    def _set_beginning(self, partition: Partition, wanted: int | None) -> None:
        """Set where to read a partition whose stored offset is missing or out of range."""
        member = self._member
        if wanted is not None and member.leave_old_topic(at_once=True):
            return
        with translated(f'{self._topic}[{partition.number}]', self._about):
            partition.end = None
            beginning = self._beginnings.find(member.consumer, partition, wanted)
            if beginning.anew:
                member.begin_anew_at(partition.number, beginning.offset)
            else:
                member.begin_at(partition.number, beginning.offset)
