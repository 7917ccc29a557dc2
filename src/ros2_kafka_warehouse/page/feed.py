"""Kafka in: the newest snapshots and all events, again and again found after an interruption."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterable
from typing import Any, Final

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, TopicPartition

from ros2_kafka_warehouse.page.view import View
from ros2_kafka_warehouse.topics import KAFKA

_LOG: Final = logging.getLogger(__name__)

_TOPICS: Final = frozenset(topic.name for topic in KAFKA)
_SNAPSHOTS: Final = frozenset(topic.name for topic in KAFKA if topic.compacted)

# librdkafka's OFFSET_TAIL(n) is -2000 - n. The last offsets may be markers of transactions.
_NEWEST: Final = -2000 - 10
_LAST_OF_STREAM: Final = -2000 - 50_000  # a long history is not read from its beginning
_POLL_S = 0.05
_BATCH = 500
_LOOK_AGAIN_S = 2.0
_SELDOM_S = 30.0
_SILENT_S = 3.0


class Feed:
    """Reads the topics of the warehouse into a view, without a consumer group's memory.

    Partitions of topics that are made later are found within some seconds.

    Args:
        bootstrap_servers: Of Kafka.
        view: Takes the records, in the thread of the event loop.

    Attributes:
        worked_s: When it last asked for records, by the monotonic clock.
    """

    def __init__(self, bootstrap_servers: str, view: View) -> None:
        self._view = view
        self._away = 'not reached yet'
        self._known: set[tuple[str, int]] = set()
        self._complained: set[tuple[str, type[Exception]]] = set()
        self.worked_s = time.monotonic()
        self._consumer = Consumer(
            {
                'bootstrap.servers': bootstrap_servers,
                'group.id': 'warehouse-page',  # asked for by the client; nothing is committed
                'enable.auto.commit': False,
                'enable.auto.offset.store': False,
                'auto.offset.reset': 'earliest',  # a topic that was made anew
                'fetch.wait.max.ms': 50,  # the embedded broker waits this long in any case
                'reconnect.backoff.max.ms': 1000,
                'allow.auto.create.topics': False,
                'log_level': 0,  # the page itself says when Kafka is away
                'error_cb': self._on_error,
            }
        )

    @property
    def away(self) -> str:
        """Why Kafka does not answer, or ''."""
        return self._away

    async def run(self, stopping: Callable[[], bool]) -> None:
        """Read until told to stop."""
        looked_s = heard_s = 0.0
        while not stopping():
            self.worked_s = now_s = time.monotonic()
            if now_s - looked_s > self._look_again_s(now_s - heard_s):
                looked_s = now_s
                await asyncio.to_thread(self._find_partitions)
            records = await asyncio.to_thread(self._consumer.consume, _BATCH, _POLL_S)
            if self._take(records):
                heard_s = time.monotonic()
                self._away = ''
        await asyncio.to_thread(self._consumer.close)

    def _look_again_s(self, silent_s: float) -> float:
        complete = {name for name, _ in self._known} == _TOPICS
        return _SELDOM_S if complete and silent_s < _SILENT_S else _LOOK_AGAIN_S

    def _find_partitions(self) -> None:
        """Assign what is new, and learn on the way whether Kafka answers."""
        try:
            topics = self._consumer.list_topics(timeout=1.5).topics
        except KafkaException as error:
            self._away = self._away or error.args[0].str()
            return
        self._away = ''
        wanted = _TOPICS & topics.keys()
        found = {(name, number) for name in wanted for number in topics[name].partitions}
        new = sorted(found - self._known)
        if new:
            self._consumer.incremental_assign([_from_where(*place) for place in new])
            self._known.update(new)

    def _take(self, records: Iterable[Message]) -> int:
        """Hand on all events, and of each snapshot the newest; says how many records came."""
        count, newest = 0, dict[str, Message]()
        for record in records:
            topic = record.topic()
            if record.error() is not None or topic is None:
                continue
            count += 1
            if topic in _SNAPSHOTS:
                newest[topic] = record
            else:
                self._hand_on(topic, record)
        for topic, record in newest.items():
            self._hand_on(topic, record)
        return count

    def _hand_on(self, topic: str, record: Message) -> None:
        now_s = time.time()
        _, made_ms = record.timestamp()
        made_s = made_ms / 1000 if made_ms > 0 else now_s
        try:
            self._view.take(topic, record.value(), now_s, made_s)
        except Exception as error:  # noqa: BLE001 (whatever anybody has put into Kafka)
            # Read again after a restart, it would end the page again, for as long as Kafka has it.
            self._view.leave_out()
            self._complain(topic, record, error)

    def _complain(self, topic: str, record: Message, error: Exception) -> None:
        """Say it once: what is wrong with a snapshot may be wrong with each one that follows."""
        kind = (topic, type(error))
        if kind not in self._complained:
            self._complained.add(kind)
            where = f'{topic}, partition {record.partition()}, offset {record.offset()}'
            _LOG.error('cannot show a record of %s', where, exc_info=error)

    def _on_error(self, error: KafkaError) -> None:
        if error.code() == KafkaError._ALL_BROKERS_DOWN:  # noqa: SLF001 (so is it spelled)
            self._away = error.str()


def _from_where(topic: str, partition: int) -> Any:
    offset = _NEWEST if topic in _SNAPSHOTS else _LAST_OF_STREAM
    return TopicPartition(topic, partition, offset)
