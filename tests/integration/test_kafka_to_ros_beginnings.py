"""Where a route from Kafka begins, how far it commits, and what it does when the topic changes.

The numbers in the names are those of the guarantees that the tests prove.
"""

import contextlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from confluent_kafka import Consumer, KafkaException, Producer, TopicPartition
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    NewPartitions,
)
from support.bridges.routes import lines, to_ros, totals, values
from support.bridges.words import ROS_TOPIC, texts, wait_for, wait_for_commit, words
from support.patience import patient
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.testing.local_kafka import LocalKafka


@pytest.fixture
def compacting_bench(tmp_path: Path, ros_domain: int) -> Iterator[Bench]:
    """A bench on a Kafka that compacts its topics at once."""
    with LocalKafka(properties={'log.cleaner.backoff.ms': '100'}) as node:
        yield Bench(tmp_path, node.bootstrap_servers, ros_domain)


def bounds(bench: Bench, topic: str) -> tuple[int, int]:
    """The first offset of a partition, and the one behind its last."""
    config = {'bootstrap.servers': bench.bootstrap_servers, 'group.id': 'bounds'}
    with contextlib.closing(Consumer(config)) as consumer:
        low, high = consumer.get_watermark_offsets(TopicPartition(topic, 0), timeout=10)
        return low, high


@pytest.mark.parametrize('start', ['latest', 'earliest'])
def test_a_first_start_begins_where_start_says(
    bench: Bench, topic_name: str, arrived: Path, start: str
) -> None:
    """In every partition of the topic."""
    route = to_ros(topic_name, ROS_TOPIC)
    route['from']['start'] = start
    config = bench.config([route], kafka=bench.patient_kafka)
    bench.create_topic(topic_name, partitions=4)
    for partition in range(4):
        bench.produce(topic_name, [b'old'] * 10, partition=partition)
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        bridge.wait_for(f'first start of this group: begins at the {start} record')
        for partition in range(4):
            bench.produce(topic_name, [b'new'] * 10, partition=partition)
        eventually(lambda: lines(arrived).count('new') == 40, 20, bridge.output)
        for partition in range(4):
            wait_for_commit(bench, topic_name, 20, bridge, partition)
    old = 40 if start == 'earliest' else 0
    assert sorted(lines(arrived)) == ['new'] * 40 + ['old'] * old
    assert totals(bridge)['taken'] == 40 + old
    assert 'ERROR' not in bridge.output()


def test_guarantee_8_a_bridge_killed_at_its_first_start_has_its_place_in_the_topic(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """With `start: latest`: what came after the first start is not taken for old."""
    route = to_ros(topic, ROS_TOPIC)
    route['from']['start'] = 'latest'
    config = bench.config([route])
    bench.produce(topic, words(10))
    with bench.bridge(config) as bridge:
        bridge.wait_for('first start of this group')
        bridge.kill()
    bench.produce(topic, words(20, start=10))
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, texts(words(20, start=10)), bridge)


def test_guarantee_1_a_partition_added_while_running_is_read_from_its_beginning(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """Even with `start: latest`, which is about what was there at the first start."""
    route = to_ros(topic, ROS_TOPIC)
    route['from']['start'] = 'latest'
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(bench.config([route])) as bridge:
        bridge.wait_for('first start of this group')
        admin = bench.admin()
        admin.create_partitions([NewPartitions(topic, 2)])[topic].result(patient(60))
        # The broker hears of it from the controller, and refuses a record for it until then.
        eventually(lambda: partitions(admin, topic) == 2, 60)
        bench.produce(topic, words(100), partition=1)
        wait_for(arrived, texts(words(100)), bridge)
        bench.produce(topic, words(100, start=100), partition=0)
        wait_for(arrived, texts(words(200)), bridge)
    assert [bench.committed(bench.group, topic, p) for p in range(2)] == [100, 100]


def partitions(admin: AdminClient, topic: str) -> int:
    return len(admin.list_topics(topic, timeout=patient(10)).topics[topic].partitions)


def test_guarantee_1_records_deleted_before_they_were_read_are_counted_and_the_others_arrive(
    bench: Bench, topic: str, arrived: Path
) -> None:
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    bench.produce(topic, words(50))
    with bench.subscriber(ROS_TOPIC, arrived):
        with bench.drained(config) as bridge:
            wait_for(arrived, texts(words(50)), bridge)
        bench.produce(topic, words(50, start=50))
        admin = bench.admin()
        below = TopicPartition(topic, 0, 70)
        admin.delete_records([below])[below].result(patient(60))
        with bench.drained(config) as bridge:
            wait_for(arrived, texts([*words(50), *words(30, start=70)]), bridge)
    assert (
        f'{topic}[0]: 20 records were deleted before the bridge read them '
        '(offsets 50 to 69); it goes on at 70'
    ) in bridge.output()
    assert totals(bridge)['lost before the bridge'] == 20
    assert bench.committed(bench.group, topic) == 100


def test_guarantee_1_a_compacted_topic_is_committed_over_its_gaps_to_its_end(
    compacting_bench: Bench, topic_name: str, arrived: Path
) -> None:
    bench = compacting_bench
    bench.create_topic(
        topic_name, cleanup_policy='compact', segment_ms='100', min_cleanable_dirty_ratio='0.01'
    )
    bench.produce(topic_name, words(100), key=b'same')
    bench.produce(topic_name, words(100, start=100), key=b'another')
    others: list[bytes] = []  # a key each: none of them goes while the bridge reads

    def compacted() -> bool:
        others.append(b'other %d' % len(others))
        bench.produce(topic_name, others[-1:], key=others[-1])  # closes a segment
        return values(bench.records(topic_name, 2))[:2] == [b'99', b'199']

    eventually(compacted, 60)
    left = bench.records(topic_name, 2 + len(others))
    assert [record.offset() for record in left[:3]] == [99, 199, 200]
    assert values(left) == [b'99', b'199', *others]
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, texts([*values(left)]), bridge)
        wait_for_commit(bench, topic_name, bounds(bench, topic_name)[1], bridge)
    assert totals(bridge)['confirmed'] == len(left)


def test_guarantee_1_a_topic_with_transactions_is_committed_over_their_marks_to_its_end(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """What was aborted does not arrive; the lag gets 0 although marks are no records.

    Also for the tools of Kafka, of what was aborted while the bridge was not there.
    """
    producer = Producer({'bootstrap.servers': bench.bootstrap_servers, 'transactional.id': topic})
    producer.init_transactions(20)

    def transaction(first: int, *, commit: bool) -> None:
        producer.begin_transaction()
        for value in words(10, start=first):
            producer.produce(topic, value)
        producer.flush(10)
        (producer.commit_transaction if commit else producer.abort_transaction)(20)

    transaction(0, commit=True)
    transaction(10, commit=False)
    transaction(20, commit=True)
    transaction(30, commit=False)
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, texts([*words(10), *words(10, start=20)]), bridge)
        assert bounds(bench, topic) == (0, 44)
        wait_for_commit(bench, topic, 44, bridge)
        transaction(40, commit=True)
        wait_for(arrived, texts([*words(10), *words(10, start=20), *words(10, start=40)]), bridge)
        wait_for_commit(bench, topic, 55, bridge)
        bridge.wait_for('running: 30 confirmed')
        assert 'lag 0,' in bridge.output()
    transaction(50, commit=False)
    with bench.bridge(config) as bridge:  # which finds nothing but marks
        wait_for_commit(bench, topic, 66, bridge)


def test_guarantee_1_a_topic_made_anew_while_running_is_read_from_its_beginning(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """Whether it holds less by then than the old one, as much, or more."""
    held = {f'{topic_name}.{count}': count for count in (5, 20, 50)}
    routes = [to_ros(topic, '/numbers', f'route_{count}') for topic, count in held.items()]
    for route in routes:
        route['from']['start'] = 'latest'
    bench.create_topic(*held)
    with bench.subscriber('/numbers', arrived), bench.drained(bench.config(routes)) as bridge:
        begun = 'first start of this group'
        eventually(lambda: bridge.output().count(begun) == len(held), 60, bridge.output)
        for topic in held:
            bench.produce(topic, [b'old'] * 20)
        eventually(lambda: len(lines(arrived)) == 60, 30, bridge.output)
        admin = bench.admin()
        for deleted in admin.delete_topics(list(held)).values():
            deleted.result(patient(60))
        for topic, count in held.items():
            eventually(partial(created, bench, topic), 30, bridge.output)
            bench.produce(topic, [f'{topic} {number}'.encode() for number in range(count)])
        new = {f'{topic} {number}' for topic, count in held.items() for number in range(count)}
        eventually(lambda: set(lines(arrived)) == {'old'} | new, 60, bridge.output)
        for topic, count in held.items():
            group = f'{bench.name}.route_{count}'
            eventually(partial(has_committed, bench, group, topic, count), 60, bridge.output)
    for topic in held:
        assert bridge.output().count(f'{topic} was made anew: the offsets') == 1


def has_committed(bench: Bench, group: str, topic: str, offset: int) -> bool:
    return bench.committed(group, topic) == offset


def created(bench: Bench, topic: str) -> bool:
    """Whether the topic could be created: its deletion takes a moment."""
    try:
        bench.create_topic(topic)
    except KafkaException:
        return False
    return True
