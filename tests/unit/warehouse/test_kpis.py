"""The key figures say what has happened, no more and no less."""

import pytest

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.kpis import ACTIVITIES, Kpis, KpiView, percentile
from ros2_kafka_warehouse.messages.message import node_id
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport, RobotReport
from ros2_kafka_warehouse.messages.onlookers import Plans
from ros2_kafka_warehouse.messages.orders import Order, OrderEvent, OrderStatus
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    ErrorLevel,
    FleetState,
    Load,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments

S = OrderStatus


def event(order: str, status: OrderStatus, time_s: float, **more: object) -> OrderEvent:
    return OrderEvent(order, 0, status, time_s, **more)  # type: ignore[arg-type]


def an_order(name: str, **more: object) -> Order:
    return Order(name, 0, 'packing-1', (), 0.0, **more)  # type: ignore[arg-type]


def kpis_of(*events: OrderEvent) -> Kpis:
    kpis = Kpis(step_s=0.5)
    for one in events:
        kpis.take_event(one)
    return kpis


def test_nothing_has_happened_yet() -> None:
    view = Kpis().view(0.0)
    assert view == KpiView()
    assert view.orders_per_hour is None


def test_an_order_counts_when_it_is_delivered() -> None:
    kpis = kpis_of(
        event('1', S.RECEIVED, 0.0),
        event('1', S.DELIVERED, 90.0, line_id='a'),
        event('1', S.DELIVERED, 100.0, line_id='b'),
        event('1', S.DELIVERED, 100.0, late_s=-20.0),
    )
    view = kpis.view(3600.0)
    assert (view.received, view.delivered, view.lines_delivered) == (1, 1, 2)
    assert (view.orders_per_hour, view.tasks_per_hour) == (1.0, 2.0)
    assert (view.cycle_mean_s, view.cycle_p95_s) == (100.0, 100.0)
    assert (view.on_time, view.mean_late_s) == (1.0, 0.0)


def test_only_the_last_hour_counts_for_what_is_an_hour() -> None:
    kpis = kpis_of(event('0', S.RECEIVED, 0.0))
    for number in range(10):
        kpis.take_event(event(str(number), S.DELIVERED, 1000.0 * number))
    assert kpis.view(9000.0).orders_per_hour == 4.0


def test_on_time_is_a_share_of_orders_with_a_due_time() -> None:
    kpis = kpis_of(
        event('1', S.DELIVERED, 1.0, late_s=-5.0),
        event('2', S.DELIVERED, 1.0, late_s=15.0),
        event('3', S.DELIVERED, 1.0),
    )
    view = kpis.view(10.0)
    assert (view.on_time, view.mean_late_s) == (0.5, 7.5)


def test_what_was_not_delivered_whole_or_is_overdue_was_not_on_time() -> None:
    kpis = kpis_of(
        event('1', S.DELIVERED, 1.0, late_s=-5.0),
        event('2', S.FAILED, 1.0, late_s=-5.0),
        event('3', S.PARTIAL, 1.0, late_s=10.0),
        event('4', S.CANCELLED, 1.0, late_s=90.0),
    )
    view = kpis.view(100.0, [an_order('5', due_s=70.0), an_order('6', due_s=101.0)])
    assert (view.on_time, view.mean_late_s) == (0.25, 10.0)


def test_the_same_event_again_is_a_repeat_and_another_end_is_one_too_many() -> None:
    end = event('1', S.DELIVERED, 5.0)
    line = event('1', S.DELIVERED, 4.0, line_id='a')
    kpis = kpis_of(event('1', S.RECEIVED, 0.0), line, end, line, end)
    assert kpis.view(10.0).duplicated == 0
    assert kpis.view(10.0).delivered == 1
    kpis.take_event(event('1', S.FAILED, 6.0))
    assert kpis.view(10.0).duplicated == 1


def test_an_order_that_is_neither_open_nor_ended_is_lost() -> None:
    kpis = kpis_of(
        event('1', S.RECEIVED, 0.0),
        event('2', S.RECEIVED, 0.0),
        event('3', S.RECEIVED, 0.0),
        event('3', S.CANCELLED, 1.0),
    )
    assert kpis.view(30.0).lost == 0  # it may be on its way
    assert kpis.view(100.0, [an_order('1')]).lost == 1


def test_other_ends_are_counted_apart() -> None:
    kpis = kpis_of(
        event('1', S.PARTIAL, 1.0), event('2', S.FAILED, 1.0), event('3', S.CANCELLED, 1.0)
    )
    view = kpis.view(10.0)
    assert (view.delivered, view.partial, view.failed, view.cancelled) == (0, 1, 1, 1)


# Failures


def failure(name: str, event_name: str, time_s: float, **more: object) -> FailureEvent:
    return FailureEvent(name, event_name, time_s, **more)  # type: ignore[arg-type]


def test_hand_over_counts_from_the_detection_to_the_robot_that_has_the_task_instead() -> None:
    kpis = Kpis()
    kpis.take_failure(failure('f1', 'FailureDetected', 10.0, robot='a'))
    kpis.take_failure(failure('f1', 'TaskReassigned', 13.0, robot='a', task_id='1/a'))
    kpis.take_failure(failure('f1', 'TaskReassigned', 14.0, robot='a', task_id='1/a'))
    view = kpis.view(20.0)
    assert (view.hand_over_s, view.hand_overs, view.failures) == (3.0, 1, 1)


def test_only_failures_that_stop_a_robot_count_for_time_between_failures() -> None:
    kpis = Kpis(step_s=1.0)
    for step in range(100):
        kpis.take_state(FleetState(step, (state('a', (0, 0)), state('b', (1, 0)))))
    kpis.take_failure(failure('f1', 'FailureDetected', 10.0, robot='a'))
    fatal = failure('f1', 'FailureDiagnosed', 10.0, robot='a', level=ErrorLevel.FATAL)
    kpis.take_failure(fatal)
    kpis.take_failure(failure('f1', 'FailureResolved', 40.0, robot='a'))
    kpis.take_failure(failure('f2', 'FailureDetected', 50.0, robot='b', level=ErrorLevel.WARNING))
    view = kpis.view(100.0)
    assert (view.mtbf_s, view.mttr_s, view.failures) == (200.0, 30.0, 2)


def test_time_between_failures_is_of_the_failures_in_the_time_that_is_looked_back() -> None:
    kpis = Kpis(step_s=1.0, window_steps=100)
    for name, time_s in (('old', 10.0), ('new', 950.0)):
        more: dict[str, object] = {'robot': 'a', 'level': ErrorLevel.FATAL}
        kpis.take_failure(failure(name, 'FailureDetected', time_s, **more))
        kpis.take_failure(failure(name, 'FailureResolved', time_s + 1, **more))
    for step in range(500):
        kpis.take_state(FleetState(step, (state('a', (0, 0)),)))
    assert kpis.view(1000.0).mtbf_s == 100.0


def test_a_robot_without_progress_counts_as_a_deadlock() -> None:
    kpis = Kpis()
    kpis.take_failure(failure('f1', 'FailureDetected', 10.0, robot='a'))
    kpis.take_failure(failure('f1', 'FailureDiagnosed', 10.0, robot='a', code='NO_PROGRESS'))
    assert kpis.view(20.0).deadlocks == 1


# What robots do


def state(name: str, cell: tuple[int, int], **more: object) -> RobotState:
    power = more.pop('power', PowerSupply(80.0))
    return RobotState(1, name, 'carrier', node_id(cell), Position(*cell), power, **more)  # type: ignore[arg-type]


RUNNING = (ActionState('1/a#0:pick', 'pick', ActionStatus.RUNNING),)


@pytest.mark.parametrize(
    ('before', 'now', 'activity'),
    [
        (state('a', (0, 0)), state('a', (0, 0)), 'idle'),
        (state('a', (0, 0)), state('a', (1, 0)), 'travelling'),
        (state('a', (0, 0)), state('a', (1, 0), loads=(Load('1/a'),)), 'working'),
        (state('a', (0, 0)), state('a', (0, 0), loads=(Load('1/a'),)), 'waiting'),
        (state('busy', (0, 0)), state('busy', (0, 0)), 'waiting'),
        (state('a', (0, 0)), state('a', (0, 0), action_states=RUNNING), 'working'),
        (state('a', (0, 0)), state('a', (0, 0), power=PowerSupply(50, charging=True)), 'charging'),
        (state('broken', (0, 0)), state('broken', (0, 0)), 'failed'),
    ],
)
def test_each_step_of_a_robot_counts_as_one_activity(
    before: RobotState, now: RobotState, activity: str
) -> None:
    kpis = Kpis(window_steps=1)
    kpis.take_assignments(Assignments(1, (Assignment('busy', ('1/a',)),)))
    broken = state('broken', (0, 0))
    report = RobotReport('broken', broken, 0.0, failure='X', level=ErrorLevel.FATAL)
    if now.serial_number == 'broken':
        kpis.take_report(FleetReport(1, (report,)))
    kpis.take_state(FleetState(1, (before,)))
    kpis.take_state(FleetState(2, (now,)))
    kpis.take_state(FleetState(2, (now,)))  # a repeat
    shares = kpis.view(1.0).shares
    assert shares == {name: float(name == activity) for name in ACTIVITIES}


def test_a_robot_that_is_not_heard_of_counts_as_failed() -> None:
    kpis = Kpis()
    kpis.take_report(FleetReport(1, (RobotReport('a', state('a', (0, 0)), 0.0),)))
    kpis.take_state(FleetState(2))
    assert kpis.view(1.0).availability == 0.0


def test_the_planner_and_what_is_stuck() -> None:
    kpis = Kpis()
    for number in range(100):
        kpis.take_plans(Plans(number, planner_ms=float(number), stuck=2))
    view = kpis.view(1.0)
    assert (view.planner_p50_ms, view.planner_max_ms, view.stuck) == (49.0, 99.0, 2)


def test_a_view_goes_over_the_wire_in_camel_case() -> None:
    view = kpis_of(event('1', S.RECEIVED, 0.0), event('1', S.DELIVERED, 9.0)).view(60.0)
    assert '"cycleP95S":9.0' in encode(view)
    assert decode(encode(view), KpiView) == view


def test_a_percentile_of_nothing_is_nothing() -> None:
    assert percentile([], 0.5) is None
    assert percentile([3, 1, 2], 0.0) == 1
    assert percentile([3, 1, 2], 1.0) == 3
    assert percentile([1, 2], 0.5) == 1
    assert percentile(range(1, 101), 0.95) == 95
