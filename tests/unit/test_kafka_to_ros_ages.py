"""How old a record is where `max_age_s` asks for it: neither writers nor clocks are believed."""

import time
from collections.abc import Callable

import pytest
from support.worlds.pipeline_to_ros import IN_2001_MS, House

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route import clock
from ros2_kafka_bridge.testing.memory import MemoryMessageSink, MemoryRecord

pytestmark = pytest.mark.usefixtures('no_settle_time')

HOUR_S = 3600.0
IN_1970_S = 20.0

SetClock = Callable[[float], None]


@pytest.fixture
def set_clock(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    """Set the time of day, which goes on from there."""
    began_s = time.monotonic()

    def set_to(now_s: float) -> None:
        ahead_s = now_s - (time.monotonic() - began_s)
        monkeypatch.setattr(time, 'time', lambda: ahead_s + time.monotonic() - began_s)

    return set_to


def now_ms(ahead_s: float = 0.0) -> int:
    return int((time.time() + ahead_s) * 1000)


def reasons(house: House) -> list[str]:
    return [str(dict(letter.headers)['dead_letter.error']) for letter in house.letters.records]


@pytest.mark.parametrize('on_error', ['dead_letter', 'drop'])
@pytest.mark.parametrize(
    ('time_ms', 'span'),
    [
        (lambda: now_ms(301), '5 minutes'),
        (lambda: now_ms(2 * HOUR_S + 9), '2 hours'),
        (lambda: now_ms(25 * HOUR_S), '1 day'),
        (lambda: now_ms() * 1000, 'years'),  # microseconds
        (lambda: now_ms() * 1_000_000, 'years'),  # nanoseconds
        (lambda: 2**63 - 1, 'years'),
    ],
)
def test_a_record_from_the_future_is_a_dead_letter_and_never_dropped(
    time_ms: Callable[[], int], span: str, on_error: str
) -> None:
    house = House(max_age_s=60, on_error=on_error)
    house.give(b'ahead', time_ms=time_ms())
    house.take(b'now', first=1, time_ms=now_ms())
    assert house.sink.published == [b'cdr:now']
    (reason,) = reasons(house)
    assert reason.startswith('TimestampError: its timestamp is more than ')
    assert f'{span} ahead of this machine' in reason
    assert house.letters.records[0].value == b'ahead'
    snapshot = house.pipeline.counters.snapshot(0)
    assert (snapshot.dead_lettered, snapshot.dropped) == (1, 0)
    assert house.positions() == {0: 2}


@pytest.mark.parametrize('time_ms', [-1, 1, 1_700_000_000, -(2**62)])
def test_a_timestamp_that_is_no_time_in_milliseconds_is_a_dead_letter(time_ms: int) -> None:
    house = House(max_age_s=60)
    house.take(b'in seconds', time_ms=time_ms)
    assert not house.sink.published
    assert reasons(house)[0].startswith('TimestampError: its timestamp lies before 2001, so max_')


def test_a_writer_whose_clock_is_wrong_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    house = House(max_age_s=60)
    for offset in range(50):
        house.give(b'ahead', first=offset, time_ms=now_ms(HOUR_S * (2 + offset)))
    house.steps()
    assert len(house.letters.records) == 50
    assert len([line for line in caplog.messages if 'ahead of this machine' in line]) == 1


def test_who_may_be_a_little_ahead_is_believed() -> None:
    house = House(max_age_s=60)
    house.take(b'a', time_ms=now_ms(290))
    assert house.sink.published == [b'cdr:a']


def test_a_route_that_does_not_ask_how_old_a_record_is_takes_any_time() -> None:
    house = House()
    for offset, time_ms in enumerate((-1, 1, 2**63 - 1, now_ms() * 1000)):
        house.give(b'a', first=offset, time_ms=time_ms)
    house.steps()
    assert house.sink.published == [b'cdr:a'] * 4


@pytest.mark.parametrize('jump_s', [-HOUR_S, HOUR_S, 24 * 365 * HOUR_S])
def test_what_waits_grows_neither_older_nor_younger_when_the_clock_is_set(
    jump_s: float, set_clock: SetClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    house = House(MemoryMessageSink(matched=0), max_age_s=60)
    house.give(b'first', time_ms=now_ms(-50))
    house.take(b'second', first=1, time_ms=now_ms())
    set_clock(time.time() + jump_s)
    ns = clock.since_boot_ns
    monkeypatch.setattr(clock, 'since_boot_ns', lambda: ns() + 20_000_000_000)
    house.sink.matched = 1
    house.steps()
    assert house.sink.published == [b'cdr:second']
    assert house.pipeline.counters.snapshot(0).dropped == 1


@pytest.mark.parametrize('when_full', ['wait', 'drop_oldest'])
def test_a_route_waits_while_this_machine_does_not_know_what_time_it_is(
    when_full: str, set_clock: SetClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    today_s = time.time()
    set_clock(IN_1970_S)
    house = House(max_age_s=60, when_full=when_full, max_in_flight=2)
    for offset in range(10):
        house.give(b'%d' % offset, first=offset, time_ms=int(today_s * 1000))
    house.take(b'old', first=10, time_ms=IN_2001_MS)
    monkeypatch.setattr('ros2_kafka_bridge.route.obstacle.SAID_AFTER_S', -1.0)
    house.steps()
    snapshot = house.pipeline.counters.snapshot(0)
    assert (snapshot.taken, snapshot.dropped, snapshot.dead_lettered) == (0, 0, 0)
    obstacle = house.pipeline._publish_ready()
    assert obstacle is not None
    assert obstacle.reason.startswith("max_age_s: this machine's clock says 1970-01-01, and this")
    set_clock(today_s)
    house.steps(20)
    assert house.sink.published == [b'cdr:%d' % offset for offset in range(10)]
    assert house.pipeline.counters.snapshot(0).dropped == 1


def test_what_comes_while_the_clock_is_wrong_is_read_again(set_clock: SetClock) -> None:
    today_s = time.time()
    set_clock(IN_1970_S)
    house = House(max_age_s=60)
    record = MemoryRecord(b'a', time_ms=int(today_s * 1000))
    house.pipeline._accept_all([record])  # of a partition that has come meanwhile
    house.pipeline._settle()
    with pytest.raises(RouteError, match=r"^max_age_s: this machine's clock says 1970-01-01"):
        house.pipeline._step()
    assert house.positions() == {}
    assert not house.letters.records


def test_a_clock_is_wrong_that_shows_less_than_the_release(set_clock: SetClock) -> None:
    set_clock(clock.RELEASED.timestamp() - 1)
    assert 'set it (timedatectl, chronyc makestep)' in clock.problem()
    set_clock(-1e9)
    assert 'says 1970-01-01' in clock.problem()
    set_clock(clock.RELEASED.timestamp() + 1)
    assert not clock.problem()
