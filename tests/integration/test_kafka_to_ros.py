"""Kafka -> ROS as its users see it: where it begins, what it waits for, and bad records.

The numbers in the names are those of the guarantees that the tests prove.
"""

import contextlib
import signal
import struct
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Consumer, KafkaException, Message, Producer, TopicPartition
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AclBinding,
    AclBindingFilter,
    AclOperation,
    AclPermissionType,
    NewPartitions,
    ResourcePatternType,
    ResourceType,
)
from harness import Bench, Process, eventually, lines, to_ros, totals, values

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

GROUP = 'test.to_ros'
ROS_TOPIC = '/words'
HeaderList = list[tuple[str, bytes | None]]


@pytest.fixture
def arrived(tmp_path: Path) -> Path:
    """The file of a subscriber."""
    return tmp_path / 'arrived'


@pytest.fixture(scope='module')
def strict_kafka() -> Iterator[LocalKafka]:
    """A Kafka with permissions, which also compacts its topics at once."""
    properties = {
        'authorizer.class.name': 'org.apache.kafka.metadata.authorizer.StandardAuthorizer',
        'allow.everyone.if.no.acl.found': 'true',
        'log.cleaner.backoff.ms': '100',
    }
    with LocalKafka(properties=properties) as node:
        yield node


@pytest.fixture
def strict_bench(tmp_path: Path, strict_kafka: LocalKafka, ros_domain: int) -> Bench:
    """A bench on that Kafka."""
    return Bench(tmp_path, strict_kafka.bootstrap_servers, ros_domain)


def words(count: int, start: int = 0) -> list[bytes | None]:
    return [b'%d' % number for number in range(start, start + count)]


def texts(found: list[bytes | None]) -> list[str]:
    return [(value or b'').decode() for value in found]


def wait_for(file: Path, expected: list[str], bridge: Process, timeout_s: float = 30.0) -> None:
    """Wait until all has arrived, once and in order."""
    eventually(
        lambda: len(lines(file)) >= len(expected),
        timeout_s,
        lambda: f'{len(lines(file))} of {len(expected)}\n{bridge.output()}',
    )
    assert lines(file) == expected


def wait_for_commit(
    bench: Bench, topic: str, offset: int, bridge: Process, partition: int = 0
) -> None:
    eventually(
        lambda: bench.committed(GROUP, topic, partition) == offset,
        10,
        lambda: f'{bench.committed(GROUP, topic, partition)}, not {offset}\n{bridge.output()}',
    )


def bounds(bench: Bench, topic: str) -> tuple[int, int]:
    """The first offset of a partition, and the one behind its last."""
    config = {'bootstrap.servers': bench.bootstrap_servers, 'group.id': 'bounds'}
    with contextlib.closing(Consumer(config)) as consumer:
        low, high = consumer.get_watermark_offsets(TopicPartition(topic, 0), timeout=10)
        return low, high


# Where it begins and ends


@pytest.mark.parametrize('start', ['latest', 'earliest'])
def test_a_first_start_begins_where_start_says(
    bench: Bench, topic_name: str, arrived: Path, start: str
) -> None:
    """In every partition of the topic."""
    route = to_ros(topic_name, ROS_TOPIC)
    route['from']['start'] = start
    bench.create_topic(topic_name, partitions=4)
    for partition in range(4):
        bench.produce(topic_name, [b'old'] * 10, partition=partition)
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(bench.config([route])) as bridge:
        bridge.wait_for(f'first start of this group: begins at the {start} record')
        for partition in range(4):
            bench.produce(topic_name, [b'new'] * 10, partition=partition)
        eventually(lambda: lines(arrived).count('new') == 40, 20, bridge.output)
        for partition in range(4):
            wait_for_commit(bench, topic_name, 20, bridge, partition)
        assert bridge.end() == 0
    old = 40 if start == 'earliest' else 0
    assert sorted(lines(arrived)) == ['new'] * 40 + ['old'] * old
    assert totals(bridge)['taken'] == 40 + old
    assert 'ERROR' not in bridge.output()


def test_guarantee_8_a_bridge_killed_at_its_first_start_has_its_place_in_the_topic(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """With `start: latest`: what came after the first start is not taken for old."""
    route = to_ros(topic_name, ROS_TOPIC)
    route['from']['start'] = 'latest'
    config = bench.config([route])
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(10))
    with bench.bridge(config) as bridge:
        bridge.wait_for('first start of this group')
        bridge.kill()
    bench.produce(topic_name, words(20, start=10))
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, texts(words(20, start=10)), bridge)
        assert bridge.end() == 0


def test_guarantee_1_a_partition_added_while_running_is_read_from_its_beginning(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """Even with `start: latest`, which is about what was there at the first start."""
    route = to_ros(topic_name, ROS_TOPIC)
    route['from']['start'] = 'latest'
    bench.create_topic(topic_name)
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(bench.config([route])) as bridge:
        bridge.wait_for('first start of this group')
        admin = bench.admin()
        admin.create_partitions([NewPartitions(topic_name, 2)])[topic_name].result(10)
        bench.produce(topic_name, words(100), partition=1)
        wait_for(arrived, texts(words(100)), bridge)
        bench.produce(topic_name, words(100, start=100), partition=0)
        wait_for(arrived, texts(words(200)), bridge)
        assert bridge.end() == 0
    assert [bench.committed(GROUP, topic_name, p) for p in range(2)] == [100, 100]


def test_guarantee_1_records_deleted_before_they_were_read_are_counted_and_the_others_arrive(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(50))
    with bench.subscriber(ROS_TOPIC, arrived):
        with bench.bridge(config) as bridge:
            wait_for(arrived, texts(words(50)), bridge)
            assert bridge.end() == 0
        bench.produce(topic_name, words(50, start=50))
        admin = bench.admin()
        below = TopicPartition(topic_name, 0, 70)
        admin.delete_records([below])[below].result(10)
        with bench.bridge(config) as bridge:
            wait_for(arrived, texts([*words(50), *words(30, start=70)]), bridge)
            assert bridge.end() == 0
    assert (
        f'{topic_name}[0]: 20 records were deleted before the bridge read them '
        '(offsets 50 to 69); it goes on at 70'
    ) in bridge.output()
    assert totals(bridge)['lost before the bridge'] == 20
    assert bench.committed(GROUP, topic_name) == 100


def test_guarantee_1_a_compacted_topic_is_committed_over_its_gaps_to_its_end(
    strict_bench: Bench, topic_name: str, arrived: Path
) -> None:
    bench = strict_bench
    bench.create_topic(
        topic_name, cleanup_policy='compact', segment_ms='100', min_cleanable_dirty_ratio='0.01'
    )
    bench.produce(topic_name, words(100), key=b'same')

    def compacted() -> bool:
        bench.produce(topic_name, [b'other'], key=b'other')  # closes a segment
        return values(bench.records(topic_name, 2))[0] == b'99'

    eventually(compacted, 60)
    left = bench.records(topic_name, 2)
    assert left[0].offset() == 99
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, texts([record.value() for record in left]), bridge)
        wait_for_commit(bench, topic_name, bounds(bench, topic_name)[1], bridge)
        assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == len(left)


def test_guarantee_1_a_topic_with_transactions_is_committed_over_their_marks_to_its_end(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """What was aborted does not arrive; the lag gets 0 although marks are no records."""
    bench.create_topic(topic_name)
    producer = Producer(
        {'bootstrap.servers': bench.bootstrap_servers, 'transactional.id': topic_name}
    )
    producer.init_transactions(20)

    def transaction(first: int, *, commit: bool) -> None:
        producer.begin_transaction()
        for value in words(10, start=first):
            producer.produce(topic_name, value)
        producer.flush(10)
        (producer.commit_transaction if commit else producer.abort_transaction)(20)

    transaction(0, commit=True)
    transaction(10, commit=False)
    transaction(20, commit=True)
    transaction(30, commit=False)
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, texts([*words(10), *words(10, start=20)]), bridge)
        assert bounds(bench, topic_name) == (0, 44)
        wait_for_commit(bench, topic_name, 44, bridge)
        transaction(40, commit=True)
        wait_for(arrived, texts([*words(10), *words(10, start=20), *words(10, start=40)]), bridge)
        wait_for_commit(bench, topic_name, 55, bridge)
        bridge.wait_for('running: 30 confirmed')
        assert 'lag 0,' in bridge.output()
        assert bridge.end() == 0


# What it waits for, drops and skips


def test_guarantee_4_records_wait_until_min_subscribers_are_there(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    first, second = tmp_path / 'first', tmp_path / 'second'
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(100))
    config = bench.config([to_ros(topic_name, ROS_TOPIC, min_subscribers=2)])
    with bench.subscriber(ROS_TOPIC, first), bench.bridge(config) as bridge:
        bridge.wait_for('waiting (1 of 2 subscribers are there)')
        assert lines(first) == []
        assert bench.committed(GROUP, topic_name) == 0
        with bench.subscriber(ROS_TOPIC, second):
            wait_for(second, texts(words(100)), bridge)
            wait_for(first, texts(words(100)), bridge)
            assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == 100


def test_with_min_subscribers_0_records_go_to_nobody(bench: Bench, topic_name: str) -> None:
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(2000))
    config = bench.config([to_ros(topic_name, ROS_TOPIC, min_subscribers=0)])
    with bench.bridge(config) as bridge:
        wait_for_commit(bench, topic_name, 2000, bridge)
        assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == 2000


def test_guarantee_1_max_rate_is_kept_and_a_keep_last_subscriber_then_loses_nothing(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    count, rate = 150, 50.0
    bench.create_topic(topic_name)
    config = bench.config([to_ros(topic_name, ROS_TOPIC, max_rate=rate)])
    with (
        bench.subscriber(ROS_TOPIC, arrived, '--depth', '10'),
        bench.bridge(config) as bridge,
    ):
        bridge.wait_for('first start of this group')
        start_s = time.monotonic()
        bench.produce(topic_name, words(count))
        wait_for(arrived, texts(words(count)), bridge)
        assert time.monotonic() - start_s >= (count - 1) / rate
        assert bridge.end() == 0


def test_guarantee_6_records_older_than_max_age_s_are_dropped_and_counted(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    hour_ago_ms = int(time.time() * 1000) - 3_600_000
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(10))
    bench.produce(topic_name, words(7, start=10), timestamp=hour_ago_ms)
    bench.produce(topic_name, words(10, start=17))
    config = bench.config([to_ros(topic_name, ROS_TOPIC, max_age_s=600)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, texts([*words(10), *words(10, start=17)]), bridge)
        wait_for_commit(bench, topic_name, 27, bridge)
        assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == 20
    assert totals(bridge)['dropped'] == 7


def test_guarantee_6_a_record_of_the_bridge_itself_is_skipped_and_counted(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    bench.create_topic(topic_name)
    bench.produce(topic_name, words(5), headers=[('bridge.origin', b'another')])
    bench.produce(topic_name, words(3, start=5), headers=[('bridge.origin', b'test')])
    bench.produce(topic_name, words(5, start=8))
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, texts([*words(5), *words(5, start=8)]), bridge)
        wait_for_commit(bench, topic_name, 13, bridge)
        assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == 10
    assert totals(bridge)['skipped'] == 3


# Bad records

KEY = b'\xfe key'
HEADERS: HeaderList = [('trace', b'\0\xff'), ('trace', b'again'), ('none', None)]
LIMIT_BYTES = 2000
GARBAGE = b'\xff\xfe\0' * 500


def string(text: str) -> bytes:
    """The CDR bytes of a std_msgs/String."""
    data = text.encode() + b'\0'
    return b'\0\1\0\0' + struct.pack('<I', len(data)) + data


def own_headers(letter: Message) -> dict[str, str]:
    """What the bridge has added to a dead letter."""
    found: Any = letter.headers()
    return {name: value.decode() for name, value in found if name.startswith('dead_letter.')}


def check_letter(
    letter: Message, value: bytes | None, offset: int, error: str, topic: str, *more: str
) -> None:
    """A dead letter is the record as it was, with its own headers behind those of the record."""
    assert (letter.key(), letter.value()) == (KEY, value)
    found: Any = letter.headers()
    assert found[: len(HEADERS)] == HEADERS
    own = own_headers(letter)
    assert len(found) == len(HEADERS) + len(own)
    names = ('error', 'route', 'topic', 'partition', 'offset', 'time_ns', *more)
    assert list(own) == [f'dead_letter.{name}' for name in names]
    texts = own_headers(letter)
    assert error in texts['dead_letter.error']
    assert texts['dead_letter.route'] == 'to_ros'
    assert texts['dead_letter.topic'] == topic
    assert (texts['dead_letter.partition'], texts['dead_letter.offset']) == ('0', str(offset))
    assert abs(time.time_ns() - int(texts['dead_letter.time_ns'])) < 60e9


TEXT_RECORDS: list[tuple[bytes | None, str]] = [
    (b'first', ''),
    (b'caf\xe9', 'DecodeError: not UTF-8 at byte 3'),
    (b'', ''),
    (b'a\0b', 'DecodeError: a NUL at byte 1'),
    ('na\u00efve'.encode(), ''),
    (None, 'DecodeError: the value is null (a tombstone)'),
    (b'x' * LIMIT_BYTES, ''),
    (b'x' * (LIMIT_BYTES + 1), 'RecordTooLargeError: 2001 bytes, more than max_message_bytes'),
    (b'last', ''),
]
CDR_RECORDS: list[tuple[bytes | None, str]] = [
    (string('first'), ''),
    (b'garbage', 'DecodeError: '),
    (string(''), ''),
    (b'', 'DecodeError: '),
    (b'\0\1\0\0' + struct.pack('<i', 42), 'DecodeError: '),  # an Int32
    (b'\0\1\0\0' + struct.pack('<3d', 1.0, 2.0, 3.0), 'DecodeError: '),  # a Point
    (string('cut')[:-2], 'DecodeError: '),
    (None, 'DecodeError: the value is null (a tombstone)'),
    (string('last'), ''),
]


@pytest.mark.parametrize(
    ('kind', 'records'), [('text', TEXT_RECORDS), ('cdr', CDR_RECORDS)], ids=['text', 'cdr']
)
def test_guarantee_5_a_bad_record_becomes_a_dead_letter_and_all_others_arrive(
    bench: Bench,
    topic_name: str,
    arrived: Path,
    kind: str,
    records: list[tuple[bytes | None, str]],
) -> None:
    bad = [(offset, *record) for offset, record in enumerate(records) if record[1]]
    good = [value or b'' for value, error in records if not error]
    expected = [value.decode() if kind == 'text' else value[8:-1].decode() for value in good]
    bench.create_topic(topic_name)
    bench.produce(topic_name, [value for value, _ in records], key=KEY, headers=HEADERS)
    route = to_ros(topic_name, ROS_TOPIC, max_message_bytes=LIMIT_BYTES) | {'format': kind}
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(bench.config([route])) as bridge:
        wait_for(arrived, expected, bridge)
        wait_for_commit(bench, topic_name, len(records), bridge)
        assert bridge.end() == 0
    letters = bench.records(f'{topic_name}.dead-letters', len(bad))
    for letter, (offset, value, error) in zip(letters, bad, strict=True):
        check_letter(letter, value, offset, error, topic_name)
    assert totals(bridge)['dead-lettered'] == len(bad)
    assert totals(bridge)['confirmed'] == len(good)


def test_guarantee_5_a_dead_letter_too_large_for_its_topic_goes_without_its_value(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    """Only that one: others keep theirs, however many come at once."""
    small, large = GARBAGE, GARBAGE * 10
    records = [b'first', *[small] * 20, large, *[small] * 20, b'last']
    bench.create_topic(topic_name)
    bench.create_topic(f'{topic_name}.dead-letters', max_message_bytes='5000')
    bench.produce(topic_name, records, key=KEY, headers=HEADERS)
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic_name, len(records), bridge)
        assert bridge.end() == 0
    letters = bench.records(f'{topic_name}.dead-letters', 41)
    by_offset = {int(own_headers(letter)['dead_letter.offset']): letter for letter in letters}
    assert sorted(by_offset) == list(range(1, 42))
    stripped = by_offset.pop(21)
    check_letter(stripped, None, 21, 'DecodeError', topic_name, 'value_bytes')
    assert own_headers(stripped)['dead_letter.value_bytes'] == str(len(large))
    for offset, letter in by_offset.items():
        check_letter(letter, small, offset, 'DecodeError', topic_name)


def test_guarantee_5_a_dead_letter_that_its_topic_takes_keeps_its_value_whatever_its_size(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    large = b'x' * 3_000_000
    bench.create_topic(topic_name, max_message_bytes='4000000')
    bench.create_topic(f'{topic_name}.dead-letters', max_message_bytes='4000000')
    bench.produce(topic_name, [b'first', large, b'last'], key=KEY, headers=HEADERS)
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic_name, 3, bridge)
        assert bridge.end() == 0
    [letter] = bench.records(f'{topic_name}.dead-letters', 1)
    check_letter(letter, large, 1, 'RecordTooLargeError: 3000000 bytes', topic_name)


def test_guarantee_6_with_on_error_drop_bad_records_are_counted(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    bench.create_topic(topic_name)
    bench.produce(topic_name, [b'first', GARBAGE, None, b'last'])
    config = bench.config([to_ros(topic_name, ROS_TOPIC, on_error='drop')])
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic_name, 4, bridge)
        assert bridge.end() == 0
    assert totals(bridge)['dropped'] == 2
    assert totals(bridge)['confirmed'] == 2


def test_with_on_error_stop_the_route_ends_at_the_bad_record_after_all_before_it(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    bench.create_topic(topic_name)
    bench.produce(topic_name, [*words(700), GARBAGE, *words(700, start=701)])
    config = bench.config([to_ros(topic_name, ROS_TOPIC, on_error='stop')])
    with bench.subscriber(ROS_TOPIC, arrived):
        for _ in range(2):  # starting it again changes nothing
            with bench.bridge(config) as bridge:
                assert bridge.wait(30) == 1
            assert f'failed: {topic_name}[0]@700: ' in bridge.output()
            assert 'stopped, as on_error says' in bridge.output()
            assert bench.committed(GROUP, topic_name) == 700
            wait_for(arrived, texts(words(700)), bridge)
            totals(bridge)
        assert totals(bridge)['confirmed'] == 0


def test_guarantee_5_a_dead_letter_topic_without_permission_fails_its_route_alone_until_mended(
    strict_bench: Bench, topic_name: str, arrived: Path, tmp_path: Path
) -> None:
    bench, other, others = strict_bench, f'{topic_name}.other', tmp_path / 'others'
    letters = f'{topic_name}.dead-letters'
    rule = (
        ResourceType.TOPIC,
        letters,
        ResourcePatternType.LITERAL,
        'User:ANONYMOUS',
        '*',
        AclOperation.ALL,
        AclPermissionType.DENY,
    )
    forbidden, same = AclBinding(*rule), AclBindingFilter(*rule)
    admin = bench.admin()
    admin.create_acls([forbidden])[forbidden].result(10)
    for topic in (topic_name, other):
        bench.create_topic(topic)
    bench.produce(topic_name, [b'0', GARBAGE, b'1'], key=KEY, headers=HEADERS)
    bench.produce(other, words(100))
    config = bench.config([to_ros(topic_name, ROS_TOPIC), to_ros(other, '/others', 'others')])
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.subscriber('/others', others),
        bench.bridge(config) as bridge,
    ):
        bridge.wait_for('to_ros: failed: ', count=2)
        assert f'the dead-letter topic {letters} cannot be written: ' in bridge.output()
        assert 'give this user WRITE on the topic (ACL)' in bridge.output()
        wait_for(others, texts(words(100)), bridge)
        assert bench.committed(GROUP, topic_name) <= 1
        admin.delete_acls([same])[same].result(10)
        wait_for_commit(bench, topic_name, 3, bridge)
        bench.produce(other, words(100, start=100))
        wait_for(others, texts(words(200)), bridge)
        assert bridge.end() == 0
    assert 'others: failed' not in bridge.output()
    assert set(lines(arrived)) == {'0', '1'}
    [letter] = bench.records(letters, 1)
    check_letter(letter, GARBAGE, 1, 'DecodeError', topic_name)
    totals(bridge)
    assert totals(bridge, 'others')['confirmed'] == 200


def test_guarantee_4_a_stopped_subscriber_holds_back_one_route_alone(
    bench: Bench, topic_name: str, arrived: Path, tmp_path: Path
) -> None:
    other, others = f'{topic_name}.other', tmp_path / 'others'
    for topic in (topic_name, other):
        bench.create_topic(topic)
    bench.produce(topic_name, words(2000))
    config = bench.config([to_ros(topic_name, ROS_TOPIC), to_ros(other, '/others', 'others')])
    with (
        bench.subscriber(ROS_TOPIC, arrived, samples=50) as stopped,
        bench.subscriber('/others', others),
        bench.bridge(config) as bridge,
    ):
        eventually(lambda: len(lines(arrived)) > 0, 20, bridge.output)
        stopped.send(signal.SIGSTOP)
        bench.produce(topic_name, words(2000, start=2000))
        bench.produce(other, words(5000))
        wait_for(others, texts(words(5000)), bridge)
        stopped.send(signal.SIGCONT)
        wait_for(arrived, texts(words(4000)), bridge)
        assert bridge.end() == 0


def test_guarantee_1_a_topic_made_anew_while_running_is_read_from_its_beginning(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    arrived = tmp_path / 'arrived'
    route = to_ros(topic_name, '/numbers')
    route['from']['start'] = 'latest'
    bench.create_topic(topic_name)
    with bench.subscriber('/numbers', arrived), bench.bridge(bench.config([route])) as bridge:
        bridge.wait_for('first start of this group')
        bench.produce(topic_name, [b'old %d' % number for number in range(20)])
        eventually(lambda: len(lines(arrived)) == 20, 30, bridge.output)
        admin = bench.admin()
        admin.delete_topics([topic_name])[topic_name].result(10)
        eventually(partial(created, bench, topic_name), 30, bridge.output)
        bench.produce(topic_name, [b'new %d' % number for number in range(5)])
        eventually(lambda: lines(arrived)[-1:] == ['new 4'], 60, bridge.output)
        assert bridge.end() == 0
    assert lines(arrived)[20:] == [f'new {number}' for number in range(5)]


def created(bench: Bench, topic: str) -> bool:
    """Whether the topic could be created: its deletion takes a moment."""
    try:
        bench.create_topic(topic)
    except KafkaException:
        return False
    return True
