"""Topics that are made anew while a source reads them, or nobody does; and those of elsewhere."""

import contextlib
import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import ConsumerGroupTopicPartitions, TopicPartition
from support.kafka.anew import (
    Reader,
    committed,
    consumer,
    fill,
    make_anew,
    reading_old,
    reads_group,
    topic_id,
)
from support.patience import patient
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.kafka.topic_id import Question, TopicId, TopicIds
from ros2_kafka_bridge.testing.local_kafka import QUICK_RETURN, LocalKafka


@pytest.fixture(autouse=True)
def _said(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, 'test.anew')


COUNTS = [
    pytest.param({0: 20}, {0: 5}, 'latest', id='fewer'),
    pytest.param({0: 20}, {0: 20}, 'latest', id='as many'),
    pytest.param({0: 20}, {0: 50}, 'latest', id='more'),
    pytest.param({0: 20}, {0: 50}, 'earliest', id='more from the earliest on'),
    pytest.param({0: 20, 1: 3, 2: 0}, {0: 3, 1: 20, 2: 1}, 'latest', id='several partitions'),
    pytest.param({0: 20}, {0: 20, 1: 7, 2: 30}, 'latest', id='more partitions'),
    pytest.param({0: 20, 1: 20, 2: 20}, {0: 30}, 'latest', id='fewer partitions'),
]
CLASSIC: dict[str, Any] = {}
KIP_848 = {'group.protocol': 'consumer'}


@pytest.mark.parametrize('protocol', [CLASSIC, KIP_848], ids=['classic', 'consumer'])
@pytest.mark.parametrize(('old', 'new', 'start'), COUNTS)
def test_guarantee_1_a_topic_made_anew_is_read_from_its_beginning(
    bench: Bench,
    topic_name: str,
    caplog: pytest.LogCaptureFixture,
    old: Mapping[int, int],
    new: Mapping[int, int],
    start: str,
    protocol: dict[str, Any],
) -> None:
    bench.create_topic(topic_name, partitions=len(old))
    with Reader(bench, topic_name, start, **protocol) as reader:
        reads_group(reader, caplog)
        was = fill(bench, topic_name, 'old', old)
        assert sorted(reader.until(len(was))) == was
        before = topic_id(bench, topic_name)
        make_anew(bench, topic_name, len(new))
        now = fill(bench, topic_name, 'new', new)
        reader.values.clear()
        got = reader.until(len(now))
    assert sorted(set(got)) == now
    assert caplog.text.count(f'{topic_name} was made anew') == 1
    assert before.topic_id in caplog.text
    with Reader(bench, topic_name, start, **protocol) as reader:  # all is committed
        later = fill(bench, topic_name, 'later', {0: 2})
        assert reader.until(2) == later


class Unseen(TopicIds):
    """A cluster that tells which topic it is once, and then never again."""

    told = 0

    def ask(self, topic: str) -> Question | None:
        self.told += 1
        return super().ask(topic) if self.told == 1 else None


def test_guarantee_1_what_is_committed_to_a_topic_made_anew_unseen_counts_no_more_over_a_stop(
    bench: Bench, topic: str, caplog: pytest.LogCaptureFixture
) -> None:
    """The bridge ends, or is killed, before it has noticed; the group has an offset of the new."""
    with Reader(bench, topic, 'latest', ids=Unseen) as reader:
        reads_group(reader, caplog)
        reader.until(len(fill(bench, topic, 'old', {0: 20})))
        make_anew(bench, topic)
        now = fill(bench, topic, 'new', {0: 50})
        assert len(reader.until(50)) == 50, '20 of the old one, and 30 of the new'
    assert committed(bench, topic).offset == 50
    with Reader(bench, topic, 'latest') as reader:
        assert sorted(reader.until(50)) == now
    assert f'{topic} was made anew' in caplog.text
    assert topic_id(bench, topic) == TopicId.of_metadata(committed(bench, topic).metadata)


def test_guarantee_1_a_reader_that_has_not_noticed_spoils_nothing_for_the_other(
    bench: Bench, topic_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench.create_topic(topic_name, partitions=2)
    with Reader(bench, topic_name, 'latest', ids=Unseen) as blind:
        reads_group(blind, caplog)
        with Reader(bench, topic_name, 'latest') as reader:

            def both_read(count: int) -> bool:
                blind.read()
                reader.read()
                return len(blind.values) + len(reader.values) >= count

            eventually(lambda: both_read(0) and reads_one(topic_name, caplog), 60)
            was = fill(bench, topic_name, 'old', {0: 20, 1: 20})
            eventually(lambda: both_read(len(was)), 60)
            make_anew(bench, topic_name, 2)
            now = fill(bench, topic_name, 'new', {0: 30, 1: 30})
            # One reads all 30 of a partition, the other the 10 behind those that it knows.
            eventually(lambda: both_read(len(was) + 40), 60)
    with Reader(bench, topic_name, 'latest') as last:
        last.until(30)
    assert set(now) <= {*blind.values, *reader.values, *last.values}


def reads_one(topic: str, caplog: pytest.LogCaptureFixture) -> bool:
    """Whether a second reader has got its partition."""
    return f'reads {topic}[0]' in caplog.text or f'reads {topic}[1]' in caplog.text


def test_guarantee_1_a_topic_made_anew_while_nothing_is_read_is_read_from_its_beginning(
    bench: Bench, topic_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with reading_old(bench, topic_name, caplog) as reader:
        reader.read(pausing=True)
        make_anew(bench, topic_name)
        now = fill(bench, topic_name, 'new', {0: 20})

        def noticed() -> bool:
            reader.read(pausing=True)
            return f'{topic_name} was made anew' in caplog.text

        eventually(noticed, 60)
        reader.values.clear()
        assert sorted(set(reader.until(20))) == now


def test_guarantee_1_a_topic_made_anew_again_and_again_is_read_each_time(
    bench: Bench, topic_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with reading_old(bench, topic_name, caplog) as reader:
        for kind in 'abc':
            reader.values.clear()
            make_anew(bench, topic_name)
            now = fill(bench, topic_name, kind, {0: 20})
            reader.until(20)
            assert set(now) <= set(reader.values)


@pytest.mark.parametrize(('metadata', 'first'), [
    pytest.param('', 15, id='as Kafka\'s own tools commit'),
    pytest.param('anything', 15, id='of somebody else'),
    pytest.param('{"cluster_id":"elsewhere","topic_id":"another"}', 15, id='of another cluster'),
    pytest.param('{"cluster_id":"$","topic_id":"another"}', 0, id='of a topic that is gone'),
])  # fmt: skip
def test_guarantee_1_an_offset_counts_but_for_one_of_a_topic_that_is_gone(
    bench: Bench, topic: str, caplog: pytest.LogCaptureFixture, metadata: str, first: int
) -> None:
    fill(bench, topic, 'new', {0: 20})
    metadata = metadata.replace('$', topic_id(bench, topic).cluster_id)
    places = [TopicPartition(topic, 0, 15, metadata)]
    with contextlib.closing(consumer(bench, topic)) as tool:
        tool.commit(offsets=places, asynchronous=False)
    with Reader(bench, topic, 'latest') as reader:
        assert reader.until(20 - first) == [f'new 0.{n}' for n in range(first, 20)]
    assert ('cluster elsewhere, and this is cluster' in caplog.text) == ('elsewhere' in metadata)


@pytest.mark.parametrize('offset', [0, 7, 20])
def test_guarantee_1_offsets_that_a_tool_has_set_are_obeyed(
    bench: Bench, topic_name: str, caplog: pytest.LogCaptureFixture, offset: int
) -> None:
    """Also those of a group that has read a topic which is gone by then."""
    with reading_old(bench, topic_name, caplog):
        pass
    make_anew(bench, topic_name)
    fill(bench, topic_name, 'new', {0: 20})
    places = ConsumerGroupTopicPartitions(topic_name, [TopicPartition(topic_name, 0, offset)])
    admin = bench.admin()
    admin.alter_consumer_group_offsets([places])[topic_name].result(patient(30))
    assert not committed(bench, topic_name).metadata
    with Reader(bench, topic_name, 'latest') as reader:
        later = fill(bench, topic_name, 'later', {0: 1})
        assert reader.until(21 - offset) == [*(f'new 0.{n}' for n in range(offset, 20)), *later]


@pytest.mark.parametrize('start', ['latest', 'earliest'])
def test_a_topic_made_anew_while_nobody_reads_it_begins_where_start_says(
    bench: Bench, topic: str, caplog: pytest.LogCaptureFixture, start: str
) -> None:
    """Kafka deletes the offsets of a group with the topic: nothing tells that it is not new."""
    with Reader(bench, topic, start) as reader:
        reads_group(reader, caplog)
        reader.until(len(fill(bench, topic, 'old', {0: 20})))
    make_anew(bench, topic)
    now = fill(bench, topic, 'new', {0: 50})
    assert committed(bench, topic).offset < 0
    caplog.clear()
    with Reader(bench, topic, start) as reader:
        reads_group(reader, caplog)
        later = fill(bench, topic, 'later', {0: 1})
        expected = [*now, *later] if start == 'earliest' else later
        assert sorted(reader.until(len(expected))) == sorted(expected)
    assert ('does not read the 50 records' in caplog.text) == (start == 'latest')


def test_guarantee_1_a_topic_made_anew_is_read_though_its_leader_has_changed_before(
    tmp_path: Path, ros_domain: int, topic_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    """The client would ask the new one for ever for the old leader epoch."""
    with LocalKafka(properties=QUICK_RETURN) as node:
        bench = Bench(tmp_path, node.bootstrap_servers, ros_domain)
        bench.create_topic(topic_name)
        with Reader(bench, topic_name, 'latest') as reader:
            reads_group(reader, caplog)
            reader.until(len(fill(bench, topic_name, 'old', {0: 20})))
            node.kill()
            for _ in range(10):
                reader.read()
            node.start()
            fill(bench, topic_name, 'again', {0: 1})
            reader.until(21)
            make_anew(bench, topic_name)
            now = fill(bench, topic_name, 'new', {0: 21})
            reader.values.clear()
            assert sorted(reader.until(21)) == now


@pytest.mark.parametrize('protocol', [CLASSIC, KIP_848], ids=['classic', 'consumer'])
@pytest.mark.parametrize('partitions', [1, 3])
def test_guarantee_1_who_takes_over_reads_a_topic_that_was_made_anew_from_its_beginning(
    bench: Bench,
    topic: str,
    caplog: pytest.LogCaptureFixture,
    partitions: int,
    protocol: dict[str, Any],
) -> None:
    """Kafka deletes the offsets of the group with the topic, and this one has read nothing."""
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(Reader(bench, topic, 'latest', **protocol))
        reads_group(first, caplog)
        second = stack.enter_context(Reader(bench, topic, 'latest', **protocol))
        known = time.monotonic() + patient(5)
        fill(bench, topic, 'old', {0: 20})

        def both_read() -> bool:
            first.read()
            second.read()
            return len(first.values) + len(second.values) == 20 and time.monotonic() > known

        eventually(both_read, 60)
        make_anew(bench, topic, partitions)
        now = set(fill(bench, topic, 'new', dict.fromkeys(range(partitions), 20)))
        reader, other = (second, first) if first.values else (first, second)
        other.die()

        def has_all() -> bool:
            reader.read()
            return now <= set(reader.values)

        eventually(has_all, 60, lambda: f'{len(set(reader.values))} of {len(now)}')


def test_guarantee_1_a_stop_before_a_topic_made_anew_was_noticed_passes_over_nothing(
    bench: Bench, topic_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with reading_old(bench, topic_name, caplog) as reader:
        make_anew(bench, topic_name)
        now = fill(bench, topic_name, 'new', {0: 20})
    with Reader(bench, topic_name, 'latest') as reader:
        assert sorted(reader.until(20)) == now
