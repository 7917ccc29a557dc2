"""What the supervisor tells of the whole bridge."""

import selectors

import pytest

from ros2_kafka_bridge.process.crew import Crew
from ros2_kafka_bridge.process.plan import Plan, RoutePlan
from ros2_kafka_bridge.process.reports import report_of
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.route.counters import State
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
    plan = Plan('shop.yaml', {}, (RoutePlan('orders', to_ros=True, drain_s=8),))
    with selectors.DefaultSelector() as selector:
        crew = Crew([], selector, Stop())
        told = report_of(plan, crew, lifecycle, 0.0, None, stopping=False)
        crew.close()
    [route] = told.routes
    assert (route.worker, route.snapshot.state) == (0, State.STOPPED)
    assert route.snapshot.reason == reason
