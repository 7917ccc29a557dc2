"""What the supervisor tells of the whole bridge."""

import selectors

import pytest

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.process.control_plane import ControlPlane
from ros2_kafka_bridge.process.plan import Plan, RoutePlan
from ros2_kafka_bridge.process.reports import report_of
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.route.counters import Counters, Measures, State
from ros2_kafka_bridge.threads.stop import Stop


@pytest.mark.parametrize(
    ('lifecycle', 'reason'),
    [
        (Lifecycle.UNCONFIGURED, 'the bridge is unconfigured'),
        (Lifecycle.INACTIVE, 'the bridge is inactive'),
        (Lifecycle.ACTIVE, ''),  # while it drains to become inactive
    ],
)
def test_a_route_that_no_worker_has_is_stopped_and_says_why(
    lifecycle: Lifecycle, reason: str
) -> None:
    plan = Plan('shop.yaml', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=8),))
    with selectors.DefaultSelector() as selector:
        pool = WorkerPool(plan, [], selector, Stop())
        told = report_of(pool, ControlPlane(pool, lifecycle, Stop()), 0.0, stopping=False)
        pool.close()
    [route] = told.routes
    assert (route.worker, route.snapshot.state) == (0, State.STOPPED)
    assert route.snapshot.reason == reason
    assert (route.age_s, route.snapshot.spooled) == (None, None), 'nobody has told of it'


def test_what_a_route_told_last_before_its_bridge_was_deactivated_is_not_told_as_now() -> None:
    plan = Plan('shop.yaml', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=8),))
    measures = Measures(kafka_up=True, matched=3, queued=7)
    with selectors.DefaultSelector() as selector:
        pool = WorkerPool(plan, [], selector, Stop())
        pool.last['orders'] = Counters('orders', taken=5).snapshot(5, 77, 0, measures)
        control = ControlPlane(pool, Lifecycle.INACTIVE, Stop())
        told = report_of(pool, control, 0.0, stopping=False)
        pool.close()
    [route] = told.routes
    now = route.snapshot
    assert (now.lag, now.measures.kafka_up, now.measures.matched) == (None, None, None)
    assert (now.taken, now.in_flight) == (5, 5)
    assert route.age_s is not None
