"""How a route fares: the stages that it is at, what leads from one to the next, what is shown."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import (
    About,
    BridgeError,
    ConfigError,
    RouteError,
    SpoolInUseError,
    TransportError,
)
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.running.route_status import (
    Ended,
    Failed,
    FailedForGood,
    Failure,
    RouteStage,
    RouteStatus,
    Running,
    Shown,
)

AWAY = RouteError('Kafka is away', about=About(topic='orders'))
FINAL = RouteError('stopped, as on_error says', final=True)
IN_USE = SpoolInUseError(4711, Path('/var/spool/pair.orders.spool.lock'))
HOLDER = 'process 4711 still has the spool /var/spool/pair.orders.spool.lock'
SAID = Failure('Kafka is away')
STAGES: list[tuple[RouteStage, Shown | None]] = [
    (Running(), None),
    (Failed(SAID), Shown(State.FAILED, 'Kafka is away')),
    (FailedForGood(SAID), Shown(State.FAILED, 'Kafka is away', final=True)),
    (Ended(SAID), Shown(State.FAILED, 'Kafka is away')),
]


def name_of(stage: RouteStage | Shown | None) -> str:
    return type(stage).__name__ if isinstance(stage, RouteStage) else ''


def fail(
    status: RouteStatus,
    error: BridgeError = AWAY,
    now_s: float = 1001.0,
    *,
    confirmed: int = 0,
    stops: bool = False,
    ours: bool = True,
) -> RouteStatus:
    return status.failed(error, now_s, confirmed, stops=stops, ours=ours)


@pytest.mark.parametrize(('stage', 'shown'), STAGES, ids=name_of)
def test_what_is_shown_follows_from_the_stage(stage: RouteStage, shown: Shown | None) -> None:
    assert RouteStatus(stage).shown == shown


def test_a_failure_is_kept_in_words() -> None:
    """An error would keep all that it has passed: frames, and what they hold."""
    assert Failure.of(AWAY) == ('Kafka is away', About(topic='orders'), None)
    assert Failure.of(TransportError('no broker')) == ('no broker', None, None)
    assert Failure.of(IN_USE).holder == HOLDER


# A failure of what runs the route


@pytest.mark.parametrize('error', [AWAY, FINAL, ConfigError(['no such type'])], ids=str)
@pytest.mark.parametrize('over', [False, True], ids=['own', 'over'])
@pytest.mark.parametrize('stops', [False, True], ids=['lives', 'stops'])
def test_a_failure_ends_a_route_only_where_no_bridge_can_try_it_again(
    error: BridgeError, *, stops: bool, over: bool
) -> None:
    status = fail(RouteStatus().tried(1000.0, drains=False), error, stops=stops, ours=not over)
    if error is AWAY:
        assert isinstance(status.stage, Failed)
    elif stops:
        assert isinstance(status.stage, Ended)
    else:
        assert isinstance(status.stage, Failed if over else FailedForGood)
    assert status.failure == Failure.of(error)


@pytest.mark.parametrize('error', [AWAY, FINAL, IN_USE], ids=str)
def test_nothing_is_tried_again_after_the_drain_that_a_failed_route_owes(
    error: BridgeError,
) -> None:
    status = fail(RouteStatus().tried(1000.0, drains=True), error, stops=True)
    assert status.stage == Ended(Failure.of(error))


def test_a_failure_is_shown_until_the_route_runs() -> None:
    status = fail(RouteStatus())
    assert status.tried(1002.0, drains=False).failure == Failure.of(AWAY)
    assert status.running().stage == Running()
    assert status.running().failure is None


def test_a_route_fails_since_its_first_failure_unless_it_was_well_in_between() -> None:
    status = fail(RouteStatus().tried(1000.0, drains=False), now_s=1001.0)
    again = fail(status.running().tried(1002.0, drains=False), now_s=1010.0)
    assert again.history.since_s == 1001.0
    got_on = fail(again.running(), now_s=1011.0, confirmed=1)
    assert got_on.history.since_s == 1011.0
    was_quiet = fail(got_on.running().tried(1012.0, drains=False), now_s=1193.0, confirmed=1)
    assert was_quiet.history.since_s == 1193.0
    assert was_quiet.anew().history.since_s is None, 'each term has a time of its own'


def test_a_route_is_tried_again_later_after_each_failure() -> None:
    status, waits = RouteStatus().tried(1000.0, drains=False), []
    for _ in range(3):
        status = fail(status)
        waits.append(status.history.backoff.wait_s)
    assert waits == [1.0, 2.0, 4.0]


def test_the_last_failure_is_said_until_something_is_confirmed() -> None:
    assert RouteStatus().history.says(0) == ''
    history = fail(RouteStatus(), confirmed=7).running().history
    assert history.says(7) == '; has failed before: Kafka is away'
    assert history.says(8) == ''


@pytest.mark.parametrize(('stage', '_'), STAGES, ids=name_of)
def test_a_route_that_is_run_anew_has_failed_before_and_is_not_in_trouble(
    stage: RouteStage, _: Shown | None
) -> None:
    status = fail(RouteStatus(stage))
    anew = status.anew()
    assert (anew.stage, anew.retries, anew.history.since_s) == (Running(), False, None)
    assert anew.history.last == Failure.of(AWAY)


@pytest.mark.parametrize('error', [AWAY, FINAL, ConfigError(['no such topic'])], ids=str)
def test_what_fails_beside_the_route_is_in_its_history_and_changes_nothing_else(
    error: BridgeError,
) -> None:
    status = RouteStatus().tried(1000.0, drains=True).noted(error, 1001.0, 0)
    assert status.stage == Running()
    assert not status.retries
    assert (status.history.times, status.history.backoff.wait_s) == (1, 1.0)
    assert status.history.last == Failure.of(error)
