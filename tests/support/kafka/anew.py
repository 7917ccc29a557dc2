"""A source of records alone, and topics that are made anew while it reads, or does not."""

import contextlib
import logging
from collections.abc import Iterator, Mapping
from typing import Any, Self

import pytest
from confluent_kafka import Consumer, KafkaException, Producer, TopicPartition
from support.kafka.source_stubs import Nobody
from support.patience import patient
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.properties import common_properties, consumer_properties
from ros2_kafka_bridge.kafka.topic_id import TopicId, TopicIds

LOG = logging.LoggerAdapter(logging.getLogger('test.anew'), {})


class Reader:
    """A source that confirms whatever it reads at once.

    Args:
        bench: Where its Kafka is.
        topic: That it reads.
        start: Where it begins at first.
        ids: Whom it asks whether the topic was made anew.
        more: Properties of its client.
    """

    def __init__(
        self,
        bench: Bench,
        topic: str,
        start: str,
        ids: type[TopicIds] = TopicIds,
        **more: Any,
    ) -> None:
        users = {'bootstrap.servers': bench.bootstrap_servers, **more}
        properties = consumer_properties(users, client_id='test', group=topic)
        asked = ids(common_properties(users, client_id='test'))
        self.source = KafkaSource(properties, topic, start, asked, LOG, 'dynamic')
        self.values: list[str] = []
        self.is_dead = False

    def __enter__(self) -> Self:
        self.source.open(Nobody())
        return self

    def __exit__(self, *_: object) -> None:
        if not self.is_dead:
            self.source.commit_now(10.0)
            self.source.close()

    def die(self) -> None:
        """End without another word to the group than that it has gone."""
        self.source._member.consumer.close()
        self.is_dead = True

    def read(self, *, pausing: bool = False) -> None:
        try:
            records = self.source.stay() if pausing else self.source.poll(500, 0.05)
        except RouteError:  # as a route does, whose client has not found the leader of a new topic
            self.source.close()
            self.source.open(Nobody())
            return
        for record in records:
            self.values.append((record.value() or b'').decode())
            self.source.advance({record.partition() or 0: (record.offset() or 0) + 1})
        self.source.commit()

    def until(self, count: int) -> list[str]:
        """Read until it has so many that differ, and is through."""

        def has_all() -> bool:
            self.read()
            return len(set(self.values)) >= count and self.source.lag() == 0

        eventually(has_all, 60, lambda: str(self.values))
        return self.values


def texts(kind: str, counts: Mapping[int, int]) -> list[str]:
    return sorted(f'{kind} {p}.{n}' for p, count in counts.items() for n in range(count))


def fill(bench: Bench, topic: str, kind: str, counts: Mapping[int, int]) -> list[str]:
    # One that has written to the old topic knows the number of its partitions for a while.
    producer = Producer({'bootstrap.servers': bench.bootstrap_servers})
    for number, count in counts.items():
        for n in range(count):
            producer.produce(topic, f'{kind} {number}.{n}'.encode(), partition=number)
    assert producer.flush(30) == 0
    return texts(kind, counts)


def make_anew(bench: Bench, topic: str, partitions: int = 1) -> None:
    """Delete a topic and make it again, within a moment."""
    admin = bench.admin()
    admin.delete_topics([topic])[topic].result(patient(60))

    def made() -> bool:
        try:
            bench.create_topic(topic, partitions=partitions)
        except KafkaException:
            return False
        return True

    eventually(made, 30)


def topic_id(bench: Bench, topic: str) -> TopicId:
    ids = TopicIds({'bootstrap.servers': bench.bootstrap_servers})
    found = ids.answer(ids.ask(topic), patient(30))
    assert found is not None
    return found


def reads_group(reader: Reader, caplog: pytest.LogCaptureFixture) -> None:
    def begun() -> bool:
        reader.read()
        return 'first start of this group' in caplog.text

    eventually(begun, 60)


@contextlib.contextmanager
def reading_old(bench: Bench, topic: str, caplog: pytest.LogCaptureFixture) -> Iterator[Reader]:
    """A reader that has read the 20 records of a topic, from the latest on."""
    bench.create_topic(topic)
    with Reader(bench, topic, 'latest') as reader:
        reads_group(reader, caplog)
        reader.until(len(fill(bench, topic, 'old', {0: 20})))
        yield reader


def consumer(bench: Bench, group: str) -> Consumer:
    return Consumer({'bootstrap.servers': bench.bootstrap_servers, 'group.id': group})


def committed(bench: Bench, topic: str) -> TopicPartition:
    """What the group of a reader has."""
    with contextlib.closing(consumer(bench, topic)) as asking:
        return asking.committed([TopicPartition(topic, 0)], timeout=patient(30))[0]
