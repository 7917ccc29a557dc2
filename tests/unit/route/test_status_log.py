"""What the log says of routes every ten seconds: one line for all that have had nothing to do."""

import logging
from typing import Any

import pytest

from ros2_kafka_bridge.route.counters import Counters, Measures, Snapshot, State
from ros2_kafka_bridge.route.status import StatusLog


class House:
    """Routes, and what the log has said of them."""

    def __init__(
        self, count: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr('time.monotonic', lambda: self.now_s)
        caplog.set_level(logging.INFO)
        self._caplog = caplog
        self.names = [f'route_{number}' for number in range(count)]
        self.routes = {
            name: Counters(name, state=State.RUNNING).snapshot(0, lag=0) for name in self.names
        }
        self.asked = 0
        self._log = StatusLog(self._snapshots)
        self.asked = 0

    def _snapshots(self) -> list[Snapshot]:
        self.asked += 1
        return list(self.routes.values())

    def change(self, name: str, **fields: Any) -> None:
        self.routes[name] = self.routes[name]._replace(**fields)

    def said(self, for_s: int = 10) -> list[str]:
        """What it says in that time; it is called each second."""
        self._caplog.clear()
        for _ in range(for_s):
            self.now_s += 1.0
            self._log.say()
        return [
            f'{name}: {record.getMessage()}' if (name := _route(record)) else record.getMessage()
            for record in self._caplog.records
        ]


def _route(record: logging.LogRecord) -> str:
    return str(getattr(record, 'route', '') or '')


def _idle(*names: str, more: int = 0) -> str:
    also = f' and {more} more' if more else ''
    return f'running: {len(names) + more} routes had nothing to do: {", ".join(names)}{also}'


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> House:
    return House(2, monkeypatch, caplog)


@pytest.fixture
def five(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> House:
    return House(5, monkeypatch, caplog)


def test_all_idle_routes_have_one_line_with_their_names(two: House) -> None:
    assert two.said() == [_idle('route_0', 'route_1')]


def test_of_many_idle_routes_the_first_are_named_and_the_others_counted(five: House) -> None:
    assert five.said() == [_idle('route_0', 'route_1', 'route_2', more=2)]


def test_the_moment_and_the_measures_of_what_is_told_are_no_work(two: House) -> None:
    two.change('route_0', made_s=1.0, beat_s=2.0, measures=Measures(matched=1), lag=None)
    assert two.said() == [_idle('route_0', 'route_1')]


@pytest.mark.parametrize(
    'has',
    [
        {'taken': 5, 'confirmed': 5},
        {'taken': 5, 'skipped': 5},
        {'published': 1},
        {'in_flight': 1},
        {'lag': 1},
        {'spooled': 1},
        {'state': State.WAITING, 'reason': 'Kafka is away'},
        {'state': State.FAILED, 'reason': 'no permission'},
        {'state': State.PAUSED},
        {'lost_upstream': 1},
        {'unproved': 1},
    ],
    ids=str,
)
def test_a_route_that_moves_or_waits_or_has_something_left_has_its_own_line(
    five: House, has: dict[str, Any]
) -> None:
    five.change('route_3', **has)
    idle, own = five.said()
    assert idle == _idle('route_0', 'route_1', 'route_2', more=1)
    assert own.startswith(f'route_3: {five.routes["route_3"].state}')


def test_a_route_that_goes_on_waiting_has_its_own_line_each_time(two: House) -> None:
    two.change('route_1', state=State.WAITING, reason='Kafka is away')
    for _ in range(3):
        assert [line.partition(' (')[0] for line in two.said()] == [
            'route_0: running: 0 confirmed, 0/s, 0 in flight, lag 0, 0 dead-lettered',
            'route_1: waiting',
        ]


def test_a_single_idle_route_has_its_own_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    [line] = House(1, monkeypatch, caplog).said()
    assert line.startswith('route_0: running: 0 confirmed')


def test_a_route_that_has_moved_is_idle_again_once_it_has_not(two: House) -> None:
    two.change('route_0', taken=44, confirmed=44)
    assert two.said()[0].startswith('route_0: running: 44 confirmed, 4/s')
    assert two.said() == [_idle('route_0', 'route_1')]


def test_a_route_that_begins_has_its_own_line_first(two: House) -> None:
    """It was starting when it was looked at before, or was not there yet."""
    two.routes['new'] = Counters('new', state=State.RUNNING).snapshot(0)
    assert two.said()[-1].startswith('new: running')
    assert two.said() == [_idle('route_0', 'route_1', 'new')]


def test_the_first_line_is_for_each_route(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(2, monkeypatch, caplog)
    for name in house.names:
        house.routes[name] = Counters(name, state=State.STARTING).snapshot(0)
    house._log = StatusLog(house._snapshots)
    for name in house.names:
        house.change(name, state=State.RUNNING)
    assert [line.partition(': ')[0] for line in house.said()] == house.names
    assert house.said() == [_idle('route_0', 'route_1')]


def test_routes_are_asked_one_call_before_they_are_said(two: House) -> None:
    """An idle one tells once it is asked; and it is asked for nothing else."""
    assert two.said(9) == []
    assert two.asked == 1
    two.change('route_0', taken=1, dropped=1)
    assert two.said(1)[0].startswith('route_0: running')
    assert two.asked == 2


def test_the_line_comes_again_and_again(two: House) -> None:
    assert len(two.said(110)) == 11
