"""Records that the pipeline Kafka -> ROS cannot deliver, driven step by step."""

import traceback
from contextlib import suppress
from typing import Any

import pytest
from support.worlds.pipeline_to_ros import HASH, House

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.threads.stop import Stop

pytestmark = pytest.mark.usefixtures('no_settle_time')


def test_a_bad_record_becomes_a_dead_letter_and_those_behind_it_wait_for_its_confirmation() -> (
    None
):
    house = House()
    house.letters.answering = False
    house.take(b'a', b'bad', b'c')
    assert house.sink.published == [b'cdr:a', b'cdr:c']
    assert house.positions() == {0: 1}
    house.letters.answering = True
    house.steps()
    assert house.positions() == {0: 3}
    [letter] = house.letters.records
    told = dict(letter.headers)
    assert (letter.topic, letter.value) == ('orders.dead', b'bad')
    assert told['dead_letter.error'] == 'DecodeError: not what it should be'
    assert (told['dead_letter.topic'], told['dead_letter.partition']) == ('orders', '0')
    assert (told['dead_letter.route'], told['dead_letter.offset']) == ('orders', '1')


BROKEN = [
    (b'bug of the bridge', "AttributeError: 'NoneType' object has no attribute 'get'"),
    (b'bug that asserts', 'AssertionError'),
    (b'bug that takes all memory', 'MemoryError'),
    (b'bug without end', 'RecursionError: maximum recursion depth exceeded'),
]


@pytest.mark.parametrize(('value', 'what'), BROKEN)
def test_a_record_that_meets_a_bug_of_the_decoder_becomes_a_dead_letter(
    value: bytes, what: str
) -> None:
    house = House()
    house.take(b'a', value, b'c')
    assert house.sink.published == [b'cdr:a', b'cdr:c']
    assert house.positions() == {0: 3}
    [letter] = house.letters.records
    assert letter.value == value
    assert dict(letter.headers)['dead_letter.error'] == (
        f"DecodeError: the bridge's own decoder failed: {what}: a bug of the bridge, report it "
        'with the traceback of its log'
    )


@pytest.mark.parametrize('on_error', ['dead_letter', 'drop', 'stop'])
def test_a_bug_of_the_decoder_is_told_with_its_traceback_whatever_the_route_does_about_it(
    caplog: pytest.LogCaptureFixture, on_error: str
) -> None:
    house = House(on_error=on_error)
    house.give(b'bug of the bridge')
    with suppress(RouteError):
        house.steps()
    [line] = [one for one in caplog.records if one.levelname == 'ERROR']
    assert line.getMessage().startswith("orders[0]@0: the bridge's own decoder failed: Attribut")
    assert line.exc_info is not None
    (told,) = traceback.extract_tb(line.exc_info[2])[-1:]
    assert (told.name, told.line) == ('decode', 'raise kind(text)')


def test_a_bug_of_the_decoder_drops_no_record() -> None:
    house = House(on_error='drop')
    house.take(b'bad', b'bug of the bridge')
    assert [letter.value for letter in house.letters.records] == [b'bug of the bridge']
    assert house.pipeline.counters.snapshot(0).dropped == 1


def test_many_bugs_of_the_decoder_flood_no_log(caplog: pytest.LogCaptureFixture) -> None:
    house = House()
    house.take(*[b'bug of the bridge'] * 200)
    assert len(house.letters.records) == 200
    assert len([one for one in caplog.records if one.exc_info]) == 5
    house.pipeline._occasional.close()
    last = [one for one in caplog.records if one.exc_info][-1]
    assert last.getMessage().endswith(' (195 times more)')


def test_a_user_who_ends_the_bridge_while_it_decodes_is_no_bug_of_it() -> None:
    house = House()
    house.give(b'bug, said the user')
    with pytest.raises(KeyboardInterrupt):
        house.steps()


def test_the_client_of_the_dead_letters_is_polled_also_while_there_are_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    house.take(b'bad')
    assert house.positions() == {0: 1}
    polled: list[float] = []
    monkeypatch.setattr(house.letters, 'poll', polled.append)
    house.steps()
    assert polled


def test_a_dead_letter_too_large_goes_without_its_value() -> None:
    house = House()
    house.letters.limit_bytes = 5
    house.take(b'bad and long', key_bytes=b'k', header_list=[('mine', b'1')])
    [letter] = house.letters.records
    assert letter.value is None
    assert letter.key == b'k'
    assert dict(letter.headers)['mine'] == b'1'
    assert dict(letter.headers)['dead_letter.value_bytes'] == '12'


def test_a_dead_letter_topic_that_refuses_stops_the_reading_and_nothing_is_lost() -> None:
    house = House()
    house.letters.errors[b'bad'] = [RouteError('no permission')]
    house.take(b'a', b'bad', b'c')
    house.take(b'd', first=3, steps=2)
    assert house.shown().state == State.FAILED
    assert 'no permission' in house.pipeline.snapshot.reason
    assert len(house.source.waiting) == 1
    house.pipeline._dead_letters._again_at_s = 0.0
    house.steps()
    assert [letter.value for letter in house.letters.records] == [b'bad']
    assert house.sink.published == [b'cdr:a', b'cdr:c', b'cdr:d']
    assert house.positions() == {0: 4}


def test_on_error_drop_counts_and_goes_on() -> None:
    house = House(on_error='drop')
    house.take(b'bad', b'b')
    assert house.pipeline.counters.snapshot(0).dropped == 1
    assert house.positions() == {0: 2}


def test_on_error_stop_ends_the_route_before_the_bad_record() -> None:
    house = House(on_error='stop')
    house.take(b'a')
    house.give(b'bad', first=1)
    with pytest.raises(RouteError, match=r'orders\[0\]@1: not what it should be') as raised:
        house.steps()
    assert raised.value.final
    assert house.positions() == {0: 1}


def test_a_value_above_max_message_bytes_is_a_dead_letter_that_names_both_sizes() -> None:
    house = House(max_message_bytes=3)
    house.take(b'four', b'abc')
    assert house.sink.published == [b'cdr:abc']
    [letter] = house.letters.records
    reason = dict(letter.headers)['dead_letter.error']
    assert reason == (
        'RecordTooLargeError: 4 bytes, more than max_message_bytes of the route (3 bytes)'
    )


def test_letters_that_arrived_count_though_another_of_the_same_report_failed() -> None:
    house = House()
    house.letters.errors[b'bad2'] = [RouteError('no permission')]
    house.take(b'bad1', b'bad2', b'bad3')
    house.pipeline._dead_letters._again_at_s = 0.0
    house.steps()
    assert sorted(letter.value or b'' for letter in house.letters.records) == [
        b'bad1', b'bad2', b'bad3',
    ]  # fmt: skip
    assert house.positions() == {0: 3}


def test_who_is_asked_by_the_format_and_is_away_costs_nothing() -> None:
    """What comes before the record is confirmed, it and what comes behind it are read again."""
    house = House()
    house.give(b'a', b'bad', b'b')
    house.give(b'away', b'c', first=3)
    house.give(b'd', partition=1)
    with pytest.raises(RouteError, match='does not answer') as caught:
        house.steps()
    assert not caught.value.final
    assert house.sink.published == [b'cdr:a', b'cdr:b']
    assert house.positions() == {0: 3, 1: 0}
    house.pipeline._give_back([*house.pipeline._flight])
    house.check_balance()
    snapshot = house.pipeline.counters.snapshot(0)
    assert (snapshot.taken, snapshot.confirmed, snapshot.dead_lettered) == (6, 2, 1)
    assert snapshot.returned == 3


def test_what_is_read_after_such_a_failure_is_never_published_undecoded() -> None:
    house = House()
    house.give(b'away')
    house.give(b'b', partition=1)
    house.pipeline._poll(0.0)
    house.source.lose(frozenset({0}))
    house.give(b'c', partition=1, first=1)
    with pytest.raises(RouteError):
        house.steps()
    assert house.sink.published == []


def test_a_route_runs_again_once_the_one_it_asks_is_back() -> None:
    house = House()
    house.give(b'a', b'away')
    with pytest.raises(RouteError):
        house.pipeline.run(Stop())
    assert house.source.committed == {0: 1}
    with house.pipeline._opened():
        house.take(b'back', first=1)
        assert house.positions() == {0: 2}
    assert house.sink.published[-1] == b'cdr:back'


@pytest.mark.parametrize(
    'headers',
    [
        [],
        [('ros.type_hash', HASH.encode())],
        [('other', b'x'), ('ros.type_hash', b'')],
        [('ros.type_hash', None), ('ros.type', b'std_msgs/msg/String')],
        [('ros.type_hash', b'INVALID')],
    ],
)
def test_a_record_of_the_same_type_or_of_none_told_passes(headers: Any) -> None:
    house = House()
    house.take(b'a', header_list=headers)
    assert house.sink.published == [b'cdr:a']


def test_a_record_of_another_version_of_the_type_is_a_dead_letter_with_both_hashes() -> None:
    house = House()
    other = 'RIHS01_' + '2' * 64
    told = [('ros.type', b'other_msgs/msg/String'), ('ros.type_hash', other.encode())]
    house.give(b'a', header_list=told)
    house.take(b'b', first=1)
    assert house.sink.published == [b'cdr:b']
    [letter] = house.letters.records
    error = str(dict(letter.headers)['dead_letter.error'])
    assert f'written with other_msgs/msg/String {other}' in error
    assert f'publishes std_msgs/msg/String {HASH}' in error
    assert 'check_type_hash: false' in error
