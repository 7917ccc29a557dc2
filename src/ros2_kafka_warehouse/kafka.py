"""Kafka, for the warehouse: its topics, sending to them, and reading what they hold."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, Self, TypeVar

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, Producer, TopicPartition
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    NewTopic,
    OffsetSpec,
)

from ros2_kafka_bridge.kafka.ranges import READING, Place, RangeReader, held
from ros2_kafka_warehouse.topics import KAFKA, KafkaTopic

_Answer = TypeVar('_Answer')

_REQUEST_S: Final = 5.0
_AGAIN_S: Final = 1.0
_BEGIN_S: Final = 30.0
_LOOK_S: Final = 0.5
# Snapshots replace each other: of the old ones Kafka is to keep little.
_COMPACTED: Final = {
    'cleanup.policy': 'compact,delete',
    'retention.ms': '86400000',
    'segment.bytes': '16777216',
    'min.cleanable.dirty.ratio': '0.1',
    'max.message.bytes': '4000000',  # as in data/bridge.yaml
}
_DAY_MS: Final = 86_400_000
# The events of an order must outlive its request, or it would come back when `orders` starts.
_KEPT: Final = {
    'warehouse.orders': {'retention.ms': str(7 * _DAY_MS), 'segment.ms': str(_DAY_MS)},
    'warehouse.order-events': {'retention.ms': str(14 * _DAY_MS), 'segment.ms': str(_DAY_MS)},
}


class AwayError(Exception):
    """No broker answers; says where and what to look at."""


def create_topics(bootstrap_servers: str) -> None:
    """Create the topics of the warehouse that are not there, and wait until they take records.

    Each has one partition.

    Raises:
        AwayError: The broker does not answer, or refuses.
    """
    admin = AdminClient(_client(bootstrap_servers))
    new = [NewTopic(topic.name, num_partitions=1, config=_config(topic)) for topic in KAFKA]
    answers = admin.create_topics(new, request_timeout=_REQUEST_S)
    made = []
    for name, answer in answers.items():
        try:
            answer.result()
            made.append(name)
        except KafkaException as error:
            if error.args[0].code() != KafkaError.TOPIC_ALREADY_EXISTS:
                raise AwayError(
                    f'{bootstrap_servers}: topic {name} cannot be created '
                    f'({error.args[0].str()}): does the broker run, may this user create topics?'
                ) from error
    for name in made:
        _wait_until_it_answers(admin, bootstrap_servers, name)


def _wait_until_it_answers(admin: AdminClient, bootstrap_servers: str, topic: str) -> None:
    """A partition that just begins may refuse a producer's first record and take its second."""
    where = TopicPartition(topic, 0)
    end = OffsetSpec.latest()  # type: ignore[no-untyped-call]
    deadline_s = time.monotonic() + _BEGIN_S
    while True:
        asked = admin.list_offsets({where: end}, request_timeout=_REQUEST_S)
        try:
            asked[where].result()
        except KafkaException as error:
            if time.monotonic() > deadline_s:
                raise AwayError(
                    f'{bootstrap_servers}: topic {topic} was created and does not answer '
                    f'({error.args[0].str()}): has its partition a leader?'
                ) from error
            time.sleep(_LOOK_S)
        else:
            return


def _config(topic: KafkaTopic) -> dict[str, str]:
    return _COMPACTED if topic.compacted else _KEPT.get(topic.name, {})


def ask_for_topics(bootstrap_servers: str) -> None:
    """Make the topics at the embedded broker, which makes each when it is asked for.

    Those of the dead letters, too: the bridge cannot make them there.
    """
    admin = AdminClient(_client(bootstrap_servers))
    for topic in KAFKA:
        for name in (topic.name, f'{topic.name}.dead-letters'):
            admin.list_topics(name, timeout=_REQUEST_S)


class Sender:
    """Sends records; each is at the broker when its `with` has ended."""

    def __init__(self, bootstrap_servers: str) -> None:
        self._bootstrap_servers = bootstrap_servers
        self._producer = Producer({**_client(bootstrap_servers), 'enable.idempotence': True})
        self._failed = ''

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.flush()

    def send(self, topic: str, key: str, value: str) -> None:
        """Send a record; those of one key stay in order."""
        while True:
            try:
                self._producer.produce(topic, value, key, on_delivery=self._delivered)
                self._producer.poll(0)
            except BufferError:
                self._producer.poll(0.1)
            else:
                return

    def serve(self, timeout_s: float) -> None:
        """Wait, and send what waits meanwhile."""
        self._producer.poll(timeout_s)
        time.sleep(timeout_s)

    def flush(self, timeout_s: float = 30.0) -> None:
        """Wait until all is there.

        Raises:
            AwayError: The broker has not taken all in time.
        """
        left = self._producer.flush(timeout_s)
        if left or self._failed:
            why = self._failed or 'no answer'
            raise AwayError(
                f'{self._bootstrap_servers} has not taken all records, {left} are left ({why})'
            )

    def _delivered(self, error: KafkaError | None, _message: Message) -> None:
        if error is not None:
            self._failed = error.str()


class Memory:
    """Reads topics from their beginning; nothing is committed, it belongs to no group.

    Args:
        bootstrap_servers: Of Kafka.
        topics: Their names.
        log: Where to say that Kafka is away.
        stopped: Says that the reading is to end.
        group: Whose position `committed` tells.
    """

    def __init__(
        self,
        bootstrap_servers: str,
        topics: Sequence[str],
        log: logging.Logger,
        stopped: Callable[[], bool] = lambda: False,
        group: str = 'warehouse-memory',
    ) -> None:
        self._servers = bootstrap_servers
        self._topics = topics
        self._log = log
        self._stopped = stopped
        self._consumer = Consumer(
            {
                **_client(bootstrap_servers),
                'group.id': group,  # asked for by the client, and never joined
                'enable.auto.commit': False,
                **READING,
                'fetch.wait.max.ms': 50,  # the embedded broker answers no sooner
                'queued.max.messages.kbytes': 8192,
            }
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._consumer.close()

    def replay(self) -> Iterator[Message]:
        """All records up to the end as it is now; waits while Kafka is away."""
        there = self._retried(self._held) or {}
        yield from self._read(there)
        self._consumer.assign([TopicPartition(*at, offsets.stop) for at, offsets in there.items()])

    def follow(self, topic: str) -> Iterator[Message]:
        """What comes to one of the topics after the replay, until stopped."""
        mine = [at for at in self._consumer.assignment() if at.topic == topic]
        self._consumer.incremental_unassign(
            [at for at in self._consumer.assignment() if at.topic != topic]
        )
        assert mine, f'{topic} has been replayed'
        while not self._stopped():
            message = self.poll(_LOOK_S)
            if message is not None and message.topic() == topic:
                yield message

    def poll(self, timeout_s: float) -> Message | None:
        """What comes next to the topics after the replay, if it comes in time."""
        message = self._consumer.poll(timeout_s)
        return None if message is None or message.error() is not None else message

    def last(self) -> bytes | None:
        """The value of the newest record of the topics, if there is one."""
        there = self._retried(self._held) or {}
        records = self._read({at: offsets[-1:] for at, offsets in there.items()})
        newest = max(records, key=lambda record: record.timestamp()[1], default=None)
        return None if newest is None else newest.value()

    def committed(self, topic: str) -> dict[int, int]:
        """How far the group has read each partition; 0 where it has not."""

        def ask() -> dict[int, int]:
            places = [TopicPartition(*at) for at in held(self._consumer, topic, _REQUEST_S)]
            found = self._consumer.committed(places, timeout=_REQUEST_S)
            return {at.partition: max(0, at.offset) for at in found}

        return self._retried(ask) or {}

    def _held(self) -> dict[Place, range]:
        """Which offsets each partition holds now."""
        offsets: dict[Place, range] = {}
        for topic in self._topics:
            offsets |= held(self._consumer, topic, _REQUEST_S)
        return offsets

    def _read(self, ranges: Mapping[Place, range]) -> Iterator[Message]:
        reader = RangeReader(self._consumer, ranges, stopped=self._stopped)
        while reader.left and not self._stopped():
            try:
                yield from reader
            except KafkaException as error:
                self._wait(error)

    def _retried(self, ask: Callable[[], _Answer]) -> _Answer | None:
        while not self._stopped():
            try:
                return ask()
            except KafkaException as error:
                self._wait(error)
        return None

    def _wait(self, error: KafkaException) -> None:
        self._log.warning('waits for Kafka at %s: %s', self._servers, error.args[0].str())
        time.sleep(_AGAIN_S)


def committed(
    bootstrap_servers: str,
    group: str,
    topic: str,
    log: logging.Logger,
    stopped: Callable[[], bool],
) -> dict[int, int]:
    """How far a group has read each partition of a topic; waits while Kafka is away."""
    with Memory(bootstrap_servers, [topic], log, stopped, group) as memory:
        return memory.committed(topic)


def newest(
    bootstrap_servers: str, topic: str, log: logging.Logger, stopped: Callable[[], bool]
) -> bytes | None:
    """The value of the newest record of a topic; waits while Kafka is away."""
    with Memory(bootstrap_servers, [topic], log, stopped) as memory:
        return memory.last()


def _client(bootstrap_servers: str) -> dict[str, str | int | float | bool]:
    return {
        'bootstrap.servers': bootstrap_servers,
        'reconnect.backoff.max.ms': 1000,
        'topic.metadata.refresh.interval.ms': 5000,
        'log_level': 2,  # what is wrong is said by those who wait
    }
