"""What /diagnostics says, by numbers made up."""

from typing import Any

import pytest

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.monitoring.history import History
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Reload, Report, RouteReport, Worker
from ros2_kafka_bridge.ros.control.diagnostics import (
    BridgeIdentity,
    Change,
    Level,
    RecentCounters,
    Status,
    statuses,
)
from ros2_kafka_bridge.route.counters import Counters, Distribution, Measures, Snapshot, State

FILE = """
name: shop
kafka: {bootstrap.servers: 'localhost:9092'}
routes:
- name: orders
  format: text
  from: {kafka: orders}
  to: {ros: /orders, type: std_msgs/msg/String}
- name: status
  format: json
  from: {ros: /status, type: std_msgs/msg/String}
  to: {kafka: status}
  spool: {path: /var/spool/bridge, max_bytes: 1000000000}
"""


@pytest.fixture
def config() -> Config:
    return loads(FILE, 'shop.yaml', {})


def snapshot(route: str = 'orders', **more: Any) -> Snapshot:
    made = Counters(route).snapshot(0, lag=0 if route == 'orders' else None)
    return made._replace(**{'state': State.RUNNING, **more})


def told(*snapshots: Snapshot, pid: int = 17, **more: Any) -> Report:
    return Report(
        **{
            'time_s': 0.0,
            'lifecycle': Lifecycle.ACTIVE,
            'stopping': False,
            'started_s': 0.0,
            'workers': (Worker(1, pid, 1, '' if pid else 'it was killed'),),
            'routes': tuple(RouteReport(1, 0.1, 0.0, one) for one in snapshots),
            **more,
        }
    )


def said(
    config: Config,
    report: Report | None,
    silent_s: float = 0.1,
    recent: RecentCounters | None = None,
) -> dict[str, Status]:
    bridge = BridgeIdentity('kafka_bridge_shop', '/etc/shop.yaml', '0.1.0', config.routes)
    found = statuses(bridge, report, silent_s, recent or RecentCounters())
    assert all(status.name.startswith('kafka_bridge_shop: ') for status in found)
    return {status.name.removeprefix('kafka_bridge_shop: '): status for status in found}


def both(**more: Any) -> tuple[Snapshot, Snapshot]:
    return snapshot('orders', **more), snapshot('status')


def test_all_is_ok_while_every_route_runs(config: Config) -> None:
    found = said(config, told(*both()))
    assert list(found) == ['bridge', 'worker 1', 'orders', 'status']
    assert {status.level for status in found.values()} == {Level.OK}
    assert found['orders'].message == 'running'
    assert found['bridge'].message == 'active, 2 routes'


def test_a_route_without_a_type_of_its_own_says_whose_it_has() -> None:
    without = FILE.replace('/status, type: std_msgs/msg/String', '/status')
    found = said(loads(without, 'shop.yaml', {}), told(*both()))
    assert dict(found['orders'].values)['type'] == 'std_msgs/msg/String'
    assert dict(found['status'].values)['type'] == 'that of its publishers'


@pytest.mark.parametrize(
    ('state', 'reason', 'level'),
    [
        (State.STARTING, '', Level.WARN),
        (State.WAITING, 'no subscriber on /orders', Level.WARN),
        (State.PAUSED, 'paused by an operator', Level.WARN),
        (State.STOPPED, '', Level.WARN),
        (State.FAILED, 'the topic was deleted', Level.ERROR),
    ],
)
def test_a_route_that_does_not_run_says_why_and_the_bridge_names_it(
    config: Config, state: State, reason: str, level: Level
) -> None:
    found = said(config, told(*both(state=state, reason=reason)))
    assert found['orders'].level is level
    assert found['orders'].message.startswith(f'{state}: {reason}' if reason else state)
    assert len(found['orders'].message) > len(state) + len(reason) + 10  # what to do
    assert found['bridge'].level is level
    assert f'orders {state}' in found['bridge'].message


def test_what_a_pause_costs_is_said_for_each_direction(config: Config) -> None:
    paused = told(*(it._replace(state=State.PAUSED) for it in both()))
    found = said(config, paused)
    assert 'waits in Kafka' in found['orders'].message
    assert 'publishers that are not reliable and KEEP_ALL lose' in found['status'].message


def test_everything_is_stale_when_the_bridge_reports_no_more(config: Config) -> None:
    for report in (None, told(*both())):
        found = said(config, report, silent_s=12)
        assert set(found) == {'bridge', 'orders', 'status'}
        assert {status.level for status in found.values()} == {Level.STALE}
        assert '12 s' in found['orders'].message


def test_a_route_of_which_nothing_is_known_is_stale(config: Config) -> None:
    found = said(config, told(snapshot('status')))
    assert found['orders'].level is Level.STALE
    assert found['status'].level is Level.OK


def test_a_running_route_that_tells_nothing_is_stale_and_a_waiting_one_may(config: Config) -> None:
    running, waiting = snapshot('orders'), snapshot('status', state=State.WAITING)
    old = (RouteReport(1, 20.0, 0.0, running), RouteReport(1, 20.0, 0.0, waiting))
    found = said(config, told(routes=old))
    assert found['orders'].level is Level.STALE
    assert found['status'].level is Level.WARN


def test_a_thread_that_is_stuck_is_an_error(config: Config) -> None:
    routes = (RouteReport(1, 120.0, 120.0, snapshot()), RouteReport(1, 0.1, 0.0, both()[1]))
    assert said(config, told(routes=routes))['orders'].level is Level.ERROR


def test_a_dead_worker_is_an_error_of_its_own_and_of_its_routes(config: Config) -> None:
    found = said(config, told(*both(), pid=0))
    assert {found[name].level for name in ('bridge', 'worker 1', 'orders')} == {Level.ERROR}
    assert 'it was killed' in found['orders'].message


def test_a_bridge_that_was_deactivated_warns_and_its_workers_are_no_errors(config: Config) -> None:
    reason = 'the bridge is inactive'
    stopped = [one._replace(state=State.STOPPED, reason=reason) for one in both()]
    found = said(config, told(*stopped, pid=0, lifecycle=Lifecycle.INACTIVE))
    assert found['orders'].message == 'stopped: the bridge is inactive'
    assert {found[name].level for name in ('bridge', 'orders', 'status')} == {Level.WARN}
    assert found['worker 1'].level is Level.OK
    assert 'activate' in found['bridge'].message


def test_endpoints_that_do_not_match_are_a_warning_with_the_command_that_shows_them(
    config: Config,
) -> None:
    found = said(config, told(*both(measures=Measures(matched=1, mismatched=2))))['orders']
    assert found.level is Level.WARN
    assert '2 endpoints on /orders' in found.message
    assert 'ros2 topic info --verbose /orders' in found.message
    assert dict(found.values)['mismatched'] == '2'


def test_a_spool_that_is_nearly_full_is_a_warning(config: Config) -> None:
    full = snapshot('status', measures=Measures(spool_bytes=900_000_000))
    assert '90%' in said(config, told(snapshot(), full))['status'].message


def test_a_refused_reload_is_a_warning_of_the_bridge(config: Config) -> None:
    report = told(*both(), reload=Reload(0.0, done=False, text='shop.yaml:3: wrong'))
    found = said(config, report)
    assert found['bridge'].level is Level.WARN
    assert dict(found['bridge'].values)['last reload'] == 'shop.yaml:3: wrong'
    assert found['orders'].level is Level.OK


# What has changed lately


def heard(*confirmed: int, **more: Any) -> RecentCounters:
    recent = RecentCounters()
    for second, number in enumerate(confirmed):
        recent.add(told(snapshot(confirmed=number, **more)), float(second))
    return recent


def test_the_rate_is_that_of_the_last_ten_seconds() -> None:
    recent = heard(*([0] * 30), *range(0, 1100, 100))
    assert recent.change('orders').rate == 100


def test_a_worker_that_was_started_again_counts_from_zero_and_the_rate_is_never_negative() -> None:
    assert heard(5000, 5000, 10, 20).change('orders').rate == 10


def test_a_route_that_was_never_heard_of_has_not_changed() -> None:
    assert RecentCounters().change('orders') == Change()


def test_a_lag_of_more_than_a_minute_of_work_is_a_warning_and_a_smaller_one_is_not(
    config: Config,
) -> None:
    recent = heard(0, 100, 200)
    for lag, level in ((5_999, Level.OK), (6_001, Level.WARN)):
        found = said(config, told(*both(lag=lag)), recent=recent)['orders']
        assert found.level is level
        assert dict(found.values)['lag (records)'] == str(lag)


def test_a_lag_that_fits_into_what_is_in_flight_anyway_is_no_warning(config: Config) -> None:
    assert said(config, told(*both(lag=500)))['orders'].level is Level.OK


@pytest.mark.parametrize(
    ('counter', 'level'),
    [('dead_lettered', Level.WARN), ('lost_upstream', Level.WARN), ('lost', Level.ERROR)],
)
def test_new_losses_and_dead_letters_are_told_for_a_minute(
    config: Config, counter: str, level: Level
) -> None:
    recent, after = RecentCounters(), told(*both(**{counter: 3}))
    recent.add(told(*both()), 0.0)
    recent.add(after, 1.0)
    assert said(config, after, recent=recent)['orders'].level is level
    recent.add(after, 70.0)
    assert said(config, after, recent=recent)['orders'].level is Level.OK


@pytest.mark.parametrize('counter', ['confirmed', 'dead_lettered', 'lost', 'lost_upstream'])
def test_a_counter_that_begins_again_takes_nothing_from_another(
    config: Config, counter: str
) -> None:
    recent, fresh = RecentCounters(), told(*both())
    recent.add(told(*both(**{counter: 3})), 0.0)
    recent.add(fresh, 1.0)
    found = said(config, fresh, recent=recent)['orders']
    assert (found.level, '-3' in found.message) == (Level.OK, False)


@pytest.mark.parametrize('to_ros', [True, False])
def test_the_delay_is_that_of_the_last_minute_as_the_page_shows_it(to_ros: bool) -> None:  # noqa: FBT001
    recent, page = RecentCounters(), History()
    before, after = [1000, *[0] * 16], [1000, 98, 2, *[0] * 14]
    for second, counts in enumerate((before, after)):
        delay = Distribution(tuple(counts))
        # A confirmation from ROS is seen late, and says nothing of the delay.
        late = Distribution((*[0] * 16, 1000 + second))
        measures = (
            Measures(published=delay, in_bridge=late) if to_ros else Measures(in_bridge=delay)
        )
        report = told(snapshot(confirmed=second, measures=measures), time_s=float(second))
        recent.add(report, report.time_s)
        page.add(report)
    found = recent.change('orders').delay_s
    assert found is not None
    assert found == page.recent('orders').delay
    assert 0.001 < found[0] < 0.0025 < found[1] <= 0.005
