"""What a browser is told of robots, orders and failures."""

from datetime import UTC, datetime

import pytest

from ros2_kafka_warehouse.messages.monitor import FailureEvent, RobotReport
from ros2_kafka_warehouse.messages.orders import (
    Line,
    LineStatus,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    Load,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Assignment, Task, TaskStatus
from ros2_kafka_warehouse.page.rows import RobotRow, ended_row, failure_row, order_row, robot_row


def a_state(**changes: object) -> RobotState:
    fields: dict[str, object] = {
        'header_id': 1,
        'serial_number': 'carrier-01',
        'robot_type': 'carrier',
        'last_node_id': '3,4',
        'position': Position(3.5, 4.5),
        'power_supply': PowerSupply(61.23),
    }
    return RobotState(**{**fields, **changes})  # type: ignore[arg-type]


def a_row(
    state: RobotState,
    report: RobotReport | None = None,
    tasks: tuple[str, ...] = (),
    *,
    heard: bool = True,
    moved: bool = False,
) -> RobotRow:
    assignment = Assignment('carrier-01', tasks) if tasks else None
    return robot_row(state, report, assignment, heard=heard, moved=moved, cell_m=1.0)


def test_a_robot_is_drawn_at_the_middle_of_its_cell() -> None:
    row = a_row(a_state())
    assert (row.x, row.y, row.cell, row.battery) == (3.0, 4.0, (3, 4), 61.2)


def test_cells_of_another_size_are_counted_too() -> None:
    state = a_state(position=Position(7.0, 9.0))
    row = robot_row(state, None, None, heard=True, moved=False, cell_m=2.0)
    assert (row.x, row.y) == (3.0, 4.0)


PICKS = (ActionState('t#0:pick', 'pick', ActionStatus.RUNNING),)
DROPPED = (ActionState('t#0:drop', 'drop', ActionStatus.FINISHED),)


@pytest.mark.parametrize(
    ('changes', 'tasks', 'moved', 'status'),
    [
        ({}, (), False, 'idle'),
        ({}, ('o/L1',), False, 'waiting'),
        ({}, ('o/L1',), True, 'travelling'),
        ({'driving': True}, ('o/L1',), False, 'travelling'),
        ({'loads': (Load('o/L1'),)}, (), True, 'carrying'),
        ({'loads': (Load('o/L1'),)}, (), False, 'waiting'),
        ({'action_states': PICKS}, ('o/L1',), False, 'picking'),
        ({'action_states': DROPPED}, (), False, 'idle'),
        ({'power_supply': PowerSupply(40, charging=True)}, ('o/L1',), False, 'charging'),
    ],
)
def test_what_a_robot_does_is_one_word(
    changes: dict[str, object],
    tasks: tuple[str, ...],
    moved: bool,  # noqa: FBT001 (a parameter of the test)
    status: str,
) -> None:
    assert a_row(a_state(**changes), tasks=tasks, moved=moved).status == status


def test_a_robot_out_of_service_is_shown_as_failed_with_what_is_done() -> None:
    state = a_state(errors=(Error('motionFault', ErrorLevel.FATAL),))
    report = RobotReport(
        'carrier-01',
        state,
        1.0,
        commissioned=False,
        failure='MOTION_FAULT',
        level=ErrorLevel.FATAL,
        answer='reassign',
        since_s=5.0,
    )
    row = a_row(state, report, ('o/L1',), moved=True)
    assert (row.status, row.failure, row.level) == ('failed', 'MOTION_FAULT', 'FATAL')
    assert (row.answer, row.since_s, row.errors) == ('reassign', 5.0, ('motionFault: FATAL',))


def test_a_warning_does_not_make_a_working_robot_failed() -> None:
    state = a_state()
    report = RobotReport('carrier-01', state, 1.0, failure='STALLED', level=ErrorLevel.WARNING)
    assert a_row(state, report, moved=True).status == 'travelling'


def test_a_robot_that_is_not_heard_is_silent_then_failed_then_off_the_floor() -> None:
    state = a_state()
    report = RobotReport('carrier-01', state, 1.0)
    assert a_row(state, report, heard=False).status == 'silent'
    gone = RobotReport('carrier-01', state, 1.0, commissioned=False, obstacle=((3, 4),))
    assert a_row(state, gone, heard=False).status == 'failed'
    removed = RobotReport('carrier-01', state, 1.0, commissioned=False)
    assert a_row(state, removed, heard=False).status == 'removed'


def test_the_task_of_a_robot_is_what_it_carries_before_what_it_is_to_do() -> None:
    row = a_row(a_state(loads=(Load('o/L2', weight=3.21),)), tasks=('o/L2', 'o/L1', 'o/L3'))
    assert (row.task, row.queued, row.load_kg) == ('o/L2', 2, 3.2)


def test_an_open_order_shows_who_has_each_line_and_why_one_waits() -> None:
    lines = (OrderLine('L1', 'tea', 2), OrderLine('L2', 'rice', status=LineStatus.DELIVERED))
    order = Order('o', 0, 'packing-1', lines, 10.0, priority=3, due_s=70.0, eta_s=60.0)
    tasks = {
        'o/L1': Task(
            'o/L1', 'o', 'L1', 'tea', 1.0, (1, 1), (2, 2), 10.0,
            status=TaskStatus.BLOCKED, robot='carrier-01', reason='no way',
        )
    }  # fmt: skip
    row = order_row(order, tasks)
    assert [(line.status, line.robot, line.reason) for line in row.lines] == [
        ('BLOCKED', 'carrier-01', 'no way'),
        ('DELIVERED', '', ''),
    ]
    assert (row.priority, row.due_s, row.eta_s) == (3, 70.0, 60.0)


END = OrderEvent('o', 0, OrderStatus.PARTIAL, 100.0, reason='one line failed', late_s=12.0)
FAILED = OrderEvent('o', 0, OrderStatus.FAILED, 99.0, 'L1', reason='no stock')


def test_an_ended_order_keeps_its_lines_and_says_why() -> None:
    order = Order('o', 0, 'packing-1', (OrderLine('L1', 'tea', 2),), 10.0, due_s=88.0)
    row = ended_row(END, order, None, {'L1': FAILED})
    assert (row.status, row.reason, row.ended_s, row.late_s) == (
        'PARTIAL', 'one line failed', 100.0, 12.0,
    )  # fmt: skip
    assert (row.station, row.due_s, row.lines[0].reason) == ('packing-1', 88.0, 'no stock')


def test_an_order_that_ended_before_the_page_was_there_is_known_by_its_request() -> None:
    due = datetime(2026, 1, 1, tzinfo=UTC)
    request = OrderRequest('o', 0, 'packing-2', (Line('L1', 'tea', 2),), due_time=due)
    row = ended_row(END, None, request, {})
    assert (row.station, row.due_s, row.lines[0].product) == (
        'packing-2', due.timestamp(), 'tea',
    )  # fmt: skip


@pytest.mark.parametrize(
    ('due', 'due_s'),
    [
        (datetime(2026, 1, 1), datetime(2026, 1, 1, tzinfo=UTC).timestamp()),  # noqa: DTZ001
        (datetime(1, 1, 1), -62_135_596_800.0),  # noqa: DTZ001
        (datetime(9999, 12, 31, tzinfo=UTC), 253_402_214_400.0),
    ],
)
def test_a_due_time_without_a_zone_is_utc_however_far_away(due: datetime, due_s: float) -> None:
    request = OrderRequest('o', 0, 'packing-2', due_time=due)
    assert ended_row(END, None, request, {}).due_s == due_s


def test_an_end_of_which_nothing_else_is_known_is_shown_all_the_same() -> None:
    assert ended_row(END, None, None, {}).status == 'PARTIAL'


def test_a_failure_is_told_from_its_events_in_order_of_time() -> None:
    def event(name: str, time_s: float, **more: object) -> FailureEvent:
        return FailureEvent('f1', name, time_s, robot='carrier-01', **more)  # type: ignore[arg-type]

    events = [
        event('ResponseOrdered', 2.0, response='reassign'),
        event('FailureDetected', 1.0, evidence='error motionFault'),
        event('FailureResolved', 9.0, outcome='repaired', code='MOTION_FAULT'),
        event('FailureDiagnosed', 1.5, code='MOTION_FAULT', cause='effector'),
    ]
    row = failure_row(events)
    assert (row.code, row.cause, row.evidence) == ('MOTION_FAULT', 'effector', 'error motionFault')
    assert (row.answer, row.outcome) == ('reassign', 'repaired')
    assert (row.since_s, row.ended_s) == (1.0, 9.0)
    assert [(step.event, step.text) for step in row.steps] == [
        ('FailureDetected', 'error motionFault'),
        ('FailureDiagnosed', 'effector'),
        ('ResponseOrdered', 'reassign'),
        ('FailureResolved', 'repaired'),
    ]
    assert failure_row(events[:2]).ended_s is None
