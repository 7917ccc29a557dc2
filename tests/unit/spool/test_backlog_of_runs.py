"""What is on disk when a run fails, is stopped by a message, or ends."""

import pytest
from support.worlds.pipeline_with_spool import GID, Make, come_back, go_on

from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import RecordTooLargeError, RouteError, TransportError
from ros2_kafka_bridge.route.counters import Outcome, State
from ros2_kafka_bridge.spool.backlog_source import OF_NOTHING, Silence
from ros2_kafka_bridge.threads.stop import Stop


def test_a_route_that_fails_and_runs_again_sends_nothing_twice(house: Make) -> None:
    h = house(max_in_flight=4, away=True)
    h.take(*range(1, 20))
    h.fail_and_run_again()
    go_on(h, 20)
    assert h.numbers() == list(range(1, 21))


def test_a_route_with_a_spool_does_its_work_before_kafka_has_ever_answered(house: Make) -> None:
    h = house(away=True)
    h.sink.reached = h.sink.answers = False
    h.steps(1)
    snapshot = h.pipeline.snapshot
    assert (snapshot.state, snapshot.reason) == (State.WAITING, 'Kafka is away')
    assert snapshot.measures.kafka_up is False


def test_what_came_back_from_disk_keeps_its_place_where_kafka_goes_away_at_once(
    house: Make,
) -> None:
    """All brokers restart: the client of the next run has a record, and learns of it only then."""
    h = house(max_in_flight=10, away=True)
    h.take(*range(1, 7), steps=6)
    h.fail_and_run_again()
    h.sink.away, h.sink.room = '', 1
    h.steps(2)
    assert (h.count('in_flight'), h.count('spooled')) == (6, 0)
    h.sink.away = 'Kafka is away'
    h.steps(2)
    come_back(h)
    h.until_all_taken_are_confirmed(*range(7, 12))
    assert h.numbers() == list(range(1, 12))


def test_guarantee_8_a_bridge_that_stands_by_delivers_what_it_has_on_disk(house: Make) -> None:
    first = house(away=True)
    first.take(1, 2, 3)
    first.drain()
    assert first.numbers() == []
    again = house()
    again._opened.__exit__(None, None, None)
    pipeline = again.pipeline
    pipeline._source, pipeline._conversion, pipeline._encode = Silence(), OF_NOTHING, None
    pipeline.deliver_backlog(Stop())
    assert again.numbers() == [1, 2, 3]
    assert again.count('spooled') == 0


def test_on_error_stop_keeps_what_was_behind_for_the_next_start(house: Make) -> None:
    h = house(on_error='stop')
    h.give(1)
    h.source.waiting.append(Message(b'bad', GID, 2, 0))
    h.give(3, 4)
    with pytest.raises(RouteError, match=r'be; stopped, as on_error says$'):
        h.steps()
    assert h.count('spooled') == 2
    h.check_balance()
    h.crash()
    again = house().until_all_confirmed()
    assert again.numbers() == [3, 4]


def test_on_error_stop_waits_for_what_is_on_disk_before_it(house: Make) -> None:
    h = house(on_error='stop', max_in_flight=1, away=True)
    h.take(1, 2, 3)
    h.source.waiting.append(Message(b'bad', GID, 4, 0))
    h.steps()
    come_back(h)
    with pytest.raises(RouteError, match='stopped'):
        h.steps(20)
    assert h.numbers() == [1, 2, 3]


def test_a_backlog_goes_on_after_the_first_of_it_met_a_failed_route(house: Make) -> None:
    h = house(away=True)
    h.take(*range(1, 11))
    h.crash()
    again = house(away=True)
    again.steps()
    again.fail_and_run_again()
    go_on(again)
    assert again.numbers() == list(range(1, 11))


@pytest.mark.parametrize('mode', ['always', 'when_away'])
def test_what_kafka_confirms_at_the_very_end_is_counted_and_not_sent_again(
    house: Make, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'mode': mode}, drain_s=0.0, answering=False)
    h.take(*range(1, 11))
    h.sink.answering = True
    h.sink.delivered_at_close = 4
    monkeypatch.setattr(h.sink, 'poll', lambda _: Reports([], []))
    h.drain()
    assert (h.count('confirmed'), h.count('spooled'), h.count('in_flight')) == (4, 6, 0)
    again = house({'mode': mode}).until_all_confirmed()
    assert h.numbers() + again.numbers() == list(range(1, 11))


def test_on_error_stop_lets_nothing_pass_through_a_failure_in_between(house: Make) -> None:
    h = house(on_error='stop', answering=False)
    h.take(1)
    h.source.waiting.append(Message(b'bad', GID, 2, 0))
    h.take(3, 4)
    h.fail_and_run_again()
    h.sink.answering = True
    with pytest.raises(RouteError, match='stopped'):
        h.steps()
    assert h.numbers() == [1]
    assert h.count('spooled') == 2


def test_on_error_stop_holds_what_comes_to_disk_behind_it(house: Make) -> None:
    h = house(on_error='stop', answering=False)
    h.give(1)
    h.source.waiting.append(Message(b'bad', GID, 2, 0))
    h.take(3, 4)
    h.sink.away = 'Kafka is away'
    h.steps()
    come_back(h)
    with pytest.raises(RouteError, match='stopped'):
        h.steps()
    assert h.numbers() == [1]
    h.check_balance()


def test_on_error_stop_on_disk_stops_again_at_the_same_message(house: Make) -> None:
    h = house(on_error='stop', max_in_flight=3, away=True)
    h.take(*range(1, 31))
    for life in (h, None):
        one = life or house(on_error='stop', max_in_flight=3)
        one.sink.errors[b'3'] = [RecordTooLargeError(1, None, 'of the topic')] * 2
        come_back(one)
        with pytest.raises(RouteError, match=r'stopped, as on_error says$'):
            one.steps(50)
        one.check_balance()
        assert one.numbers() == ([1, 2] if one is h else [])
        one.crash()
    mended = house().until_all_confirmed()
    assert mended.numbers() == list(range(3, 31))


def test_what_cannot_be_deleted_at_the_end_is_counted_as_taken_again(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'mode': 'always'}, drain_s=0.0, answering=False)
    h.take(*range(1, 6))
    third = [*h.pipeline._flight][2]
    h.pipeline._flight.end([third], Outcome.CONFIRMED)

    def refuse(*_: object, **__: object) -> int:
        raise TransportError('the disk is full')

    monkeypatch.setattr(h.spool, 'discard_between', refuse)
    h.drain()
    assert (h.count('taken'), h.count('spooled')) == (6, 5)
