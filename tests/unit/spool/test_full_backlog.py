"""A spool or a disk that is full: what waits, what goes past it, what is dropped."""

import time
from typing import Any

import pytest
from support.worlds.pipeline_with_spool import (
    GID,
    Make,
    come_back,
    fill,
    fill_while_away,
    go_away,
    go_on,
    make_room,
)

from ros2_kafka_bridge.endpoints import Message, Reports


def test_guarantee_1_a_hand_over_with_a_full_spool_waits_until_it_has_room(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'max_bytes': 1000}, max_in_flight=2, drain_s=0.3, away=True)
    h.take(*range(1, 1000), steps=20)
    assert h.pipeline._spooling.full
    assert h.source.waiting, 'which nobody else has'
    back_at_s, poll = time.monotonic() + 0.6, h.sink.poll

    def look(timeout_s: float) -> Reports[Any]:
        if time.monotonic() > back_at_s:
            come_back(h)
        return poll(timeout_s)

    monkeypatch.setattr(h.sink, 'poll', look)
    h.drain(limited=False)  # this bridge lives
    assert not h.source.waiting
    again = house().until_all_confirmed()
    assert h.numbers() + again.numbers() == list(range(1, 1000))


def test_a_full_spool_holds_the_publishers_back(house: Make) -> None:
    h = house({'max_bytes': 1000}, max_in_flight=2, away=True)
    h.take(*range(1, 1000), steps=20)
    assert h.source.waiting
    assert 'the spool is full (max_bytes: 1000)' in str(h.pipeline._spooling.full)
    come_back(h)
    for _ in range(200):
        h.steps(10)
        if not h.source.waiting and not h.count('in_flight') and not h.count('spooled'):
            break
    assert h.numbers() == list(range(1, 1000))


def test_a_full_spool_drops_the_oldest_where_the_route_says_so_and_counts_them(
    house: Make,
) -> None:
    h = house({'max_bytes': 2000}, max_in_flight=2, when_full='drop_oldest', away=True)
    h.take(*range(1, 601), steps=20)
    assert not h.source.waiting
    dropped = h.count('dropped')
    assert dropped > 0
    go_on(h)
    assert h.numbers()[-1] == 600
    assert h.numbers() == sorted(h.numbers())
    assert len(h.numbers()) + h.count('dropped') == 600


def test_a_full_window_drops_nothing_while_the_disk_has_room(house: Make) -> None:
    h = house(max_in_flight=2, when_full='drop_oldest', answering=False)
    h.take(*range(1, 100), steps=10)
    assert h.count('dropped') == 0
    go_away(h)
    h.steps(10)
    assert (h.count('taken'), h.count('dropped')) == (99, 0)


def test_what_is_too_old_on_disk_is_dropped_and_counted(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._LOOK_S', 0.0)
    h = house({'max_age_s': 0.001}, max_in_flight=1, away=True)
    h.take(1, 2, 3)
    h.steps(200)
    go_on(h)
    assert h.numbers() == [1]
    assert h.count('dropped') == 2


def test_a_disk_that_takes_nothing_loses_nothing(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house(max_in_flight=3)
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    fill(h)
    go_away(h)
    h.take(1, 2)
    h.take(*range(3, 1003))
    assert h.count('taken') < 1002, 'it cannot all be in memory'
    assert h.backlog.problem == 'the disk is full'
    make_room(h)
    h.steps(10)
    assert not h.source.waiting
    go_on(h)
    assert h.numbers() == list(range(1, 1003))


def test_what_was_confirmed_while_the_disk_was_full_is_not_written_any_more(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house()
    fill(h)
    h.sink.answering = False
    h.take(1, 2)
    h.sink.away = 'Kafka is away'
    h.steps()
    come_back(h)
    h.steps()
    make_room(h)
    h.until_all_confirmed(3)
    assert h.numbers() == [1, 2, 3]


def test_what_a_full_disk_did_not_take_goes_on_once_kafka_is_back(house: Make) -> None:
    h = house(max_in_flight=3)
    fill_while_away(h, *range(1, 101))
    come_back(h)
    h.until_all_taken_are_confirmed(*range(101, 201))
    assert h.numbers() == list(range(201))


def test_what_a_full_disk_did_not_take_waits_for_what_is_on_it(house: Make) -> None:
    h = house(max_in_flight=3, away=True)
    h.take(*range(1, 21))
    fill(h)
    h.take(*range(21, 31))
    come_back(h)
    h.until_all_taken_are_confirmed(*range(31, 41))
    assert h.numbers() == list(range(1, 41))


@pytest.mark.parametrize('when_full', ['wait', 'drop_oldest'])
def test_a_full_disk_lets_a_slow_kafka_have_no_more_than_the_window_and_one_take(
    house: Make, monkeypatch: pytest.MonkeyPatch, when_full: str
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house(max_in_flight=3, when_full=when_full)
    fill_while_away(h, *range(1, 2001))
    h.sink.away = ''  # it takes, and confirms nothing
    for _ in range(20):
        h.steps(1)
        assert h.count('in_flight') <= 3 + 500
    come_back(h)
    h.until_all_taken_are_confirmed()
    assert len(h.numbers()) + h.count('dropped') == 2001
    assert h.numbers() == sorted(h.numbers())
    assert h.count('dropped') == 0 or when_full == 'drop_oldest'


def test_what_a_full_disk_did_not_take_is_on_it_once_it_has_room_and_kafka_is_away_again(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house(max_in_flight=3)
    fill_while_away(h, *range(1, 11))
    h.sink.away = ''
    h.steps()
    h.sink.away = 'Kafka is away'
    del h.spool.append
    h.steps()
    h.crash()
    again = house().until_all_confirmed()
    assert again.numbers() == list(range(11))


def test_a_full_disk_is_said_again_when_kafka_is_away_again(
    house: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house()
    for number in (1, 2):
        fill_while_away(h, number)
        go_on(h)
        h.steps()
    assert [r.levelname for r in caplog.records].count('ERROR') == 2


def test_always_lets_nothing_past_a_full_disk(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house({'mode': 'always'})
    fill(h)
    h.take(1, 2, 3, steps=10)
    assert h.numbers() == []
    del h.spool.append
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [1, 2, 3]


def test_a_dead_letter_that_cannot_be_written_holds_up_nothing_that_a_full_disk_did_not_take(
    house: Make,
) -> None:
    h = house()
    h.letters.limit_bytes = -1  # its topic cannot be written
    h.source.waiting.append(Message(b'bad', GID, 100, 0))
    fill_while_away(h, 1, 2, 3)
    come_back(h)
    h.steps(10)
    assert h.pipeline._dead_letters.problem
    assert h.numbers() == [0, 1, 2, 3]


def test_drop_oldest_keeps_the_newest_of_what_a_full_disk_does_not_take(house: Make) -> None:
    h = house(when_full='drop_oldest', max_in_flight=3)
    fill_while_away(h, *range(1, 101))
    come_back(h)
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [0, 98, 99, 100]
    assert h.count('dropped') == 97


def test_drop_oldest_keeps_the_newest_of_what_is_too_large_for_memory_and_a_full_disk(
    house: Make,
) -> None:
    h = house(when_full='drop_oldest', max_in_flight=500, max_in_flight_bytes=3 * 410)
    h.sink.answering = False
    h.take(1, 2)  # they fill the window with the first one of those that follow
    fill_while_away(h, *range(3, 101))
    come_back(h)
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [1, 2, 0, 98, 99, 100]
    assert h.count('dropped') == 95


def test_the_newest_stays_also_where_it_alone_is_too_large_for_memory(
    house: Make, caplog: pytest.LogCaptureFixture
) -> None:
    h = house(when_full='drop_oldest', max_in_flight_bytes=300)
    fill_while_away(h, *range(1, 5))
    come_back(h)
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [0, 4]
    assert 'drop: 3 that waited, to keep newer ones' in caplog.text


def test_a_stop_gives_up_nothing_that_a_full_disk_did_not_take_where_kafka_takes_it(
    house: Make,
) -> None:
    h = house(max_in_flight=3, drain_s=5)
    fill_while_away(h, *range(1, 101))
    come_back(h)
    h.give(*range(101, 201))
    h.drain()
    assert h.numbers() == list(range(201))


def test_a_stop_sends_what_is_on_a_full_disk_before_what_it_did_not_take(house: Make) -> None:
    h = house(max_in_flight=3, drain_s=5, away=True)
    h.take(*range(1, 101))
    fill(h)
    h.take(*range(101, 111))
    come_back(h)
    h.drain()
    assert h.numbers() == list(range(1, 111))


def test_a_disk_that_was_full_and_is_not_gets_only_what_is_newer(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house(when_full='drop_oldest', max_in_flight=3, drain_s=0.0)
    fill(h)
    h.sink.answering = False
    h.take(1, 2, 3)
    go_away(h)
    h.take(*range(4, 30))
    make_room(h)
    h.take(*range(30, 40))
    h.drain()
    again = house().until_all_confirmed()
    assert again.numbers()[:3] == [1, 2, 3]
    assert again.numbers()[-1] == 39
    assert again.numbers() == sorted(again.numbers())
