"""The direction ROS -> Kafka with a spool on disk, driven step by step with ends in memory."""

import logging
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.writer import DeadLetters
from ros2_kafka_bridge.dedup import Numbers
from ros2_kafka_bridge.endpoints import Message, Reports
from ros2_kafka_bridge.errors import EncodeError, RecordTooLargeError, RouteError, TransportError
from ros2_kafka_bridge.formats import guarded
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.message_window import MessageEntry
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.type_hash import check_nothing
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spool.store import Row, Spool, file_of
from ros2_kafka_bridge.testing.memory import MemoryMessageSource, MemoryRecordSink
from ros2_kafka_bridge.threads.stop import Stop

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


def encode(cdr: bytes) -> bytes:
    if cdr.startswith(b'bad'):
        raise EncodeError('not what it should be')
    return cdr


class Moody(MemoryRecordSink[MessageEntry]):
    """A sink whose broker refuses all that is in flight, so many times.

    Never one of several: an idempotent producer does not deliver what is behind a failure.
    """

    refusals = 0

    def poll(self, timeout_s: float) -> Reports[MessageEntry]:
        if not self.refusals or not self.answering or not self._in_flight:
            return super().poll(timeout_s)
        self.refusals -= 1
        refused, self._in_flight = self._in_flight, []
        return Reports([], [(entry, TransportError('timed out')) for entry, _ in refused])


class NoTail:
    """The end of a topic that holds `found`, once it is read."""

    topic = 'orders'
    complete = True
    since_ns = 0.0

    def __init__(self) -> None:
        self.records = 0
        self.partitions = 0
        self.numbers: dict[bytes, Numbers] = {}
        self.found = Numbers()

    def read(self, records: int, within_s: float) -> None:
        del within_s
        self.records, self.partitions = records, 1
        self.numbers = {b'gid': self.found}


class House:
    """One life of a direction, with a spool in `place`."""

    def __init__(self, place: Path, spool: dict[str, Any] | None = None, **more: Any) -> None:
        self.source = MemoryMessageSource()
        self.sink = Moody()
        self.tail = NoTail()
        self.letters: MemoryRecordSink[Any] = MemoryRecordSink()
        self.clock = 0
        route = RosToKafkaRoute.model_validate(
            {
                'name': 'orders',
                'from': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
                'to': {'kafka': 'orders'},
                'format': 'text',
                'spool': {'path': str(place), **(spool or {})},
                **more,
            }
        )
        self.sink.room = route.max_in_flight  # as that of the real producer
        self.spool = Spool(file_of(place, 'test', route.name), sync=False, log=LOG)
        self.direction = RosToKafka(
            route,
            self.source,
            Produced(self.tail, NoTail(), LOG),
            self.sink,
            lambda: guarded(encode, route.max_message_bytes, EncodeError),
            lambda _: b'key',
            lambda message: [('ros.seq', b'%d' % message.seq)],
            check_nothing,
            DeadLetters('orders.dead', self.letters, lambda: None, LOG),
            Backlog(self.spool, route.spool, LOG, drops=route.when_full == 'drop_oldest'),
            LOG,
        )
        self.direction._prepare()
        self._opened = self.direction._opened()
        self._opened.__enter__()

    def give(self, *numbers: int) -> None:
        for number in numbers:
            self.source.waiting.append(Message(b'%d' % number, b'gid', number, 0))

    def steps(self, count: int = 4) -> None:
        for _ in range(count):
            self.direction._step()
            self.check_balance()

    def until_all_confirmed(self) -> None:
        for _ in range(1000):
            self.steps(1)
            if not self.direction._window and not self.direction._spooling.waiting:
                return
        pytest.fail('it never ends')

    def until_all_taken_are_confirmed(self) -> None:
        for _ in range(1000):
            self.steps(1)
            if not self.source.waiting:
                break
        else:
            pytest.fail('the robots are held back for ever')
        self.until_all_confirmed()

    def check_balance(self) -> None:
        self.direction._take_snapshot()
        snapshot = self.direction.snapshot
        assert snapshot.balanced, snapshot
        assert all(count >= 0 for count in snapshot if isinstance(count, int)), snapshot

    def crash(self) -> None:
        """Leave everything as a SIGKILL would."""
        self.direction._spooling._backlog._is_open = False
        self.spool._file._close_database()
        self.spool._file._lock.release()

    def drain(self, stop: Stop | None = None) -> None:
        stop = stop or Stop()
        stop.ask()
        self.direction._drain(stop)
        self.check_balance()
        self._opened.__exit__(None, None, None)

    def fail_and_run_again(self) -> None:
        """Let the run end with an error, and begin the next."""
        error = RouteError('no permission')
        assert not self._opened.__exit__(RouteError, error, None)
        self._opened = self.direction._opened()
        self._opened.__enter__()

    def numbers(self) -> list[int]:
        return [int(record.value or b'0') for record in self.sink.records]

    def count(self, name: str) -> int:
        self.direction._take_snapshot()
        return int(getattr(self.direction.snapshot, name))

    def on_disk(self) -> list[int]:
        return [row.number for row in self.spool.read(0, 1_000_000, 1 << 40)]


@pytest.fixture
def house(tmp_path: Path) -> Callable[..., House]:
    def make(spool: dict[str, Any] | None = None, **more: Any) -> House:
        return House(tmp_path, spool, **more)

    return make


def go_away(house: House) -> None:
    house.sink.away, house.sink.answering = 'Kafka is away', False


def come_back(house: House) -> None:
    house.sink.away, house.sink.answering = '', True


Make = Callable[..., House]


def test_while_kafka_takes_messages_none_is_on_the_disk(house: Make) -> None:
    h = house()
    h.give(*range(1, 50))
    h.steps()
    assert h.numbers() == list(range(1, 50))
    assert (h.spool.last, h.spool.count) == (0, 0)


def test_while_kafka_is_away_messages_go_to_disk_and_from_there_to_kafka_in_order(
    house: Make,
) -> None:
    h = house(max_in_flight=10)
    go_away(h)
    h.give(*range(1, 101))
    h.steps(8)
    assert not h.source.waiting, 'the robots are held back'
    assert h.count('taken') == 100
    assert h.count('in_flight') + h.count('spooled') == 100
    assert h.count('in_flight') <= 10
    come_back(h)
    h.give(*range(101, 111))  # live traffic waits behind the backlog
    h.until_all_confirmed()
    assert h.numbers() == list(range(1, 111))
    assert h.count('spooled') == 0


def test_what_was_in_flight_when_kafka_went_away_is_on_disk_too(house: Make) -> None:
    h = house(max_in_flight=10)
    h.sink.answering = False
    h.give(1, 2, 3)
    h.steps()
    assert h.on_disk() == []
    go_away(h)
    h.steps()
    assert h.on_disk() == [1, 2, 3]
    h.crash()
    again = house()
    again.until_all_confirmed()
    assert again.numbers() == [1, 2, 3]
    assert (again.count('taken'), again.count('confirmed')) == (3, 3)


def test_a_window_that_stays_full_goes_to_disk_as_well(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock_s = [100.0]
    monkeypatch.setattr('ros2_kafka_bridge.spool.spooling.time.monotonic', lambda: clock_s[0])
    h = house(max_in_flight=3)
    h.sink.answering = False
    h.give(*range(1, 10))
    h.steps()
    assert (h.count('taken'), h.on_disk()) == (3, [])  # a moment is no reason
    clock_s[0] += 1.5
    h.steps()
    assert h.count('taken') == 9
    assert h.on_disk() == list(range(1, 10))
    h.sink.answering = True
    h.until_all_confirmed()
    assert h.numbers() == list(range(1, 10))


def test_the_disk_is_left_alone_again_once_the_backlog_is_delivered(house: Make) -> None:
    h = house()
    go_away(h)
    h.give(1, 2)
    h.steps()
    come_back(h)
    h.until_all_confirmed()
    h.steps()
    last = h.spool.last
    h.give(3, 4)
    h.steps()
    assert h.numbers() == [1, 2, 3, 4]
    assert h.spool.last in {0, last}


def test_always_writes_before_it_produces_and_a_crash_loses_nothing_that_was_taken(
    house: Make,
) -> None:
    h = house({'mode': 'always'})
    h.sink.answering = False
    h.give(1, 2, 3)
    h.steps()
    assert h.on_disk() == [1, 2, 3]
    h.crash()
    again = house({'mode': 'always'})
    again.give(4)
    again.until_all_confirmed()
    assert again.numbers() == [1, 2, 3, 4]
    again.drain()
    assert again.spool.count == 0


def test_a_drain_while_kafka_is_away_leaves_everything_on_disk_and_gives_nothing_up(
    house: Make,
) -> None:
    h = house(max_in_flight=5, drain_s=0.3)
    h.sink.answering = False
    h.give(*range(1, 4))
    h.steps()
    h.give(*range(4, 30))
    go_away(h)
    h.drain()
    assert (h.count('in_flight'), h.count('spooled'), h.count('taken')) == (0, 29, 29)
    again = house()
    again.until_all_confirmed()
    assert again.numbers() == list(range(1, 30))


class HandOver(Stop):
    """Another bridge goes on with the route, and this one lives."""

    is_end = False


def test_guarantee_1_a_hand_over_with_a_full_spool_waits_until_it_has_room(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'max_bytes': 1000}, max_in_flight=2, drain_s=0.3)
    go_away(h)
    h.give(*range(1, 1000))
    h.steps(20)
    assert h.direction._spooling.full
    assert h.source.waiting, 'which nobody else has'
    back_at_s, poll = time.monotonic() + 0.6, h.sink.poll

    def look(timeout_s: float) -> Reports[Any]:
        if time.monotonic() > back_at_s:
            come_back(h)
        return poll(timeout_s)

    monkeypatch.setattr(h.sink, 'poll', look)
    h.drain(HandOver())
    assert not h.source.waiting
    again = house()
    again.until_all_confirmed()
    assert h.numbers() + again.numbers() == list(range(1, 1000))


def test_a_full_spool_holds_the_publishers_back(house: Make) -> None:
    h = house({'max_bytes': 1000}, max_in_flight=2)
    go_away(h)
    h.give(*range(1, 1000))
    h.steps(20)
    assert h.source.waiting
    assert 'the spool is full (max_bytes: 1000)' in str(h.direction._spooling.full)
    come_back(h)
    for _ in range(200):
        h.steps(10)
        if not h.source.waiting and not h.count('in_flight') and not h.count('spooled'):
            break
    assert h.numbers() == list(range(1, 1000))


def test_a_full_spool_drops_the_oldest_where_the_route_says_so_and_counts_them(
    house: Make,
) -> None:
    h = house({'max_bytes': 2000}, max_in_flight=2, when_full='drop_oldest')
    go_away(h)
    h.give(*range(1, 601))
    h.steps(20)
    assert not h.source.waiting
    dropped = h.count('dropped')
    assert dropped > 0
    come_back(h)
    h.until_all_confirmed()
    assert h.numbers()[-1] == 600
    assert h.numbers() == sorted(h.numbers())
    assert len(h.numbers()) + h.count('dropped') == 600


def test_a_full_window_drops_nothing_while_the_disk_has_room(house: Make) -> None:
    h = house(max_in_flight=2, when_full='drop_oldest')
    h.sink.answering = False
    h.give(*range(1, 100))
    h.steps(10)
    assert h.count('dropped') == 0
    go_away(h)
    h.steps(10)
    assert (h.count('taken'), h.count('dropped')) == (99, 0)


def test_what_is_too_old_on_disk_is_dropped_and_counted(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._LOOK_S', 0.0)
    h = house({'max_age_s': 0.001}, max_in_flight=1)
    go_away(h)
    h.give(1, 2, 3)
    h.steps()
    h.steps(200)
    come_back(h)
    h.until_all_confirmed()
    assert h.numbers() == [1]
    assert h.count('dropped') == 2


def test_a_disk_that_takes_nothing_loses_nothing(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house(max_in_flight=3)
    append, full = h.spool.append, [True]

    def sometimes(rows: list[Row]) -> None:
        if full[0]:
            raise TransportError('the disk is full')
        append(rows)

    monkeypatch.setattr(h.spool, 'append', sometimes)
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    go_away(h)
    h.give(1, 2)
    h.steps()
    h.give(*range(3, 1003))
    h.steps()
    assert h.count('taken') < 1002, 'it cannot all be in memory'
    assert h.direction._spooling._backlog.problem == 'the disk is full'
    full[0] = False
    h.steps(10)
    assert not h.source.waiting
    come_back(h)
    h.until_all_confirmed()
    assert h.numbers() == list(range(1, 1003))


def test_what_was_confirmed_while_the_disk_was_full_is_not_written_any_more(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house()
    append = h.spool.append
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)

    def refuse(_: object) -> None:
        raise TransportError('the disk is full')

    monkeypatch.setattr(h.spool, 'append', refuse)
    h.sink.answering = False
    h.give(1, 2)
    h.steps()
    h.sink.away = 'Kafka is away'
    h.steps()
    come_back(h)
    h.steps()
    monkeypatch.setattr(h.spool, 'append', append)
    h.give(3)
    h.until_all_confirmed()
    assert h.numbers() == [1, 2, 3]


def refused(rows: Sequence[Row]) -> None:
    del rows
    raise TransportError('the disk is full')


def fill(house: House) -> None:
    """Let the disk take nothing from now on."""
    house.spool.append = refused  # type: ignore[method-assign]


def fill_while_away(house: House, *numbers: int) -> None:
    """Let the disk fill up while Kafka is away, and the messages of those numbers come then."""
    go_away(house)
    house.give(0)
    house.steps()
    fill(house)
    house.give(*numbers)
    house.steps()


def test_what_a_full_disk_did_not_take_goes_on_once_kafka_is_back(house: Make) -> None:
    h = house(max_in_flight=3)
    fill_while_away(h, *range(1, 101))
    come_back(h)
    h.give(*range(101, 201))
    h.until_all_taken_are_confirmed()
    assert h.numbers() == list(range(201))


def test_what_a_full_disk_did_not_take_waits_for_what_is_on_it(house: Make) -> None:
    h = house(max_in_flight=3)
    go_away(h)
    h.give(*range(1, 21))
    h.steps()
    fill(h)
    h.give(*range(21, 31))
    h.steps()
    come_back(h)
    h.give(*range(31, 41))
    h.until_all_taken_are_confirmed()
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
    again = house()
    again.until_all_confirmed()
    assert again.numbers() == list(range(11))


def test_a_full_disk_is_said_again_when_kafka_is_away_again(
    house: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house()
    for number in (1, 2):
        fill_while_away(h, number)
        come_back(h)
        h.until_all_confirmed()
        h.steps()
    assert [r.levelname for r in caplog.records].count('ERROR') == 2


def test_always_lets_nothing_past_a_full_disk(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house({'mode': 'always'})
    fill(h)
    h.give(1, 2, 3)
    h.steps(10)
    assert h.numbers() == []
    del h.spool.append
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [1, 2, 3]


def test_a_dead_letter_that_cannot_be_written_holds_up_nothing_that_a_full_disk_did_not_take(
    house: Make,
) -> None:
    h = house()
    h.letters.limit_bytes = -1  # its topic cannot be written
    h.source.waiting.append(Message(b'bad', b'gid', 100, 0))
    fill_while_away(h, 1, 2, 3)
    come_back(h)
    h.steps(10)
    assert h.direction._dead_letters.problem
    assert h.numbers() == [0, 1, 2, 3]


def test_drop_oldest_keeps_the_newest_of_what_a_full_disk_does_not_take(house: Make) -> None:
    h = house(when_full='drop_oldest', max_in_flight=3)
    fill_while_away(h, *range(1, 101))
    come_back(h)
    h.until_all_taken_are_confirmed()
    assert h.numbers() == [0, 98, 99, 100]
    assert h.count('dropped') == 97


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
    h = house(max_in_flight=3, drain_s=5)
    go_away(h)
    h.give(*range(1, 101))
    h.steps()
    fill(h)
    h.give(*range(101, 111))
    h.steps()
    come_back(h)
    h.drain()
    assert h.numbers() == list(range(1, 111))


def test_a_dead_letter_waits_on_disk_like_the_others(house: Make) -> None:
    h = house()
    go_away(h)
    h.letters.answering = False
    h.give(1)
    h.source.waiting.append(Message(b'bad', b'gid', 2, 0))
    h.give(3)
    h.steps()
    h.crash()
    again = house()
    again.until_all_confirmed()
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
    h.give(1, 2, 3)
    h.until_all_confirmed()
    assert (h.numbers(), h.count('dead_lettered')) == ([1, 3], 1)


def test_what_a_latched_publisher_sends_again_is_skipped_while_it_is_on_disk(
    house: Make,
) -> None:
    h = house()
    go_away(h)
    h.give(1, 2, 3)
    h.steps()
    h.crash()
    again = house()
    again.give(1, 2, 3, 4)
    again.until_all_confirmed()
    assert again.numbers() == [1, 2, 3, 4]
    assert again.count('skipped') == 3


@pytest.mark.parametrize(('latched', 'sent'), [(False, [1, 4, 5]), (True, [4, 5])])
def test_what_was_in_flight_at_a_crash_and_is_in_kafka_is_not_sent_again(
    sent: list[int], house: Make, *, latched: bool
) -> None:
    h = house({'mode': 'always'})
    h.sink.answering = False
    h.give(*range(1, 6))
    h.steps()
    h.crash()
    again = house({'mode': 'always'})
    for number in (1, 2, 3):
        again.tail.found.add(number)
    if latched:
        again.tail.read(10, 1)  # for the history of a publisher
    again.until_all_confirmed()
    assert again.numbers() == sent, 'the first one shows that Kafka answers'
    assert (again.count('skipped'), again.count('taken')) == (5 - len(sent), 5)


def test_a_route_that_fails_and_runs_again_sends_nothing_twice(house: Make) -> None:
    h = house(max_in_flight=4)
    go_away(h)
    h.give(*range(1, 20))
    h.steps()
    h.fail_and_run_again()
    come_back(h)
    h.give(20)
    h.until_all_confirmed()
    assert h.numbers() == list(range(1, 21))


def test_what_came_back_from_disk_keeps_its_place_where_kafka_goes_away_at_once(
    house: Make,
) -> None:
    """All brokers restart: the client of the next run has a record, and learns of it only then."""
    h = house(max_in_flight=10)
    go_away(h)
    h.give(*range(1, 7))
    h.steps(6)
    h.fail_and_run_again()
    h.sink.away, h.sink.room = '', 1
    h.steps(2)
    assert (h.count('in_flight'), h.count('spooled')) == (6, 0)
    h.sink.away = 'Kafka is away'
    h.steps(2)
    come_back(h)
    h.give(*range(7, 12))
    h.until_all_taken_are_confirmed()
    assert h.numbers() == list(range(1, 12))


def test_on_error_stop_keeps_what_was_behind_for_the_next_start(house: Make) -> None:
    h = house(on_error='stop')
    h.give(1)
    h.source.waiting.append(Message(b'bad', b'gid', 2, 0))
    h.give(3, 4)
    with pytest.raises(RouteError, match=r'be; stopped, as on_error says$'):
        h.steps()
    assert h.count('spooled') == 2
    h.check_balance()
    h.crash()
    again = house()
    again.until_all_confirmed()
    assert again.numbers() == [3, 4]


def test_on_error_stop_waits_for_what_is_on_disk_before_it(house: Make) -> None:
    h = house(on_error='stop', max_in_flight=1)
    go_away(h)
    h.give(1, 2, 3)
    h.steps()
    h.source.waiting.append(Message(b'bad', b'gid', 4, 0))
    h.steps()
    come_back(h)
    with pytest.raises(RouteError, match='stopped'):
        h.steps(20)
    assert h.numbers() == [1, 2, 3]


def test_a_backlog_goes_on_after_the_first_of_it_met_a_failed_route(house: Make) -> None:
    h = house()
    go_away(h)
    h.give(*range(1, 11))
    h.steps()
    h.crash()
    again = house()
    go_away(again)
    again.steps()
    again.fail_and_run_again()
    come_back(again)
    again.until_all_confirmed()
    assert again.numbers() == list(range(1, 11))


@pytest.mark.parametrize('mode', ['always', 'when_away'])
def test_what_kafka_confirms_at_the_very_end_is_counted_and_not_sent_again(
    house: Make, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'mode': mode}, drain_s=0.0)
    h.sink.answering = False
    h.give(*range(1, 11))
    h.steps()
    h.sink.answering = True
    h.sink.delivered_at_close = 4
    monkeypatch.setattr(h.sink, 'poll', lambda _: Reports([], []))
    h.drain()
    assert (h.count('confirmed'), h.count('spooled'), h.count('in_flight')) == (4, 6, 0)
    again = house({'mode': mode})
    again.until_all_confirmed()
    assert h.numbers() + again.numbers() == list(range(1, 11))


def test_on_error_stop_lets_nothing_pass_through_a_failure_in_between(house: Make) -> None:
    h = house(on_error='stop')
    h.sink.answering = False
    h.give(1)
    h.steps()
    h.source.waiting.append(Message(b'bad', b'gid', 2, 0))
    h.give(3, 4)
    h.steps()
    h.fail_and_run_again()
    h.sink.answering = True
    with pytest.raises(RouteError, match='stopped'):
        h.steps()
    assert h.numbers() == [1]
    assert h.count('spooled') == 2


def test_on_error_stop_holds_what_comes_to_disk_behind_it(house: Make) -> None:
    h = house(on_error='stop')
    h.sink.answering = False
    h.give(1)
    h.source.waiting.append(Message(b'bad', b'gid', 2, 0))
    h.give(3, 4)
    h.steps()
    h.sink.away = 'Kafka is away'
    h.steps()
    come_back(h)
    with pytest.raises(RouteError, match='stopped'):
        h.steps()
    assert h.numbers() == [1]
    h.check_balance()


def test_on_error_stop_on_disk_stops_again_at_the_same_message(house: Make) -> None:
    h = house(on_error='stop', max_in_flight=3)
    go_away(h)
    h.give(*range(1, 31))
    h.steps()
    for life in (h, None):
        one = life or house(on_error='stop', max_in_flight=3)
        one.sink.errors[b'3'] = [RecordTooLargeError(1, None, 'of the topic')] * 2
        come_back(one)
        with pytest.raises(RouteError, match=r'stopped, as on_error says$'):
            one.steps(50)
        one.check_balance()
        assert one.numbers() == ([1, 2] if one is h else [])
        one.crash()
    mended = house()
    mended.until_all_confirmed()
    assert mended.numbers() == list(range(3, 31))


def test_a_disk_that_was_full_and_is_not_gets_only_what_is_newer(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
    h = house(when_full='drop_oldest', max_in_flight=3, drain_s=0.0)
    append = h.spool.append

    def refuse(_: object) -> None:
        raise TransportError('the disk is full')

    monkeypatch.setattr(h.spool, 'append', refuse)
    h.sink.answering = False
    h.give(1, 2, 3)
    h.steps()
    go_away(h)
    h.give(*range(4, 30))
    h.steps()
    monkeypatch.setattr(h.spool, 'append', append)
    h.give(*range(30, 40))
    h.steps()
    h.drain()
    again = house()
    again.until_all_confirmed()
    assert again.numbers()[:3] == [1, 2, 3]
    assert again.numbers()[-1] == 39
    assert again.numbers() == sorted(again.numbers())


def test_a_dead_letter_that_cannot_be_written_holds_no_robot_back(house: Make) -> None:
    h = house()
    h.letters.limit_bytes = -1  # its topic cannot be written
    h.source.waiting.append(Message(b'bad', b'gid', 1, 0))
    h.give(*range(2, 100))
    h.steps()
    h.give(*range(100, 200))
    h.steps(10)
    assert not h.source.waiting
    assert h.numbers() == list(range(2, 200))
    h.check_balance()


def test_what_cannot_be_deleted_at_the_end_is_counted_as_taken_again(
    house: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    h = house({'mode': 'always'}, drain_s=0.0)
    h.sink.answering = False
    h.give(*range(1, 6))
    h.steps()
    held = h.direction._window.entries
    h.direction._end(held[3], Outcome.CONFIRMED)

    def refuse(*_: object, **__: object) -> int:
        raise TransportError('the disk is full')

    monkeypatch.setattr(h.spool, 'discard_between', refuse)
    h.drain()
    assert (h.count('taken'), h.count('spooled')) == (6, 5)


Event = tuple[str, int]
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just('give'), st.integers(1, 40)),
        st.tuples(st.just('steps'), st.integers(1, 5)),
        st.tuples(st.sampled_from(['away', 'back', 'deaf', 'fail', 'stop', 'crash']), st.just(0)),
        st.tuples(st.sampled_from(['full', 'not full', 'late']), st.integers(1, 9)),
        st.tuples(st.just('refuse'), st.integers(1, 3)),
    ),
    max_size=40,
)


@settings(max_examples=60)
@given(events=EVENTS, always=st.booleans(), window=st.integers(1, 12))
def test_whatever_happens_each_message_arrives_in_order(
    events: list[Event], window: int, *, always: bool
) -> None:
    with TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        patch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
        world = World(Path(place), 'always' if always else 'when_away', window)
        for event in events:
            world.happens(*event)
        world.ends()


class World:
    """A publisher that never repeats itself, and lives of the bridge one after the other."""

    def __init__(self, place: Path, mode: str, window: int) -> None:
        self._place, self._mode, self._window = place, mode, window
        self._number = 0
        self._repeats = False
        self._maybe_lost: set[int] = set()
        self._arrived: list[int] = []
        self._house = self._begin()

    def _begin(self) -> House:
        return House(self._place, {'mode': self._mode}, max_in_flight=self._window, drain_s=0.0)

    def happens(self, what: str, count: int) -> None:
        house = self._house
        if what == 'give':
            house.give(*range(self._number + 1, self._number + count + 1))
            self._number += count
        elif what in {'stop', 'crash'}:
            self._next_life(what)
        else:
            self._to_the_house(house, what, count)

    def _to_the_house(self, house: House, what: str, count: int) -> None:
        if what == 'steps':
            house.steps(count)
        elif what == 'away':
            go_away(house)
        elif what == 'back':
            come_back(house)
        elif what == 'deaf':
            house.sink.answering = False
        elif what == 'refuse':
            house.sink.refusals = count
        elif what == 'full':
            fill(house)
        elif what == 'not full':
            house.spool.__dict__.pop('append', None)
        elif what == 'late':
            house.sink.delivered_at_close = count
        else:
            assert what == 'fail'
            house.fail_and_run_again()

    def _next_life(self, end: str) -> None:
        house, waiting = self._house, list(self._house.source.waiting)
        if end == 'crash':
            self._repeats = True
            window = house.direction._window.entries.values()
            held = {int(entry.record.value or 0) for entry in window}
            on_disk = {int(r.record.value or 0) for r in house.spool.read(0, 10**6, 1 << 40)}
            was_full = 'append' in house.spool.__dict__
            assert self._mode == 'when_away' or was_full or held <= on_disk
            self._maybe_lost |= held - on_disk
            house.crash()
        else:
            house.spool.__dict__.pop('append', None)
            house.drain()
            waiting = list(house.source.waiting)
        self._arrived += house.numbers()
        self._house = self._begin()
        self._house.source.waiting.extend(waiting)

    def ends(self) -> None:
        come_back(self._house)
        if self._mode == 'always':  # otherwise a disk that takes nothing holds up nothing
            self._house.spool.__dict__.pop('append', None)
        for _ in range(100):
            self._house.steps(10)
            if not self._house.source.waiting:
                break
        self._house.until_all_confirmed()
        arrived = self._arrived + self._house.numbers()
        first = list(dict.fromkeys(arrived))
        assert set(range(1, self._number + 1)) - set(first) <= self._maybe_lost
        assert first == sorted(first)
        if not self._repeats:
            assert len(first) == len(arrived)
        self._house.drain()


def test_what_an_earlier_life_has_left_is_measured_when_it_is_sent(house: Make) -> None:
    h = house()
    go_away(h)
    h.give(*range(1, 101))
    h.steps()
    measures = h.direction.snapshot.measures
    assert measures.bytes_taken == 192
    assert measures.spool_bytes > 192
    h.crash()
    again = house()
    again.until_all_confirmed()
    again.give(*range(101, 111))
    again.until_all_confirmed()
    again.direction._show('')
    measures = again.direction.snapshot.measures
    assert measures.bytes_taken == measures.bytes_confirmed == 192 + 30
    assert sum(measures.in_bridge.counts) == sum(measures.round_trip.counts) == 110
