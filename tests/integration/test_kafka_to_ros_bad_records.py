"""Bad records on their way to ROS: dead letters, and what else `on_error` asks for.

The numbers in the names are those of the guarantees that the tests prove.
"""

import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Message
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AclBinding,
    AclBindingFilter,
    AclOperation,
    AclPermissionType,
    ResourcePatternType,
    ResourceType,
)
from support.bridges.routes import lines, to_ros, totals
from support.bridges.words import ROS_TOPIC, texts, wait_for, wait_for_commit, words
from support.patience import patient
from support.processes.harness import Bench

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

HeaderList = list[tuple[str, bytes | None]]
KEY = b'\xfe key'
HEADERS: HeaderList = [('trace', b'\0\xff'), ('trace', b'again'), ('none', None)]
LIMIT_BYTES = 2000
GARBAGE = b'\xff\xfe\0' * 500


@pytest.fixture
def strict_bench(tmp_path: Path, ros_domain: int) -> Iterator[Bench]:
    """A bench on a Kafka with permissions."""
    properties = {
        'authorizer.class.name': 'org.apache.kafka.metadata.authorizer.StandardAuthorizer',
        'allow.everyone.if.no.acl.found': 'true',
    }
    with LocalKafka(properties=properties) as node:
        yield Bench(tmp_path, node.bootstrap_servers, ros_domain)


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
    topic: str,
    arrived: Path,
    kind: str,
    records: list[tuple[bytes | None, str]],
) -> None:
    bad = [(offset, *record) for offset, record in enumerate(records) if record[1]]
    good = [value or b'' for value, error in records if not error]
    expected = [value.decode() if kind == 'text' else value[8:-1].decode() for value in good]
    bench.produce(topic, [value for value, _ in records], key=KEY, headers=HEADERS)
    route = to_ros(topic, ROS_TOPIC, max_message_bytes=LIMIT_BYTES) | {'format': kind}
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(bench.config([route])) as bridge:
        wait_for(arrived, expected, bridge)
        wait_for_commit(bench, topic, len(records), bridge)
    letters = bench.records(f'{topic}.dead-letters', len(bad))
    for letter, (offset, value, error) in zip(letters, bad, strict=True):
        check_letter(letter, value, offset, error, topic)
    assert totals(bridge)['dead-lettered'] == len(bad)
    assert totals(bridge)['confirmed'] == len(good)


def test_guarantee_5_a_dead_letter_too_large_for_its_topic_goes_without_its_value(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """Only that one: others keep theirs, however many come at once."""
    small, large = GARBAGE, GARBAGE * 10
    records = [b'first', *[small] * 20, large, *[small] * 20, b'last']
    bench.create_topic(f'{topic}.dead-letters', max_message_bytes='5000')
    bench.produce(topic, records, key=KEY, headers=HEADERS)
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic, len(records), bridge)
    letters = bench.records(f'{topic}.dead-letters', 41)
    by_offset = {int(own_headers(letter)['dead_letter.offset']): letter for letter in letters}
    assert sorted(by_offset) == list(range(1, 42))
    stripped = by_offset.pop(21)
    check_letter(stripped, None, 21, 'DecodeError', topic, 'value_bytes')
    assert own_headers(stripped)['dead_letter.value_bytes'] == str(len(large))
    for offset, letter in by_offset.items():
        check_letter(letter, small, offset, 'DecodeError', topic)


def test_guarantee_5_a_dead_letter_that_its_topic_takes_keeps_its_value_whatever_its_size(
    bench: Bench, topic_name: str, arrived: Path
) -> None:
    large = b'x' * 3_000_000
    bench.create_topic(topic_name, max_message_bytes='4000000')
    bench.create_topic(f'{topic_name}.dead-letters', max_message_bytes='4000000')
    bench.produce(topic_name, [b'first', large, b'last'], key=KEY, headers=HEADERS)
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic_name, 3, bridge)
    [letter] = bench.records(f'{topic_name}.dead-letters', 1)
    check_letter(letter, large, 1, 'RecordTooLargeError: 3000000 bytes', topic_name)


def test_guarantee_6_with_on_error_drop_bad_records_are_counted(
    bench: Bench, topic: str, arrived: Path
) -> None:
    bench.produce(topic, [b'first', GARBAGE, None, b'last'])
    config = bench.config([to_ros(topic, ROS_TOPIC, on_error='drop')])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, ['first', 'last'], bridge)
        wait_for_commit(bench, topic, 4, bridge)
    assert totals(bridge)['dropped'] == 2
    assert totals(bridge)['confirmed'] == 2


def test_with_on_error_stop_the_route_ends_at_the_bad_record_after_all_before_it(
    bench: Bench, topic: str, arrived: Path
) -> None:
    bench.produce(topic, [*words(700), GARBAGE, *words(700, start=701)])
    config = bench.config([to_ros(topic, ROS_TOPIC, on_error='stop')])
    with bench.subscriber(ROS_TOPIC, arrived):
        for _ in range(2):  # starting it again changes nothing
            with bench.bridge(config) as bridge:
                assert bridge.wait(30) == 1
            assert f'failed: {topic}[0]@700: ' in bridge.output()
            assert 'stopped, as on_error says' in bridge.output()
            assert bench.committed(bench.group, topic) == 700
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
    admin.create_acls([forbidden])[forbidden].result(patient(60))
    bench.create_topic(topic_name, other)
    bench.produce(topic_name, [b'0', GARBAGE, b'1'], key=KEY, headers=HEADERS)
    bench.produce(other, words(100))
    config = bench.config([to_ros(topic_name, ROS_TOPIC), to_ros(other, '/others', 'others')])
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.subscriber('/others', others),
        bench.drained(config) as bridge,
    ):
        bridge.wait_for('to_ros: failed: ', count=2)
        assert f'the dead-letter topic {letters} cannot be written: ' in bridge.output()
        assert 'give this user WRITE on the topic (ACL)' in bridge.output()
        wait_for(others, texts(words(100)), bridge)
        assert bench.committed(bench.group, topic_name) <= 1
        admin.delete_acls([same])[same].result(patient(60))
        wait_for_commit(bench, topic_name, 3, bridge)
        bench.produce(other, words(100, start=100))
        wait_for(others, texts(words(200)), bridge)
    assert 'others: failed' not in bridge.output()
    assert set(lines(arrived)) == {'0', '1'}
    [letter] = bench.records(letters, 1)
    check_letter(letter, GARBAGE, 1, 'DecodeError', topic_name)
    totals(bridge)
    assert totals(bridge, 'others')['confirmed'] == 200
