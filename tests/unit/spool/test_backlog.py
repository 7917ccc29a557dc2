"""From ROS over the disk to Kafka, in order."""

import pytest
from support.kafka.identities import record_by
from support.worlds.pipeline_to_kafka import House as HouseWithoutSpool
from support.worlds.pipeline_with_spool import GID, LOG, Make, come_back, go_away, go_on, made_ns

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.errors import RecordTooLargeError
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.spool.backlog import Backlog


def test_while_kafka_takes_messages_none_is_on_the_disk(house: Make) -> None:
    h = house()
    h.take(*range(1, 50))
    assert h.numbers() == list(range(1, 50))
    assert (h.spool.last, h.spool.count) == (0, 0)


def test_while_kafka_is_away_messages_go_to_disk_and_from_there_to_kafka_in_order(
    house: Make,
) -> None:
    h = house(max_in_flight=10, away=True)
    h.take(*range(1, 101), steps=8)
    assert not h.source.waiting, 'the robots are held back'
    assert h.count('taken') == 100
    assert h.count('in_flight') + h.count('spooled') == 100
    assert h.count('in_flight') <= 10
    come_back(h)
    h.until_all_confirmed(*range(101, 111))  # live traffic waits behind the backlog
    assert h.numbers() == list(range(1, 111))
    assert h.count('spooled') == 0


def test_what_was_in_flight_when_kafka_went_away_is_on_disk_too(house: Make) -> None:
    h = house(max_in_flight=10, answering=False)
    h.take(1, 2, 3)
    assert h.on_disk() == []
    go_away(h)
    h.steps()
    assert h.on_disk() == [1, 2, 3]
    h.crash()
    again = house().until_all_confirmed()
    assert again.numbers() == [1, 2, 3]
    assert (again.count('taken'), again.count('confirmed')) == (3, 3)


def test_a_window_that_stays_full_goes_to_disk_as_well(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock_s = [100.0]
    monkeypatch.setattr('ros2_kafka_bridge.spool.spooling.time.monotonic', lambda: clock_s[0])
    h = house(max_in_flight=3, answering=False)
    h.take(*range(1, 10))
    assert (h.count('taken'), h.on_disk()) == (3, [])  # a moment is no reason
    clock_s[0] += 1.5
    h.steps()
    assert h.count('taken') == 9
    assert h.on_disk() == list(range(1, 10))
    h.sink.answering = True
    h.until_all_confirmed()
    assert h.numbers() == list(range(1, 10))


def test_the_disk_is_left_alone_again_once_the_backlog_is_delivered(house: Make) -> None:
    h = house(away=True)
    h.take(1, 2)
    go_on(h)
    h.steps()
    last = h.spool.last
    h.take(3, 4)
    assert h.numbers() == [1, 2, 3, 4]
    assert h.spool.last in {0, last}


def test_always_writes_before_it_produces_and_a_crash_loses_nothing_that_was_taken(
    house: Make,
) -> None:
    h = house({'mode': 'always'}, answering=False)
    h.take(1, 2, 3)
    assert h.on_disk() == [1, 2, 3]
    h.crash()
    again = house({'mode': 'always'})
    again.until_all_confirmed(4)
    assert again.numbers() == [1, 2, 3, 4]
    again.drain()
    assert again.spool.count == 0


def test_a_drain_while_kafka_is_away_leaves_everything_on_disk_and_gives_nothing_up(
    house: Make,
) -> None:
    h = house(max_in_flight=5, drain_s=0.3, answering=False)
    h.take(*range(1, 4))
    h.give(*range(4, 30))
    go_away(h)
    h.drain()
    assert (h.count('in_flight'), h.count('spooled'), h.count('taken')) == (0, 29, 29)
    again = house().until_all_confirmed()
    assert again.numbers() == list(range(1, 30))


def test_a_dead_letter_waits_on_disk_like_the_others(house: Make) -> None:
    h = house(away=True)
    h.letters.answering = False
    h.give(1)
    h.source.waiting.append(Message(b'bad', GID, 2, 0))
    h.take(3)
    h.crash()
    again = house().until_all_confirmed()
    assert again.numbers() == [1, 3]
    [letter] = again.letters.records
    assert (letter.topic, letter.value) == ('orders.dead', b'bad')
    assert dict(letter.headers)['dead_letter.source'] == '/orders'
    assert again.count('dead_lettered') == 1


def test_a_message_that_only_the_broker_finds_too_large_becomes_a_dead_letter_from_disk(
    house: Make,
) -> None:
    h = house({'mode': 'always'})
    h.sink.errors[b'2'] = [RecordTooLargeError(1, None, 'of the topic')] * 2
    h.until_all_confirmed(1, 2, 3)
    assert (h.numbers(), h.count('dead_lettered')) == ([1, 3], 1)


def test_what_a_latched_publisher_sends_again_is_skipped_while_it_is_on_disk(house: Make) -> None:
    h = house(away=True)
    h.take(1, 2, 3)
    h.crash()
    again = house()
    again.until_all_confirmed(1, 2, 3, 4)
    assert again.numbers() == [1, 2, 3, 4]
    assert again.count('skipped') == 3


@pytest.mark.parametrize(('latched', 'sent'), [(False, [1, 4, 5]), (True, [4, 5])])
def test_what_was_in_flight_at_a_crash_and_is_in_kafka_is_not_sent_again(
    sent: list[int], house: Make, *, latched: bool
) -> None:
    h = house({'mode': 'always'}, answering=False)
    h.take(*range(1, 6))
    h.crash()
    again = house({'mode': 'always'})
    for number in (1, 2, 3):
        again.tail.found.append(record_by(GID, number, made_ns(number)))
    if latched:
        again.pipeline._in_kafka.look_at_end()  # for the history of a publisher
    again.until_all_confirmed()
    assert again.numbers() == sent, 'the first one shows that Kafka answers'
    assert (again.count('skipped'), again.count('taken')) == (5 - len(sent), 5)


def test_a_dead_letter_that_cannot_be_written_holds_no_robot_back(house: Make) -> None:
    h = house()
    h.letters.limit_bytes = -1  # its topic cannot be written
    h.source.waiting.append(Message(b'bad', GID, 1, 0))
    h.take(*range(2, 100))
    h.take(*range(100, 200), steps=10)
    assert not h.source.waiting
    assert h.numbers() == list(range(2, 200))
    h.check_balance()


def test_what_an_earlier_life_has_left_is_measured_when_it_is_sent(house: Make) -> None:
    h = house(away=True)
    h.take(*range(1, 101))
    measures = h.pipeline.snapshot.measures
    assert measures.bytes_taken == 192
    assert (measures.spool_bytes or 0) > 192
    h.crash()
    again = house().until_all_confirmed()
    again.until_all_confirmed(*range(101, 111))
    measures = again.shown().measures
    assert measures.bytes_taken == measures.bytes_confirmed == 192 + 30
    assert sum(measures.in_bridge.counts) == sum(measures.round_trip.counts) == 110


def test_what_lies_on_disk_is_not_known_until_the_file_was_opened(house: Make) -> None:
    """As of a route that waits for a type or its turn, or may not open it: not 0, then."""
    h = house(away=True)
    h.take(*range(1, 21))
    h.crash()
    assert h.pipeline._route.spool is not None
    backlog = Backlog(h.spool, h.pipeline._route.spool, LOG)
    assert Counters('orders').snapshot(0).balanced
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(h.pipeline._spooling, '_backlog', backlog)
        h.pipeline._take_snapshot()
        now = h.pipeline.snapshot
        assert (now.spooled, now.measures.spool_bytes) == (None, None)
        backlog.open()
        on_disk = h.pipeline._spooling.on_disk
        assert on_disk == (20, h.spool.size_bytes)
        h.spool.close()
        assert h.pipeline._spooling.on_disk == on_disk, 'nobody else takes from it'


def test_a_route_without_a_spool_has_nothing_on_disk() -> None:
    assert HouseWithoutSpool().pipeline._spooling.on_disk == (0, 0)
