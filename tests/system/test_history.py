"""What publishers send again from their history is in Kafka once, however long the history is."""

from confluent_kafka import Producer
from support.bridges.routes import to_kafka, totals, values
from support.processes.harness import Bench, eventually, headers

from ros2_kafka_bridge.dedup import place_of
from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.kafka.properties import consumer_properties
from ros2_kafka_bridge.kafka.tail import KafkaTail
from ros2_kafka_bridge.route.produced import FIRST_RECORDS

GID = bytes(range(16))


def told(seq: int) -> HeaderList:
    """The headers of a record of that number."""
    return [('ros.gid', GID.hex().encode()), ('ros.seq', b'%d' % seq)]


def test_a_history_longer_than_the_first_look_is_not_repeated_by_a_restart(
    bench: Bench, topic: str
) -> None:
    count = FIRST_RECORDS + 2000
    config = bench.config([to_kafka('/orders', topic)])
    history = ('--durability', 'transient_local', '--depth', str(count), '--count', str(count))
    with bench.publisher('/orders', *history, '--readers', '0') as publisher:
        publisher.wait_for('published', 60)
        for run in range(2):
            with bench.drained(config) as bridge:
                eventually(lambda: bench.reaches(topic, count), 60, bridge.output)
                if run:
                    bridge.wait_for(f'looked through the last {count} records of {topic}', 60)
            assert totals(bridge, 'to_kafka')['confirmed'] == (0 if run else count)
        records = bench.records(topic, count)
    assert values(records) == [b'%d' % number for number in range(count)]
    assert [int(headers(record)['ros.seq']) for record in records] == list(range(1, count + 1))


def test_the_end_of_a_topic_is_read_back_step_by_step(bench: Bench, topic_name: str) -> None:
    bench.create_topic(topic_name, partitions=3)
    with Producer({'bootstrap.servers': bench.bootstrap_servers}) as producer:
        for partition, count in ((0, 50), (1, 10)):  # and nothing in the third
            for seq in range(partition, 2 * count, 2):
                producer.produce(topic_name, b'x', partition=partition, headers=told(seq))
        assert producer.flush(60) == 0
    tail = KafkaTail(
        consumer_properties(
            {'bootstrap.servers': bench.bootstrap_servers}, group='test.tail', client_id='test'
        ),
        topic_name,
    )
    found, seen = [], list[tuple[bytes, int] | None]()
    for _ in range(4):
        tail.read(16, 60, lambda record: seen.append(place_of(record)))
        found.append((tail.records, tail.complete))
    assert found == [(26, False), (42, False), (58, False), (60, True)]
    assert tail.partitions == 3
    expected = {*range(0, 100, 2), *range(1, 20, 2)}
    assert set(seen) == {(GID, seq) for seq in expected}
    assert len(seen) == 60
    assert tail.since_ns == 0.0
