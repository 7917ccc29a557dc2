"""What a browser is told: small rows made of the warehouse's messages, by pure functions."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

from ros2_kafka_warehouse.messages.message import Cell, Message
from ros2_kafka_warehouse.messages.monitor import FailureEvent, RobotReport
from ros2_kafka_warehouse.messages.orders import Line, Order, OrderEvent, OrderLine, OrderRequest
from ros2_kafka_warehouse.messages.robots import ActionStatus, ErrorLevel, RobotState
from ros2_kafka_warehouse.messages.tasks import Assignment, Task

_BUSY = frozenset({ActionStatus.INITIALIZING, ActionStatus.RUNNING, ActionStatus.RETRIABLE})
_STOPS = frozenset({ErrorLevel.CRITICAL, ErrorLevel.FATAL})


class RobotRow(Message, frozen=True):
    """A robot as the map and the table show it.

    Attributes:
        status: `failed`, `silent`, `removed`, `charging`, `picking`, `dropping`, `carrying`,
            `travelling`, `waiting` or `idle`.
        x: Column of its centre, in cells; a robot in the middle of cell 3 is at 3.0.
        task: What it carries, else the first that it is to do.
        queued: How many tasks wait behind that.
    """

    id: str
    type: str
    x: float
    y: float
    theta: float
    cell: Cell
    status: str
    battery: float
    charging: bool = False
    load: str = ''
    load_kg: float = 0.0
    task: str = ''
    queued: int = 0
    failure: str = ''
    level: str = ''
    answer: str = ''
    commissioned: bool = True
    paused: bool = False
    since_s: float = 0.0
    errors: tuple[str, ...] = ()


class LineRow(Message, frozen=True):
    """A line of an order, with the robot that has it."""

    id: str
    product: str
    quantity: int
    status: str
    robot: str = ''
    reason: str = ''


class OrderRow(Message, frozen=True):
    """An order that is open, or has ended."""

    id: str
    station: str
    status: str
    lines: tuple[LineRow, ...] = ()
    priority: int = 0
    released_s: float | None = None
    due_s: float | None = None
    eta_s: float | None = None
    ended_s: float | None = None
    late_s: float | None = None
    reason: str = ''


class FailureStep(Message, frozen=True):
    """One event in the life of a failure."""

    event: str
    time_s: float
    text: str = ''


class FailureRow(Message, frozen=True):
    """A failure with all that happened since it was seen."""

    id: str
    code: str
    since_s: float
    robot: str = ''
    cell: Cell | None = None
    level: str = ''
    cause: str = ''
    evidence: str = ''
    answer: str = ''
    outcome: str = ''
    task: str = ''
    ended_s: float | None = None
    steps: tuple[FailureStep, ...] = ()


def robot_row(
    state: RobotState,
    report: RobotReport | None,
    assignment: Assignment | None,
    *,
    heard: bool,
    moved: bool,
    cell_m: float,
) -> RobotRow:
    """A robot's row.

    Args:
        state: Its newest state, of the fleet, or the last that the Monitor has kept.
        report: What the Monitor makes of it.
        assignment: What it is to do.
        heard: It is in the newest state of the fleet.
        moved: It is elsewhere than in the state before.
        cell_m: Metres of a cell.
    """
    load = state.loads[0] if state.loads else None
    tasks = () if assignment is None else assignment.tasks
    task = load.load_id if load is not None else (tasks[0] if tasks else '')
    errors = tuple(f'{error.error_type}: {error.error_level}' for error in state.errors)
    return RobotRow(
        id=state.serial_number,
        type=state.robot_type,
        x=round(state.position.x / cell_m - 0.5, 3),
        y=round(state.position.y / cell_m - 0.5, 3),
        theta=round(state.position.theta, 3),
        cell=state.cell,
        status=_status(state, report, heard=heard, moved=moved, has_task=bool(task)),
        battery=round(state.power_supply.state_of_charge, 1),
        charging=state.power_supply.charging,
        load='' if load is None else load.load_id,
        load_kg=0.0 if load is None else round(load.weight, 1),
        task=task,
        queued=len([name for name in tasks if name != task]),
        failure='' if report is None else report.failure,
        level='' if report is None or report.level is None else str(report.level),
        answer='' if report is None else report.answer,
        commissioned=report is None or report.commissioned,
        paused=state.paused,
        since_s=0.0 if report is None else report.since_s,
        errors=errors,
    )


def _status(
    state: RobotState,
    report: RobotReport | None,
    *,
    heard: bool,
    moved: bool,
    has_task: bool,
) -> str:
    if (failed := _failed(report, heard=heard)) is not None:
        return failed
    if state.power_supply.charging:
        return 'charging'
    if (action := _action(state)) is not None:
        return action
    if state.driving or moved:
        return 'carrying' if state.loads else 'travelling'
    return 'waiting' if has_task else 'idle'


def _failed(report: RobotReport | None, *, heard: bool) -> str | None:
    if report is not None and not report.commissioned:
        return 'failed' if heard or report.obstacle else 'removed'
    if not heard:
        return 'silent'
    return 'failed' if report is not None and report.level in _STOPS else None


def _action(state: RobotState) -> str | None:
    busy = {it.action_type for it in state.action_states if it.action_status in _BUSY}
    return 'picking' if 'pick' in busy else 'dropping' if 'drop' in busy else None


def order_row(order: Order, tasks: Mapping[str, Task]) -> OrderRow:
    """The row of an open order; tasks by `order_id/line_id`."""
    lines = []
    for line in order.lines:
        task = tasks.get(f'{order.order_id}/{line.line_id}')
        status = str(line.status) if task is None or line.status != 'OPEN' else str(task.status)
        robot, reason = ('', '') if task is None else (task.robot, task.reason)
        lines.append(LineRow(line.line_id, line.product, line.quantity, status, robot, reason))
    return OrderRow(
        id=order.order_id,
        station=order.station,
        status=str(order.status),
        lines=tuple(lines),
        priority=order.priority,
        released_s=order.released_s,
        due_s=order.due_s,
        eta_s=order.eta_s,
    )


def ended_row(
    end: OrderEvent,
    order: Order | None,
    request: OrderRequest | None,
    lines: Mapping[str, OrderEvent],
    received_s: float | None = None,
) -> OrderRow:
    """The row of an order that has ended.

    Args:
        end: The event.
        order: As it was when it was open, if that was seen.
        request: What was asked for, if that was seen.
        lines: The last event of each of its lines.
        received_s: When it came, if that was seen.
    """
    asked = order.lines if order is not None else request.lines if request is not None else ()
    return OrderRow(
        id=end.order_id,
        station=order.station if order else request.station if request else '',
        status=str(end.status),
        lines=tuple(_ended_line(line, lines.get(line.line_id), end) for line in asked),
        priority=order.priority if order else request.priority if request else 0,
        released_s=received_s if order is None else order.released_s,
        due_s=order.due_s if order else _due_s(request.due_time) if request else None,
        ended_s=end.time_s,
        late_s=end.late_s,
        reason=end.reason,
    )


def _due_s(due: datetime | None) -> float | None:
    """As the desk takes it: a time without a zone is UTC (as local time, some cannot be)."""
    if due is None:
        return None
    return (due if due.tzinfo is not None else due.replace(tzinfo=UTC)).timestamp()


def _ended_line(line: Line | OrderLine, event: OrderEvent | None, end: OrderEvent) -> LineRow:
    if event is None:
        return LineRow(line.line_id, line.product, line.quantity, str(end.status))
    status, robot = str(event.status), event.robot
    return LineRow(line.line_id, line.product, line.quantity, status, robot, event.reason)


def failure_row(events: Iterable[FailureEvent]) -> FailureRow:
    """The row of one failure: what is newest of each field, and its steps in order."""
    ordered = sorted(events, key=lambda event: event.time_s)
    first, last = ordered[0], ordered[-1]
    resolved = [event for event in ordered if event.event == 'FailureResolved']

    def newest(name: str) -> str:
        return next((str(v) for e in reversed(ordered) if (v := getattr(e, name))), '')

    return FailureRow(
        id=first.failure_id,
        code=newest('code'),
        since_s=first.time_s,
        robot=newest('robot'),
        cell=next((event.cell for event in reversed(ordered) if event.cell), None),
        level=newest('level'),
        cause=newest('cause'),
        evidence=newest('evidence'),
        answer=newest('response'),
        outcome=newest('outcome') if resolved else '',
        task=newest('task_id'),
        ended_s=last.time_s if resolved else None,
        steps=tuple(FailureStep(e.event, e.time_s, _step_text(e)) for e in ordered),
    )


def _step_text(event: FailureEvent) -> str:
    if event.event == 'FailureDetected':
        return event.evidence
    if event.event == 'FailureDiagnosed':
        return event.cause
    response = event.response.replace('_', ' ')
    return ': '.join(text for text in (response, event.outcome) if text) or event.evidence
