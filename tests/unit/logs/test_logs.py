"""Lines of the log: their fields, and the sums of what repeats."""

import itertools
import json
import logging
import os

import pytest
from support.worlds.clocks import Clock

from ros2_kafka_bridge.errors import About, DecodeError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.route.counters import Counters, Outcome, State
from ros2_kafka_bridge.route.rejections import about_labelled
from ros2_kafka_bridge.route.status import StatusLog

TRACE = '4bf92f3577b34da6a3ce929d0e0e4736'
LOG = logs.RouteLog(logging.getLogger('test'), 'to_ros')


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr('time.monotonic', clock.monotonic)
    return clock


# Sums


def test_the_first_lines_of_a_kind_are_said_at_once_and_the_others_once_a_period(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    sums = Summed(LOG, first=2, period_s=10.0)
    for number in range(6):
        sums.warning(f'orders[0]@{number}: broken')
    clock.now_s += 9
    sums.tick()
    assert caplog.messages == ['orders[0]@0: broken', 'orders[0]@1: broken']
    clock.now_s += 1
    sums.tick()
    assert caplog.messages[2:] == ['orders[0]@5: broken (4 times more)']


def test_a_flood_that_goes_on_takes_one_line_a_period(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    sums = Summed(LOG, first=2, period_s=10.0)
    for number in range(1000):
        sums.error(f'message {number} is broken')
        clock.now_s += 0.1
    assert len(caplog.messages) == 2 + 9
    assert all(message.endswith(' times more)') for message in caplog.messages[2:])


def test_the_rest_of_a_burst_is_said_at_the_end(caplog: pytest.LogCaptureFixture) -> None:
    sums = Summed(LOG, first=1)
    for number in range(3):
        sums.warning(f'orders[0]@{number}: broken')
    sums.close()
    sums.close()
    assert caplog.messages == ['orders[0]@0: broken', 'orders[0]@2: broken (2 times more)']


def test_nothing_is_lost_between_the_lines_that_are_said_and_the_sums(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    sums = Summed(LOG, first=3, period_s=10.0)
    for number in range(500):
        sums.warning(f'{"abcdefg"[number % 7]}: broken')
        clock.now_s += 0.37
        if number % 5 == 0:
            sums.tick()
    sums.close()
    told = sum(getattr(record, 'times', 1) for record in caplog.records)
    assert told == 500


def test_a_kind_that_was_quiet_for_a_period_begins_anew(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    sums = Summed(LOG, first=1, period_s=10.0)
    sums.warning('broken')
    clock.now_s += 10
    sums.tick()
    sums.warning('broken')
    assert caplog.messages == ['broken', 'broken']


def test_a_flood_of_one_kind_hides_no_other(caplog: pytest.LogCaptureFixture) -> None:
    sums = Summed(LOG, first=2)
    for number in range(10_000):
        sums.warning(f'orders[{number % 3}]@{number}: "{number}" is not UTF-8')
    sums.warning('orders[0]@7: written with another type')
    assert caplog.messages[2:] == ['orders[0]@7: written with another type']


def test_kinds_without_end_take_no_room_without_end(caplog: pytest.LogCaptureFixture) -> None:
    letters = 'abcdefghijkl'
    sums = Summed(LOG, first=1)
    for three in itertools.product(letters, repeat=3):
        sums.warning(''.join(three))
    assert len(caplog.messages) < 100
    sums.close()
    assert sum(getattr(record, 'times', 1) for record in caplog.records) == len(letters) ** 3


def test_all_who_sum_lines_of_a_route_share_the_sums_that_its_log_says_at_the_end(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO, 'ros2_kafka_bridge'):
        log = logs.route_log('orders')
        logging.getLogger('ros2_kafka_bridge').addHandler(caplog.handler)
        try:
            for _ in range(3):
                logs.summed(log, 1).warning('broken')
            log.close()
        finally:
            logging.getLogger('ros2_kafka_bridge').removeHandler(caplog.handler)
    said = [record for record in caplog.records if record.name == 'ros2_kafka_bridge']
    assert {record.getMessage() for record in said} == {'broken', 'broken (2 times more)'}
    assert {getattr(record, 'route', None) for record in said} == {'orders'}


# Lines


@pytest.mark.usefixtures('own_log')
def test_a_line_of_json_has_the_fields_of_the_record_that_it_is_about(
    capfd: pytest.CaptureFixture[str],
) -> None:
    logs.set_up('json', worker=2)
    about = About(
        topic='orders', partition=3, offset=14, gid='00' * 16, seq=9, trace_id=TRACE,
        error='DecodeError',
    )  # fmt: skip
    logs.route_log('to_ros').warning('%s', 'broken\x1b', extra={'about': about})
    (line,) = capfd.readouterr().err.splitlines()
    told = json.loads(line)
    assert told.pop('time').endswith('+00:00')
    assert told == {
        'level': 'warning',
        'pid': os.getpid(),
        'worker': 2,
        'thread': 'MainThread',
        'route': 'to_ros',
        'topic': 'orders',
        'partition': 3,
        'offset': 14,
        'gid': '00' * 16,
        'seq': 9,
        'trace_id': TRACE,
        'error': 'DecodeError',
        'message': 'broken\\x1b',
    }


@pytest.mark.usefixtures('own_log')
def test_a_sum_tells_how_many_it_stands_for(capfd: pytest.CaptureFixture[str]) -> None:
    logs.set_up('json')
    log = logs.route_log('to_ros')
    for number in range(3):
        logs.summed(log, 1).warning(f'{number}', about=About(offset=number))
    log.close()
    first, last = map(json.loads, capfd.readouterr().err.splitlines())
    assert (first['offset'], first.get('times')) == (0, None)
    assert (last['offset'], last['times']) == (2, 2)


@pytest.mark.usefixtures('own_log')
@pytest.mark.parametrize(('lag', 'also'), [(0, {'lag': 0}), (None, {})])
def test_the_status_of_a_route_has_its_figures_in_fields_of_their_own(
    clock: Clock, capfd: pytest.CaptureFixture[str], lag: int | None, also: dict[str, int]
) -> None:
    logs.set_up('json')
    counters = Counters('orders', state=State.WAITING, reason='Kafka is away')
    status = StatusLog(lambda: [counters.snapshot(12, lag)])
    counters.end(Outcome.CONFIRMED, 15)
    counters.end(Outcome.DEAD_LETTERED, 3)
    clock.now_s += 10
    status.say()
    told = json.loads(capfd.readouterr().err)
    before = {'time', 'level', 'pid', 'thread', 'route', 'message'}
    assert {name: value for name, value in told.items() if name not in before} == {
        'state': 'waiting', 'confirmed': 15, 'published': 0, 'rate': 1.5, 'in_flight': 12,
        'dead_lettered': 3, **also,
    }  # fmt: skip
    assert told['message'].startswith('waiting (Kafka is away): 15 confirmed, 2/s, 12 in flight')


@pytest.mark.usefixtures('own_log')
def test_of_the_lines_of_a_kafka_client_only_the_end_of_it_is_said(
    capfd: pytest.CaptureFixture[str],
) -> None:
    logs.set_up('text')
    client = logging.getLogger('ros2_kafka_bridge.kafka.member.librdkafka')
    client.error('connect failed')
    client.critical('fenced')
    (line,) = capfd.readouterr().err.splitlines()
    assert line.endswith('CRITICAL fenced')


@pytest.mark.usefixtures('own_log')
def test_a_line_of_text_names_the_trace_where_there_is_one(
    capfd: pytest.CaptureFixture[str],
) -> None:
    logs.set_up('text')
    log = logs.route_log('to_ros')
    log.warning('%s', 'one', extra={'about': About(trace_id=TRACE)})
    log.warning('%s', 'two', extra={'about': About(offset=1)})
    log.warning('%s', 'three')
    one, two, three = capfd.readouterr().err.splitlines()
    assert one.endswith(f'WARNING to_ros: one (trace {TRACE})')
    assert two.endswith('WARNING to_ros: two')
    assert three.endswith('WARNING to_ros: three')


def test_what_a_record_says_of_itself_is_believed_only_where_it_can_be_true() -> None:
    parent = ('traceparent', f'00-{TRACE}-{"1" * 16}-00')
    place = [('ros.gid', b'00ff' * 8), ('ros.seq', b'7')]
    good = about_labelled([*place, parent], DecodeError('broken'))
    assert good == About(gid='00ff' * 8, seq=7, trace_id=TRACE, error='DecodeError')
    hostile = [('ros.gid', b'\x1b[31m'), ('ros.seq', b'9' * 5000), ('traceparent', b'x')]
    assert about_labelled([*hostile]) == About()
    assert about_labelled(None) == About()
