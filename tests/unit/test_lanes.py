"""What stands still holds no other lane: what can be delivered, and what are dead letters."""

import pytest
from support.worlds.pipeline_to_kafka import House as ToKafka
from support.worlds.pipeline_to_ros import House as ToRos

from ros2_kafka_bridge.errors import RouteError

pytestmark = pytest.mark.usefixtures('no_settle_time')


def test_a_record_that_waits_for_its_readers_holds_no_dead_letter() -> None:
    house = ToRos()
    house.sink.room = 0
    house.take(b'a', b'bad', b'b', b'bad too')
    assert [letter.value for letter in house.letters.records] == [b'bad', b'bad too']
    assert house.positions() == {0: 0}
    house.sink.room = 2
    house.steps()
    assert house.positions() == {0: 4}


def test_a_dead_letter_that_nobody_takes_holds_no_record() -> None:
    house = ToRos()
    house.letters.answering = False
    house.take(b'bad', b'a', b'b')
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert house.confirmed() == 2
    assert house.positions() == {0: 0}


def test_dead_letters_that_cannot_be_written_hold_no_record_that_was_taken() -> None:
    house = ToRos()
    house.sink.room = 1
    house.letters.errors[b'bad'] = [RouteError('no permission')]
    house.take(b'a', b'bad', b'b')
    house.sink.room = 2
    house.steps()
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert not house.letters.records


def test_a_message_that_waits_for_kafka_holds_no_dead_letter() -> None:
    house = ToKafka()
    house.sink.answering = False
    house.take(b'a', b'bad', b'b')
    assert [letter.value for letter in house.letters.records] == [b'bad']
    assert house.count('confirmed') == 0


def test_a_dead_letter_that_nobody_takes_holds_no_message() -> None:
    house = ToKafka()
    house.letters.answering = False
    house.take(b'bad', b'a', b'b')
    assert house.values() == [b'a', b'b']
    assert (house.count('confirmed'), house.count('dead_lettered')) == (2, 0)
