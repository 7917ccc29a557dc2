"""What is sent for a dead letter."""

import struct
from pathlib import Path

import pytest
from made_letters import CONFIG, HEADERS, TOPIC, kafka_letter, read, restorer, ros_letter

from ros2_kafka_bridge.commands.dead_letters.restore import Again
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.writer import without_value
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing
from ros2_kafka_bridge.errors import (
    RecordError,
)


def test_a_letter_of_a_type_in_a_folder_is_checked_without_its_package() -> None:
    folder = Path(__file__).parents[3] / 'examples' / 'msgs'
    route = CONFIG['routes'][0] | {
        'to': {'ros': '/scans', 'type': 'shelf_msgs/msg/ShelfScan'},
        'format': 'json',
        'json': {'missing': 'default'},
    }
    folders = {'message_path': [str(folder)]}
    made = validated(Config, CONFIG | {'ros': folders, 'routes': [route]})
    assert restorer(made).for_kafka(read(kafka_letter(b'{"side": 1}'))).record.topic == 'orders'
    with pytest.raises(RecordError, match=r'would fail again: DecodeError: \$.side: expected int'):
        restorer(made).for_kafka(read(kafka_letter(b'{"side": "left"}')))


def test_a_letter_of_another_version_of_its_type_would_fail_again() -> None:
    told: HeaderList = [('ros.type_hash', b'RIHS01_' + b'0' * 64)]
    with pytest.raises(RecordError, match=r'would fail again: DecodeError: ros\.type_hash'):
        restorer().for_kafka(read(kafka_letter(headers=told)))
    route = CONFIG['routes'][0] | {'check_type_hash': False}
    unchecked = validated(Config, CONFIG | {'routes': [route]})
    passed = restorer(unchecked).for_kafka(read(kafka_letter(headers=told)))
    assert passed.record.value == b'order'


def test_a_record_goes_back_as_it_was_to_its_topic_and_partition() -> None:
    again = restorer().for_kafka(read(kafka_letter()))
    assert again.record == Outgoing('orders', b'key', b'order', HEADERS)
    assert again.partition == 2


def test_a_partition_that_is_no_longer_there_is_left_to_the_key() -> None:
    again = restorer(partitions={'orders': 2}).for_kafka(read(kafka_letter()))
    assert again.partition is None


def test_an_origin_that_makes_this_bridge_skip_it_is_left_out_and_no_other() -> None:
    origins: HeaderList = [('bridge.origin', b'warehouse-1'), ('bridge.origin', b'warehouse-2')]
    again = restorer().for_kafka(read(kafka_letter(headers=origins)))
    assert again.record.headers == [('bridge.origin', b'warehouse-2')]


@pytest.mark.parametrize('value', [b'\xff', b'a\0b', None, b'x' * 101])
def test_what_would_fail_again_is_left_unless_forced(value: bytes | None) -> None:
    letter = read(kafka_letter(value))
    for attempt in (restorer().for_kafka, restorer().for_ros):
        with pytest.raises(RecordError, match='would fail again: '):
            attempt(letter)
    assert restorer(force=True).for_kafka(letter).record.value == value


def test_a_topic_that_no_route_reads_needs_force_and_must_be_there() -> None:
    letter = read(kafka_letter(topic='other'))
    with pytest.raises(RecordError, match=r'no route of the file reads other: .* --force'):
        restorer().for_kafka(letter)
    with pytest.raises(RecordError, match='the topic other is not there'):
        restorer(force=True).for_kafka(letter)
    assert restorer(partitions={'other': 1}, force=True).for_kafka(letter).route is None


def test_a_letter_never_goes_back_to_its_own_dead_letter_topic() -> None:
    with pytest.raises(RecordError, match='its own dead-letter topic'):
        restorer(force=True).for_kafka(read(kafka_letter(topic=TOPIC)))


def test_a_value_left_out_is_fetched_if_the_same_record_is_still_there() -> None:
    letter = read(without_value(kafka_letter()))
    original = Outgoing('orders', b'key', b'order', HEADERS)
    assert restorer(original=original).for_kafka(letter).record == original
    other = original._replace(value=b'other order')
    for gone in (None, other, original._replace(key=b'another')):
        with pytest.raises(
            RecordError, match=r'\(5 bytes\) was left out, and orders\[2\]@5 is no'
        ):
            restorer(original=gone).for_kafka(letter)


def test_a_bare_letter_gets_key_and_headers_from_the_record_that_it_came_from() -> None:
    record = without_value(kafka_letter(headers=[]))._replace(key=None)
    original = Outgoing('orders', b'key', b'order', HEADERS)
    assert restorer(original=original).for_kafka(read(record)).record == original


def string(text: bytes) -> bytes:
    return b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0'


def test_a_message_of_ros_is_encoded_again_with_the_key_of_the_route() -> None:
    again = restorer().for_kafka(read(ros_letter(string(b'hello'))))
    assert again.record.topic == 'returned'
    assert (again.record.key, again.record.value) == (b'ab' * 16 + b' hello', b'hello')
    assert ('ros.gid', b'ab' * 16) in again.record.headers


def test_what_was_encoded_and_refused_by_kafka_goes_as_it_was() -> None:
    letter = read(ros_letter(b'hello', RecordError('topic returned: refused')))
    assert restorer().for_kafka(letter).record.value == b'hello'


def test_messages_of_ros_that_cannot_be_replayed_say_why() -> None:
    broken = read(ros_letter(b'garbage'))
    lost = read(without_value(ros_letter(string(b'hello'))))
    fine = read(ros_letter(string(b'hello')))
    for letter, to, reason in (
        (broken, restorer(force=True).for_kafka, 'would fail again: EncodeError'),
        (lost, restorer().for_kafka, 'nothing holds it any more'),
        (fine, restorer().for_ros, 'can be replayed to Kafka only'),
    ):
        with pytest.raises(RecordError, match=reason):
            to(letter)


def test_a_route_with_a_new_name_takes_the_letters_of_the_old_one() -> None:
    data = {**CONFIG, 'routes': [{**CONFIG['routes'][0], 'name': 'renamed'}]}
    again = restorer(validated(Config, data)).for_kafka(read(kafka_letter()))
    assert again.route is not None
    assert again.route.name == 'renamed'
    assert isinstance(again, Again)
