"""How a bridge fares that does not run a route: what leads from one to the next, what is shown."""

import pytest

from ros2_kafka_bridge.exclusive.standby import PendingBacklog, StandbyStatus
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.running.route_status import Failure, Shown

STANDS_BY = 'stands by: another bridge runs this route'
AWAY = Failure('Kafka is away')
LATER = PendingBacklog(1060.0, Failure('disk full'))
JOINS = Shown(State.WAITING, 'asks Kafka which bridge runs this route')
UNDELIVERED = f'{STANDS_BY}; what this one has on disk is not delivered: disk full'


@pytest.mark.parametrize(
    ('status', 'shown'),
    [
        (StandbyStatus(), JOINS),
        (StandbyStatus(away='no broker', backlog=LATER), Shown(State.WAITING, 'no broker')),
        (StandbyStatus(stands_by=True), Shown(State.WAITING, STANDS_BY)),
        (StandbyStatus(stands_by=True, backlog=LATER), Shown(State.WAITING, UNDELIVERED)),
        (
            StandbyStatus(stands_by=True, backlog=LATER, failure=AWAY),
            Shown(State.FAILED, 'Kafka is away'),
        ),
        (StandbyStatus(failure=AWAY), Shown(State.FAILED, 'Kafka is away')),
    ],
)
def test_what_is_shown_follows_from_what_is_known(status: StandbyStatus, shown: Shown) -> None:
    assert status.shown == shown


def test_a_bridge_stands_by_once_kafka_has_told_it() -> None:
    status = StandbyStatus().heard(joined=False, away='')
    assert status.shown == JOINS
    status = status.heard(joined=True, away='')
    assert status.shown.reason == STANDS_BY
    status = status.heard(joined=True, away='no broker')
    assert status.shown == Shown(State.WAITING, 'no broker')
    assert not status.stands_by


@pytest.mark.parametrize('away', ['', 'no broker'])
def test_a_failure_is_shown_until_kafka_has_told_who_runs_the_route(away: str) -> None:
    status = StandbyStatus().failed(AWAY)
    assert status.heard(joined=False, away=away).shown == Shown(State.FAILED, 'Kafka is away')
    assert status.heard(joined=True, away=away).shown.state is State.WAITING


def test_a_bridge_that_stood_by_does_so_until_kafka_tells_something_else() -> None:
    status = StandbyStatus(stands_by=True).failed(AWAY)
    assert status.stands_by
    assert not status.heard(joined=False, away='').stands_by
    assert status.heard(joined=True, away='').stands_by


def test_what_is_on_disk_is_known_whatever_is_heard() -> None:
    status = StandbyStatus(stands_by=True, backlog=LATER)
    for joined in (True, False):
        for away in ('no broker', ''):
            status = status.heard(joined=joined, away=away).failed(AWAY)
            assert status.backlog == LATER
