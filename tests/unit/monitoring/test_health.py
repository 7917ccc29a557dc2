"""When a bridge lives, and when it is ready."""

import pytest
from support.monitoring.monitors import report, snapshot

from ros2_kafka_bridge.monitoring.health import Health, liveness, readiness
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Report, RouteReport, Worker
from ros2_kafka_bridge.route.counters import State

NAMES = ['a', 'b']


def ready(told: Report | None, age_s: float = 0.5) -> Health:
    return readiness(told, age_s, NAMES)


def with_state(state: State, reason: str = '') -> Report:
    return report(snapshot('a'), snapshot('b', state, reason=reason))


@pytest.mark.parametrize('state', [State.RUNNING, State.WAITING, State.PAUSED])
def test_a_route_that_runs_or_waits_is_ready(state: State) -> None:
    health = ready(with_state(state, 'because'))
    assert health.good
    assert f'[+]route/b ok: {state}: because' in health.text(verbose=True)
    assert health.text(verbose=False) == 'ok'


@pytest.mark.parametrize('state', [State.STARTING, State.FAILED, State.STOPPED])
def test_one_route_that_does_not_run_is_enough_to_be_not_ready(state: State) -> None:
    health = ready(with_state(state, 'because'))
    assert not health.good
    assert health.problems == [f'route/b: {state}: because']
    # Also without being asked to, it says why.
    assert f'[-]route/b failed: {state}: because' in health.text(verbose=False)
    assert health.text(verbose=False).endswith('readyz check failed\n')
    assert health.as_dict()['ok'] is False


def test_a_worker_that_is_away_takes_its_routes_along() -> None:
    workers = (Worker(1, 0, 2, 'was ended by SIGKILL'),)
    health = ready(report(snapshot('a'), snapshot('b'), workers=workers))
    assert health.problems == [
        'route/a: worker 1 is away: was ended by SIGKILL',
        'route/b: worker 1 is away: was ended by SIGKILL',
    ]


def test_a_route_that_nobody_has_told_of_is_not_ready() -> None:
    assert ready(report(snapshot('a'))).problems == ['route/b: nothing is known of it yet']


@pytest.mark.parametrize('lifecycle', [Lifecycle.UNCONFIGURED, Lifecycle.INACTIVE])
def test_a_bridge_that_is_not_active_is_not_ready(lifecycle: Lifecycle) -> None:
    health = ready(report(snapshot('a'), snapshot('b'), lifecycle=lifecycle))
    assert health.problems == [f'lifecycle: it is {lifecycle}']


@pytest.mark.parametrize('lifecycle', [Lifecycle.UNCONFIGURED, Lifecycle.INACTIVE])
def test_a_route_that_no_worker_has_says_why_and_names_no_worker(lifecycle: Lifecycle) -> None:
    stopped = snapshot('a', State.STOPPED, reason=f'the bridge is {lifecycle}')
    told = report(RouteReport(0, 0.5, 0.0, stopped), lifecycle=lifecycle, workers=())
    assert readiness(told, 0.5, ['a']).problems == [
        f'lifecycle: it is {lifecycle}',
        f'route/a: stopped: the bridge is {lifecycle}',
    ]


def test_a_bridge_that_stops_is_not_ready_but_lives() -> None:
    told = report(snapshot('a'), snapshot('b'), stopping=True)
    assert ready(told).problems == ['stopping: it drains to end']
    assert liveness(told, 0.5).good


def test_without_news_of_the_supervisor_it_is_neither() -> None:
    told = report(snapshot('a'), snapshot('b'))
    assert liveness(told, 29).good
    assert not liveness(told, 31).good
    assert not ready(told, 31).good


def test_before_the_first_report_it_lives_and_is_not_ready() -> None:
    assert liveness(None, 5).good
    assert not ready(None).good
    assert not liveness(None, 31).good


def test_a_thread_that_is_stuck_is_a_reason_to_restart() -> None:
    slow = RouteReport(1, 0.5, 89.0, snapshot('a'))
    stuck = RouteReport(1, 0.5, 91.0, snapshot('b'))
    assert liveness(report(slow), 0.5).good
    assert liveness(report(slow, stuck), 0.5).problems == [
        'route/b: its thread has done one thing for 91 s'
    ]


def test_a_thread_that_is_stuck_is_not_ready() -> None:
    told = report(snapshot('a'), RouteReport(1, 0.5, 91.0, snapshot('b')))
    assert ready(told).problems == ['route/b: its thread has done one thing for 91 s']


def test_what_fails_or_waits_is_no_reason_to_restart() -> None:
    told = report(snapshot('a', State.FAILED), snapshot('b', State.WAITING))
    assert liveness(told, 0.5).good


def test_a_worker_that_stands_still_is_not_ready_and_after_long_a_reason_to_restart() -> None:
    """Whatever its routes told last: a bridge that stands by would not take over."""

    def told(silent_s: float) -> Report:
        waits = snapshot('a', State.WAITING, reason='stands by')
        return report(waits, snapshot('b'), workers=(Worker(1, 17, 1, '', silent_s),))

    assert ready(told(25)).good
    assert ready(told(45)).problems == ['worker/1: it has told nothing for 45 s']
    assert liveness(told(45), 0.5).good
    assert liveness(told(100), 0.5).problems == ['worker/1: it has told nothing for 100 s']
