"""The source of records on a real Kafka, where the broker deletes while it reads."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from confluent_kafka import Consumer, KafkaError, Producer, TopicPartition
from support.kafka.source_stubs import Nobody
from support.patience import patient
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.properties import consumer_properties
from ros2_kafka_bridge.kafka.topic_id import TopicIds

LOG = logging.LoggerAdapter(logging.getLogger('test.source'), {})


@contextlib.contextmanager
def opened(bench: Bench, topic: str) -> Iterator[KafkaSource]:
    """A source from the earliest record on that holds little which was fetched before."""
    small = {'queued.max.messages.kbytes': 64, 'max.partition.fetch.bytes': 16_384}
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    properties = consumer_properties({**servers, **small}, client_id='test', group='test')
    source = KafkaSource(properties, topic, 'earliest', TopicIds(servers), LOG)
    source.open(Nobody())
    try:
        yield source
    finally:
        source.close()


def trim(bench: Bench, topic: str) -> None:
    """Delete all that the topic holds now."""
    below = TopicPartition(topic, 0, -1)
    admin = bench.admin()  # kept: its futures fail when it goes
    admin.delete_records([below])[below].result(60)


def write(bench: Bench, topic: str, ended: threading.Event, sent: list[int]) -> None:
    """Write as fast as the broker takes it; `sent` gets how many."""
    with Producer({'bootstrap.servers': bench.bootstrap_servers, 'acks': 'all'}) as producer:
        count = 0
        while not ended.is_set():
            try:
                producer.produce(topic, b'x' * 100, partition=0)
                count += 1
            except BufferError:
                producer.poll(0.1)
        assert producer.flush(60) == 0
    sent.append(count)


def test_guarantee_1_what_is_deleted_faster_than_it_is_read_is_counted_once_and_said_rarely(
    bench: Bench, topic: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench.produce(topic, [b'first'])
    ended, sent = threading.Event(), [1]
    writer = threading.Thread(target=write, args=(bench, topic, ended, sent))

    def trim_often() -> None:
        while not ended.is_set():
            trim(bench, topic)

    trimmer = threading.Thread(target=trim_often)
    taken = 0

    def read(limit: int) -> None:
        nonlocal taken
        taken += len(source.poll(limit, 0.1))

    def read_to(end: int) -> bool:
        read(500)
        partition = source._offsets.get(0)  # none before it is assigned
        return partition is not None and partition.end == end

    with opened(bench, topic) as source:
        eventually(
            lambda: read_to(1), 30
        )  # what is deleted before a first start was never its own
        writer.start()
        trimmer.start()
        until_s = time.monotonic() + 6
        while time.monotonic() < until_s:
            read(20)  # slowly, so that the broker deletes what comes next
            time.sleep(0.01)
        taken_meanwhile = taken
        ended.set()
        for thread in (writer, trimmer):
            thread.join(patient(60))
            assert not thread.is_alive()
        end = sum(sent)
        assert bench.end_offset(topic) == end
        eventually(lambda: read_to(end), 60)
        assert taken + source.lost_upstream == end
    assert source.lost_upstream > 0
    assert taken_meanwhile > 1
    said = [record for record in caplog.records if 'were deleted before' in record.getMessage()]
    assert 1 <= len(said) <= 15


def poll_until_it_raises(consumer: Consumer, source: KafkaSource) -> None:
    """For a minute at most."""
    deadline_s = time.monotonic() + patient(60)
    while time.monotonic() < deadline_s:
        consumer.poll(0.1)
        source.poll(500, 0.1)


def test_a_source_whose_name_in_the_group_was_taken_closes_and_reads_on_when_opened_again(
    bench: Bench, topic: str, unique: Callable[[str], str]
) -> None:
    """As when a broker dies between taking a member in and telling it, and the next one, too."""
    bench.produce(topic, [b'first'])
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    properties = consumer_properties(servers, client_id='test', group=unique('group'))
    source = KafkaSource(properties, topic, 'earliest', TopicIds(servers), LOG)
    source.open(Nobody())
    taken: list[bytes | None] = []

    def read(count: int) -> bool:
        taken.extend(record.value() for record in source.poll(500, 0.1))
        return len(taken) >= count

    eventually(lambda: read(1), 30)
    source.advance({0: 1})
    assert source.commit_now(20)
    source._member._anew_at_s = time.monotonic()
    with contextlib.closing(Consumer(source._member._properties)) as usurper:
        usurper.subscribe([topic])
        with pytest.raises(RouteError, match='taken a late request for another member'):
            poll_until_it_raises(usurper, source)
        source.close()
    bench.produce(topic, [b'second'])
    taken.clear()
    source.open(Nobody())
    eventually(lambda: read(1), 60)
    source.close()
    assert taken == [b'second']


def is_shut_out(source: KafkaSource, usurper: Consumer) -> None:
    """Let another client take its name in the group."""
    usurper.subscribe([source._topic])
    eventually(lambda: bool(usurper.poll(0.1)) or bool(usurper.assignment()), 60)


def forgets_all_brokers(source: KafkaSource, _: Consumer) -> None:
    source._health.has_lost_brokers = True


@pytest.mark.parametrize('useless', [is_shut_out, forgets_all_brokers])
def test_a_client_of_no_use_has_another_and_what_was_confirmed_does_not_come_again(
    bench: Bench,
    topic: str,
    unique: Callable[[str], str],
    useless: Callable[[KafkaSource, Consumer], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench.produce(topic, [b'first', b'second'])
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    group = unique('group')
    source = KafkaSource(
        consumer_properties(servers, client_id='test', group=group),
        topic,
        'earliest',
        TopicIds(servers),
        LOG,
    )
    taken: list[bytes | None] = []

    def read(count: int) -> bool:
        taken.extend(record.value() for record in source.poll(500, 0.1))
        return len(taken) >= count

    source.open(Nobody())
    eventually(lambda: read(2), 60)
    source.advance({0: 1})
    assert source.commit_now(20)
    source._health.on_error(KafkaError(KafkaError._ALL_BROKERS_DOWN))
    source.advance({0: 2})
    source.commit()  # which Kafka is not told: it is away
    assert bench.committed(group, topic) == 1
    with contextlib.closing(Consumer(source._member._properties)) as usurper:
        useless(source, usurper)
        eventually(lambda: not read(3) and 'begins anew with another' in caplog.text, 60)
    bench.produce(topic, [b'third'])
    eventually(lambda: read(3), 60)
    source.advance({0: 3})
    eventually(lambda: source.commit_now(20), 60)
    source.close()
    assert taken == [b'first', b'second', b'third']
    assert bench.committed(group, topic) == 3


def poll_on(source: KafkaSource) -> None:
    """For a minute, or until it fails."""
    until_s = time.monotonic() + 60
    while time.monotonic() < until_s:
        source.poll(500, 0.1)


def test_a_client_that_does_not_read_what_its_partition_holds_is_given_up(
    bench: Bench, topic_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it was seen with a topic whose leader was not known yet: no error, and no records."""
    bench.create_topic(topic_name, partitions=2)
    bench.produce(topic_name, [b'first'], partition=0)
    taken: list[bytes | None] = []

    def read(count: int) -> bool:
        taken.extend(record.value() for record in source.poll(500, 0.1))
        return len(taken) >= count

    with opened(bench, topic_name) as source:
        eventually(lambda: read(1) and [part.end for part in source._offsets] == [1, 0], 30)
        # Only now: while it begins, a client may well be slower than that.
        monkeypatch.setattr('ros2_kafka_bridge.kafka.watchdog._STUCK_LOOK_S', 0.3)
        source._member._watchdog.begin()
        source.advance({0: 1})
        assert source.commit_now(patient(30))
        source._member.consumer.pause([TopicPartition(topic_name, 0)])
        bench.produce(topic_name, [b'second'], partition=0)
        with pytest.raises(RouteError, match='that the Kafka client does not read: begins anew'):
            poll_on(source)
    with opened(bench, topic_name) as source:
        eventually(lambda: read(2), 30)
    assert taken == [b'first', b'second']


def test_a_partition_that_ends_with_the_mark_of_a_transaction_is_read_to_its_end(
    bench: Bench, topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.kafka.watchdog._STUCK_LOOK_S', 1.0)
    with Producer(
        {'bootstrap.servers': bench.bootstrap_servers, 'transactional.id': topic}
    ) as producer:
        producer.init_transactions(30)
        producer.begin_transaction()
        producer.produce(topic, b'done')
        producer.commit_transaction(30)
        producer.begin_transaction()
        producer.produce(topic, b'not yet')
        producer.flush(30)
        with opened(bench, topic) as source:
            taken: list[bytes | None] = []
            until_s = time.monotonic() + 8
            while time.monotonic() < until_s:  # several looks, none of which finds it stuck
                taken += [record.value() for record in source.poll(500, 0.1)]
            producer.abort_transaction(30)
            until_s = time.monotonic() + 2
            while time.monotonic() < until_s:
                taken += [record.value() for record in source.poll(500, 0.1)]
    assert taken == [b'done']
