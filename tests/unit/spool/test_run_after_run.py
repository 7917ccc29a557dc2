"""What an end of a run leaves in memory and on disk, and what the next one makes of it."""

import itertools
from typing import Any

import pytest
from support.worlds.pipeline_with_spool import (
    GID,
    House,
    Make,
    come_back,
    fill,
    go_away,
    go_on,
    made_ns,
    make_room,
)

from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.threads.stop import Stop


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._RELEASE_S', 0.0)
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)


def refuse(house: House, number: int) -> None:
    house.source.waiting.append(Message(b'bad', GID, number, made_ns(number)))


def test_on_error_stop_goes_on_where_what_was_refused_is_mended(house: Make) -> None:
    h = house({'mode': 'always'}, on_error='stop')
    h.sink.limit_bytes = 1
    h.sink.answering = False
    h.take(1, 22, 3)
    h.fail_and_run_again()
    h.sink.limit_bytes, h.sink.answering = 100, True
    h.steps(20)
    h.take(4, steps=20)
    assert h.numbers() == [1, 22, 3, 4]
    assert h.on_disk() == []


def test_what_the_disk_takes_only_at_the_second_try_is_behind_what_it_has(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house(away=True)
    h.take(1)
    fill(h)
    h.take(2)
    h.sink.away = ''
    h.steps()
    leave = h.pipeline._spooling.leave

    def leave_and_make_room() -> None:
        leave()
        make_room(h)

    monkeypatch.setattr(h.pipeline._spooling, 'leave', leave_and_make_room)
    stop = Stop()
    stop.ask()
    stop.ask()
    with pytest.raises(RouteError, match='gave up 1 messages'):
        h.pipeline._drain(stop)
    h._opened.__exit__(None, None, None)
    again = house().until_all_confirmed()
    assert again.numbers() == [1, 2]


def test_what_the_disk_has_lost_and_memory_has_not_goes_on(house: Make) -> None:
    h = house({'mode': 'always'}, answering=False)
    h.take(1, 2, 3)
    assert h.spool._db is not None
    h.spool._db.execute('UPDATE rows SET size = size + 1 WHERE number = 1')
    h.fail_and_run_again()
    go_on(h)
    assert sorted(h.numbers()) == [1, 2, 3]
    h.steps(100)
    assert h.on_disk() == []


def test_what_is_dropped_at_once_sends_nothing_over_the_disk(house: Make) -> None:
    h = house({'mode': 'always'}, on_error='drop', max_in_flight=5, answering=False)
    for number in range(1, 11):
        refuse(h, number)
    h.take(11, steps=1)
    assert (h.count('spooled'), h.count('in_flight')) == (0, 1)


def test_a_letter_that_an_earlier_life_has_left_in_front_holds_nothing_up(house: Make) -> None:
    h = house(drain_s=0.0)
    refuse(h, 100)
    h.give(1, 2)
    go_away(h)
    h.steps()
    h.drain()
    again = house()
    again.letters.answering = False
    again.steps(50)
    again.take(3, steps=50)
    assert again.numbers() == [1, 2, 3]


def test_drop_oldest_keeps_the_newest_also_where_what_is_in_flight_fills_the_disk(
    house: Make,
) -> None:
    h = house({'max_bytes': 1000}, max_in_flight=12, when_full='drop_oldest', answering=False)
    h.take(*range(1, 13), steps=2)
    go_away(h)
    h.steps(2)
    for number in range(13, 40):
        h.take(number, steps=2)
    go_on(h)
    assert h.numbers()[-1] == 39


def test_nothing_goes_past_a_disk_that_takes_nothing_and_what_stops_the_route(house: Make) -> None:
    h = house(on_error='stop', away=True)
    h.take(1)
    fill(h)
    refuse(h, 2)
    h.take(3)
    come_back(h)
    with pytest.raises(RouteError, match='stopped'):
        h.steps(20)
    assert h.numbers() == [1]


def test_what_is_too_much_for_memory_as_kafka_goes_away_comes_back_from_disk(house: Make) -> None:
    h = house(max_in_flight_bytes=1000)
    h.sink.room, h.sink.answering = 1, False
    h.take(*range(1, 6), steps=1)
    go_away(h)
    h.steps()
    h.sink.room = 10
    go_on(h)
    assert h.numbers() == [1, 2, 3, 4, 5]


def test_what_went_past_a_full_disk_is_on_it_once_that_has_room(house: Make) -> None:
    h = house(max_in_flight=3, away=True)
    h.take(1, 2)
    fill(h)
    h.take(3, 4)
    h.sink.away = ''  # it answers nobody yet
    h.steps()
    make_room(h)
    h.steps()
    assert [row.seq for row in h.spool.read(0, 10, 1 << 40)] == [1, 2, 3, 4]


def test_a_stop_while_kafka_is_away_ends_once_all_is_on_disk(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house(drain_s=30.0, away=True)
    h.take(1, 2, 3)
    poll, polls = h.sink.poll, itertools.count()

    def count(timeout_s: float) -> Reports[Any]:
        assert next(polls) < 10, 'it goes on though nothing is owed'
        return poll(timeout_s)

    monkeypatch.setattr(h.sink, 'poll', count)
    h.give(4)
    h.drain()
    again = house().until_all_confirmed()
    assert again.numbers() == [1, 2, 3, 4]
