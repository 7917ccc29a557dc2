"""Two bridges of one machine that take turns, and the spool that both use."""

import pytest
from support.worlds.exclusive_route import IN_USE, House, MemoryLock, MemoryPipeline, fail, turn

pytestmark = pytest.mark.usefixtures('quick')


def test_a_bridge_that_stands_by_leaves_the_spool_to_the_process_that_uses_it(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stays among those that want the route: leaving them would keep it from taking over."""
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.standby._BACKLOG_S', 0.0)
    house, lock = turn('theirs theirs theirs theirs ours')
    house.pipelines = [MemoryPipeline(2, house.stop)]
    house.in_use = IN_USE
    looked = 0

    def look(_: MemoryLock) -> None:
        nonlocal looked
        looked += 1
        assert lock.said == []
        if len(lock.answers) == 1:
            assert house.snapshot.reason == 'stands by: another bridge runs this route'
            house.in_use = house.for_backlog = None

    house.for_backlog = MemoryPipeline(0, fail)
    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert looked == 5
    assert 'failed' not in caplog.text
    assert house.snapshot.confirmed == 2


def test_a_bridge_that_cannot_deliver_its_backlog_stands_by_and_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house, lock = turn('theirs theirs theirs theirs ours')
    house.pipelines = [MemoryPipeline(2, house.stop)]
    house.for_backlog = MemoryPipeline(0, fail)
    reasons: set[str] = set()

    def look(_: MemoryLock) -> None:
        assert lock.said == [], 'it is still one of those that stand by'
        reasons.add(house.snapshot.reason)

    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert (
        'stands by: another bridge runs this route; what this one has on disk is not delivered: '
        'no permission'
    ) in reasons
    assert house.snapshot.confirmed == 2


def test_guarantee_8_a_turn_waits_until_the_bridge_before_has_put_the_spool_away(
    caplog: pytest.LogCaptureFixture,
) -> None:
    house = House(MemoryLock('ours'))
    house.pipelines = [MemoryPipeline(2, house.stop)]
    house.claims_until_free = 4
    house.run()
    assert house.claims == [1, 1, 1, 1], 'the ROS endpoint is open: the other one sees it'
    assert house.reasons[1:] == 3 * [
        'its turn has come, but process 4711 still has the spool /var/spool/pair.orders.spool.lock'
    ]
    assert house.snapshot.confirmed == 2
    assert 'failed' not in caplog.text


def test_guarantee_8_a_turn_without_the_spool_goes_back_to_a_bridge_that_stands_by(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has the spool may still run the route, and be held back by an endpoint that is idle."""
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease._SPOOL_S', 0.0)
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease.MOST_S', 0.0)
    house, lock = turn('ours', MemoryPipeline(0, fail))
    house.in_use = IN_USE
    waits: list[int] = []

    def has_standby(_: MemoryLock) -> bool:
        waits.append(house.open)
        return True

    monkeypatch.setattr(MemoryLock, 'has_standby', has_standby)

    def look(_: MemoryLock) -> None:
        if lock.said:
            assert house.open == 0
            house.runner.stop.ask()

    monkeypatch.setattr(MemoryLock, 'check', look)
    house.run()
    assert lock.said == ['closed', 'closed']
    assert 'what the reader here holds may be lost: left to a bridge that stands by' in caplog.text
    assert len(waits) == 2, 'one that went on just now needs a while'


def test_a_turn_without_the_spool_is_kept_where_no_other_bridge_stands_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease._SPOOL_S', 0.0)
    monkeypatch.setattr('ros2_kafka_bridge.exclusive.lease.MOST_S', 0.0)
    house, lock = turn('ours')
    house.pipelines = [MemoryPipeline(2, house.stop)]
    house.claims_until_free = 6
    house.run()
    assert set(house.claims) == {1}
    assert lock.said == ['closed']
    assert house.snapshot.confirmed == 2
