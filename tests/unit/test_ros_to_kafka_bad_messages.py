"""Messages that the pipeline ROS -> Kafka cannot deliver, driven step by step."""

import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from support.worlds.pipeline_to_kafka import House, encode

from ros2_kafka_bridge.endpoints import HeaderList, Message
from ros2_kafka_bridge.errors import RecordTooLargeError, RouteError
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.route.type_hash import make_publisher_check
from ros2_kafka_bridge.testing.memory import MemoryRecordSink


def test_a_message_that_cannot_be_encoded_becomes_a_dead_letter_and_the_next_one_goes() -> None:
    house = House()
    house.take(b'a', b'bad', b'c')
    assert house.values() == [b'a', b'c']
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert (letter.topic, letter.value) == ('orders.dead', b'bad')
    assert told['dead_letter.error'] == 'EncodeError: not what it should be'
    assert (told['dead_letter.source'], told['ros.seq']) == ('/orders', '2')
    assert house.count('dead_lettered') == 1


@pytest.mark.parametrize('on_error', ['dead_letter', 'drop', 'stop'])
def test_a_bug_of_the_encoder_is_told_with_its_traceback_whatever_the_route_does_about_it(
    caplog: pytest.LogCaptureFixture, on_error: str
) -> None:
    house = House(on_error=on_error)
    house.give(b'bug')
    with suppress(RouteError):
        house.steps()
    [line] = [one for one in caplog.records if one.levelname == 'ERROR']
    assert line.getMessage().startswith("/orders -> orders: the bridge's own encoder failed: ")
    assert line.exc_info is not None
    assert traceback.extract_tb(line.exc_info[2])[-1].name == 'encode'


def test_a_message_that_meets_a_bug_of_the_encoder_becomes_a_dead_letter() -> None:
    house = House()
    house.take(b'a', b'bug', b'c')
    assert house.values() == [b'a', b'c']
    [letter] = house.letters.records
    assert letter.value == b'bug'
    assert dict(letter.headers)['dead_letter.error'] == (
        "EncodeError: the bridge's own encoder failed: AttributeError: 'NoneType' object has no "
        "attribute 'get': a bug of the bridge, report it with the traceback of its log"
    )


def convert_by(house: House, **ways: Callable[..., Any]) -> None:
    """Let the route make its records by these instead."""
    house.pipeline._conversion = house.pipeline._conversion._replace(**ways)


def test_guarantee_1_what_was_taken_before_a_bug_of_the_bridge_is_sent_all_the_same() -> None:
    house = House()
    make_headers = house.pipeline._conversion.make_headers

    def headers(message: Message) -> HeaderList:
        if message.cdr == b'c':
            raise ValueError('a bug')
        return make_headers(message)

    convert_by(house, make_headers=headers)
    house.give(b'a', b'bad', b'b', b'c')
    with pytest.raises(ValueError, match='a bug'):
        house.steps()
    house.steps()
    assert house.values() == [b'a', b'b']
    assert [letter.value for letter in house.letters.records] == [b'bad']


def test_a_message_above_max_message_bytes_goes_to_the_dead_letters_without_its_value() -> None:
    house = House(max_message_bytes=3)
    house.take(b'four', b'abc')
    assert house.values() == [b'abc']
    [letter] = house.letters.records
    assert letter.value is None
    assert dict(letter.headers)['dead_letter.value_bytes'] == '4'


def test_what_was_a_dead_letter_before_a_restart_is_no_second_one() -> None:
    house = House(refused=frozenset({1, 2}), max_message_bytes=5)
    house.take(b'bad 1', b'longer', b'bad 3')
    [letter] = house.letters.records
    assert letter.value == b'bad 3'
    assert (house.count('skipped'), house.count('dead_lettered')) == (2, 1)


def test_what_was_a_dead_letter_before_a_restart_goes_to_kafka_once_it_can() -> None:
    house = House(refused=frozenset({1}))
    house.take(b'mended')
    assert house.values() == [b'mended']


def test_on_error_drop_looks_at_no_letters_and_drops_nothing_for_a_bug() -> None:
    house = House(refused=frozenset({1}), on_error='drop')
    house.take(b'bad', b'bug')
    assert [letter.value for letter in house.letters.records] == [b'bug']
    assert (house.count('dropped'), house.count('skipped')) == (1, 0)


def test_on_error_drop_counts_and_goes_on() -> None:
    house = House(on_error='drop')
    house.take(b'bad', b'b')
    assert house.values() == [b'b']
    assert house.count('dropped') == 1


def test_on_error_stop_ends_the_route() -> None:
    house = House(on_error='stop')
    house.give(b'bad')
    with pytest.raises(RouteError, match='/orders -> orders: not what') as raised:
        house.steps()
    assert raised.value.final


def test_on_error_stop_delivers_all_before_the_bad_message_and_says_what_it_gives_up() -> None:
    house = House(sink=MemoryRecordSink(answering=False), on_error='stop')
    house.take(b'a', b'b', b'bad', b'c', b'bad too', b'd')
    house.sink.answering = True
    with pytest.raises(RouteError, match='3 messages behind it are given up'):
        house.steps()
    assert house.values() == [b'a', b'b']
    assert house.count('taken') == 6


def test_on_error_stop_sends_nothing_that_waits_behind_what_the_producer_refuses() -> None:
    house = House(sink=MemoryRecordSink(limit_bytes=5), on_error='stop')
    house.give(b'a', b'much too large', b'c', b'd')
    with pytest.raises(RouteError, match='2 messages behind it are given up'):
        house.steps()
    assert house.values() == [b'a']


def test_on_error_stop_sends_nothing_again_that_was_sent_with_what_the_broker_refuses() -> None:
    """What the producer has by then may arrive; what it cannot deliver is not sent again."""
    house = House(on_error='stop')
    for value in (b'a', b'large', b'c'):
        house.sink.errors[value] = [RecordTooLargeError(1, None, 'of the topic')]
    house.sink.errors[b'large'].append(RecordTooLargeError(1, None, 'of the topic'))
    house.give(b'a', b'large', b'c', b'd')
    with pytest.raises(RouteError, match='behind it are given up'):
        house.steps(10)
    assert house.values() == [b'd', b'a']


def test_a_dead_letter_topic_that_refuses_stops_the_taking() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('no permission')]
    house.take(b'bad')
    house.take(b'b', first=2)
    assert house.shown().state == State.FAILED
    assert house.values() == []
    house.pipeline._dead_letters._again_at_s = 0.0
    house.steps()
    assert house.values() == [b'b']
    assert [letter.value for letter in house.letters.records] == [b'bad']


def test_a_message_of_another_version_of_its_type_is_a_dead_letter_that_keeps_its_bytes() -> None:
    ours, theirs = ('RIHS01_' + digit * 64 for digit in '12')
    house = House()
    hashes = {1: ours, 2: theirs, 3: ''}
    convert_by(
        house,
        check_headers=make_publisher_check('std_msgs/msg/String', ours),
        make_headers=lambda message: [('ros.type_hash', hashes[message.seq].encode())],
    )
    house.take(b'a', b'b', b'c')
    assert [record.value for record in house.sink.records] == [encode(b'a'), encode(b'c')]
    [letter] = house.letters.records
    assert letter.value == b'b'
    error = str(dict(letter.headers)['dead_letter.error'])
    assert error.startswith('EncodeError: ros.type_hash: the publisher sends std_msgs/msg/String')
    assert ours in error
    assert theirs in error


def test_a_registry_that_is_away_at_the_start_is_asked_again_and_nothing_is_taken_meanwhile() -> (
    None
):
    house = House()
    answers: list[Exception | None] = [RouteError('away'), None]

    def make_encode() -> Encode:
        if (error := answers.pop(0)) is not None:
            raise error
        return encode

    house.pipeline._encode = None
    convert_by(house, make_encode=make_encode)
    house.give(b'a')
    with pytest.raises(RouteError, match='away'):
        house.stop()
    assert len(house.source.waiting) == 1
    house.sink.close()
    house.stop()
    assert [record.value for record in house.sink.records] == [encode(b'a')]
