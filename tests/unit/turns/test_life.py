"""How a route fares: the stages that it is at, what leads from one to the next, what is shown."""

import math
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
from ros2_kafka_bridge.turns.life import (
    AwaitingSpool,
    AwaitingTurn,
    Ended,
    Failed,
    FailedForGood,
    Failure,
    Life,
    LifeStage,
    Owed,
    Running,
    Shown,
    SpoolWait,
    StandingBy,
)

AWAY = RouteError('Kafka is away', about=About(topic='orders'))
FINAL = RouteError('stopped, as on_error says', final=True)
IN_USE = SpoolInUseError(4711, Path('/var/spool/pair.orders.spool.lock'))
HOLDER = 'process 4711 still has the spool /var/spool/pair.orders.spool.lock'
STANDS_BY = 'stands by: another bridge runs this route'

NOTHING, LATER = Owed(), Owed(1060.0, Failure('disk full'))
SAID = Failure('Kafka is away')
STAGES: list[tuple[LifeStage, Shown | None]] = [
    (Running(), None),
    (AwaitingTurn('', NOTHING), Shown(State.WAITING, 'asks Kafka which bridge runs this route')),
    (AwaitingTurn('no broker', LATER), Shown(State.WAITING, 'no broker')),
    (StandingBy(NOTHING), Shown(State.WAITING, STANDS_BY)),
    (
        StandingBy(LATER),
        Shown(
            State.WAITING,
            f'{STANDS_BY}; what this one has on disk is not delivered: disk full',
        ),
    ),
    (StandingBy(LATER, SAID), Shown(State.FAILED, 'Kafka is away')),
    (
        AwaitingSpool(HOLDER, SpoolWait(1000.0)),
        Shown(State.WAITING, f'its turn has come, but {HOLDER}'),
    ),
    (Failed(SAID, LATER, SpoolWait()), Shown(State.FAILED, 'Kafka is away')),
    (FailedForGood(SAID), Shown(State.FAILED, 'Kafka is away', final=True)),
    (Ended(SAID), Shown(State.FAILED, 'Kafka is away')),
]


def name_of(stage: LifeStage | Shown | None) -> str:
    return type(stage).__name__ if isinstance(stage, LifeStage) else ''


def fail(
    life: Life,
    error: BridgeError = AWAY,
    now_s: float = 1001.0,
    *,
    confirmed: int = 0,
    stops: bool = False,
    over: bool = False,
) -> Life:
    return life.failed(error, now_s, confirmed, stops=stops, over=over)


@pytest.mark.parametrize(('stage', 'shown'), STAGES, ids=name_of)
def test_what_is_shown_follows_from_the_stage(stage: LifeStage, shown: Shown | None) -> None:
    assert Life(stage).shown == shown


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
    life = fail(Life().tried(1000.0, drains=False), error, stops=stops, over=over)
    if error is AWAY:
        assert isinstance(life.stage, Failed)
    elif stops:
        assert isinstance(life.stage, Ended)
    else:
        assert isinstance(life.stage, Failed if over else FailedForGood)
    assert life.failure == Failure.of(error)


@pytest.mark.parametrize('error', [AWAY, FINAL, IN_USE], ids=str)
def test_nothing_is_tried_again_after_the_drain_that_a_failed_route_owes(
    error: BridgeError,
) -> None:
    life = fail(Life().tried(1000.0, drains=True), error, stops=True)
    assert life.stage == Ended(Failure.of(error))


def test_a_failure_is_shown_until_the_route_runs() -> None:
    life = fail(Life())
    assert life.tried(1002.0, drains=False).failure == Failure.of(AWAY)
    assert life.running().stage == Running()
    assert life.running().failure is None


def test_a_route_fails_since_its_first_failure_unless_it_was_well_in_between() -> None:
    life = fail(Life().tried(1000.0, drains=False), now_s=1001.0)
    again = fail(life.running().tried(1002.0, drains=False), now_s=1010.0)
    assert again.past.since_s == 1001.0
    got_on = fail(again.running(), now_s=1011.0, confirmed=1)
    assert got_on.past.since_s == 1011.0
    was_quiet = fail(got_on.running().tried(1012.0, drains=False), now_s=1193.0, confirmed=1)
    assert was_quiet.past.since_s == 1193.0
    assert was_quiet.in_turn().past.since_s is None, 'each term has a time of its own'


def test_a_route_is_tried_again_later_after_each_failure() -> None:
    life, waits = Life().tried(1000.0, drains=False), []
    for _ in range(3):
        life = fail(life)
        waits.append(life.past.backoff.wait_s)
    assert waits == [1.0, 2.0, 4.0]


def test_the_last_failure_is_said_until_something_is_confirmed() -> None:
    assert Life().past.says(0) == ''
    past = fail(Life(), confirmed=7).running().past
    assert past.says(7) == '; has failed before: Kafka is away'
    assert past.says(8) == ''


# While another bridge runs the route


def test_a_bridge_stands_by_once_kafka_has_told_it() -> None:
    life = Life().heard(joined=False, away='')
    assert life.stage == AwaitingTurn('', NOTHING)
    life = life.heard(joined=True, away='')
    assert life.stage == StandingBy(NOTHING)
    life = life.heard(joined=True, away='no broker')
    assert life.stage == AwaitingTurn('no broker', NOTHING)


@pytest.mark.parametrize('away', ['', 'no broker'])
def test_a_failure_is_shown_until_kafka_has_told_who_runs_the_route(away: str) -> None:
    life = Life().failed_meanwhile(AWAY, 1001.0, 0)
    assert life.heard(joined=False, away=away).failure == Failure.of(AWAY)
    assert life.heard(joined=True, away=away).failure is None


@pytest.mark.parametrize('error', [AWAY, FINAL, ConfigError(['no such topic'])], ids=str)
@pytest.mark.parametrize('drains', [False, True])
def test_what_fails_while_another_bridge_runs_the_route_is_always_tried_again(
    error: BridgeError, *, drains: bool
) -> None:
    life = Life().tried(1000.0, drains=drains).failed_meanwhile(error, 1001.0, 0)
    assert isinstance(life.stage, Failed)
    assert life.past.backoff.wait_s == 1.0


def test_a_backlog_that_cannot_be_delivered_is_a_failure_until_the_lock_is_heard() -> None:
    life = Life(StandingBy(NOTHING)).tried(1000.0, drains=False)
    life = life.undelivered(AWAY, 1001.0, 0)
    failure = Failure.of(AWAY)
    assert life.stage == StandingBy(Owed(1002.0, failure), failure)
    heard = life.heard(joined=True, away='')
    assert heard.stage == StandingBy(Owed(1002.0, failure))
    lost = life.heard(joined=False, away='')
    assert lost.stage == Failed(failure, Owed(1002.0, failure), SpoolWait())


def test_what_is_owed_is_known_until_the_turn_of_this_bridge() -> None:
    life = Life(StandingBy(NOTHING)).owing(LATER)
    for away in ('no broker', ''):
        life = life.heard(joined=True, away=away)
        assert life.owed == LATER
    life = life.failed_meanwhile(AWAY, 1001.0, 0)
    assert life.stage == StandingBy(LATER, Failure.of(AWAY)), 'nobody has told anything else'
    life = life.heard(joined=False, away='')
    assert life.stage == Failed(Failure.of(AWAY), LATER, SpoolWait())
    life = life.failed_meanwhile(AWAY, 1002.0, 0)
    assert life.owed == LATER
    assert life.in_turn().owed == NOTHING
    assert life.heard(joined=True, away='').in_turn().owed == NOTHING


def test_a_backlog_that_is_delivered_is_not_looked_for_again() -> None:
    life = Life(StandingBy(LATER, SAID)).owing(Owed(math.inf))
    assert life.stage == StandingBy(Owed(math.inf), SAID)


# In its turn


@pytest.mark.parametrize(('stage', '_'), STAGES[:-2], ids=name_of)
def test_what_kept_a_bridge_from_its_turn_is_forgotten_but_for_a_failure(
    stage: LifeStage, _: Shown | None
) -> None:
    """A failure is shown until the route runs."""
    life = Life(stage)
    failure = life.failure
    expected = Running() if failure is None else Failed(failure, NOTHING, SpoolWait())
    assert life.in_turn().stage == expected


def test_a_spool_is_waited_for_from_the_first_time_that_it_is_not_free() -> None:
    life = fail(Life()).without_spool(IN_USE, 1001.0)
    assert life.stage == AwaitingSpool(HOLDER, SpoolWait(1001.0))
    life = life.without_spool(IN_USE, 1005.0)
    assert life.wait == SpoolWait(1001.0)
    assert fail(life).wait == SpoolWait(1001.0), 'what else fails meanwhile changes nothing'
    assert fail(life, IN_USE).wait == SpoolWait(None), 'its time was up'
    assert life.running().wait == SpoolWait()


def test_how_often_a_spool_was_waited_for_in_vain_is_counted_while_a_bridge_stands_by() -> None:
    life = Life()
    for times in (1, 2):
        life = fail(life.without_spool(IN_USE, 1000.0), IN_USE).sought(wanted=True)
        assert life.wait == SpoolWait(None, times)
        assert life.failure == Failure.of(IN_USE)
    assert fail(life).sought(wanted=True).wait.in_vain == 2, 'that was not the spool'
    assert life.sought(wanted=False).wait.in_vain == 0
    assert life.running().wait.in_vain == 0
    assert life.in_turn().wait.in_vain == 0
    assert Life().sought(wanted=True) == Life()
