"""What is sent for a dead letter."""

import struct
from pathlib import Path

import pytest
from support.bridges.made_letters import (
    CONFIG,
    HEADERS,
    TOPIC,
    kafka_letter,
    read,
    restorer,
    ros_letter,
)

from ros2_kafka_bridge.commands.dead_letters.restore import Again
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.dead_letters.writer import without_value
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing
from ros2_kafka_bridge.errors import RecordError


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


def test_an_origin_for_which_a_route_would_refuse_it_again_is_left_out_and_no_other() -> None:
    mine, other = ('bridge.origin', b'warehouse-1'), ('bridge.origin', b'warehouse-2')
    for topic, left in ((b'/orders', [other]), (b'/status', [mine, other])):
        came_from: HeaderList = [('ros.topic', topic)]
        again = restorer().for_kafka(read(kafka_letter(headers=[*came_from, mine, other])))
        assert again.record.headers == [*came_from, *left]


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
    for found, said in (
        (None, 'is gone, or may not be read'),
        (other, 'is another record'),
        (original._replace(key=b'another'), 'is another record'),
    ):
        text = rf'\(5 bytes\) was left out, and orders\[2\]@5 {said}'
        with pytest.raises(RecordError, match=text):
            restorer(original=found).for_kafka(letter)


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


# What others may have written


def test_guarantee_6b_a_letter_that_is_not_the_record_it_tells_of_is_left_unless_forced() -> None:
    letter = read(kafka_letter(b'open the door'))
    true = Outgoing('orders', b'key', b'order', HEADERS)
    assert restorer(original=true).for_kafka(read(kafka_letter())).unvouched == ''
    for to in (restorer(original=true).for_kafka, restorer(original=true).for_ros):
        with pytest.raises(RecordError, match=r'orders\[2\]@5 is another record: somebody else'):
            to(letter)
    forced = restorer(original=true, force=True).for_kafka(letter)
    assert forced.record.value == b'open the door'
    assert 'not the record which they tell of' in forced.unvouched


def test_guarantee_6b_a_letter_of_a_record_that_never_was_is_left_unless_forced() -> None:
    """The topic does not reach so far: a stranger has named an offset that nobody can compare."""
    letter = read(kafka_letter(b'open the door'))
    with pytest.raises(RecordError, match=r'orders\[2\]@5 is a place that the topic has not'):
        restorer(was_there=False).for_kafka(letter)
    assert restorer(was_there=False, force=True).for_kafka(letter).unvouched


@pytest.mark.parametrize(
    'original',
    [
        Outgoing('orders', b'another', b'order', HEADERS),
        Outgoing('orders', None, b'order', HEADERS),
        Outgoing('orders', b'key', b'order', HEADERS[:1]),
        Outgoing('orders', b'key', None, HEADERS),
    ],
)
def test_key_value_and_headers_must_be_those_of_the_record(original: Outgoing) -> None:
    with pytest.raises(RecordError, match='is another record'):
        restorer(original=original).for_kafka(read(kafka_letter()))


def test_too_many_headers_are_left_out_of_a_letter_and_not_missed() -> None:
    original = Outgoing('orders', b'key', b'order', HEADERS * 600)
    again = restorer(original=original).for_kafka(read(kafka_letter(headers=HEADERS * 600)))
    assert (again.record.value, again.unvouched) == (b'order', '')


def test_it_says_for_which_letters_nothing_vouches() -> None:
    assert 'not in its topic now' in restorer().for_kafka(read(kafka_letter())).unvouched
    assert 'from ROS' in restorer().for_kafka(read(ros_letter(string(b'hello')))).unvouched


@pytest.mark.parametrize('value', [b'\xff\xfe', b'a\0b', None, b'x' * 1_000_001])
def test_guarantee_6b_a_letter_of_ros_is_checked_by_the_format_also_where_it_was_encoded(
    value: bytes | None,
) -> None:
    forged = read(ros_letter(value, RecordError('topic returned: refused')))
    with pytest.raises(RecordError, match=r'would fail again: (Decode|RecordTooLarge)Error: '):
        restorer().for_kafka(forged)
