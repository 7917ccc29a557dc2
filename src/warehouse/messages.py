"""What the modules say to each other, as JSON: the words of VDA 5050 where it has one.

Every message that holds a state is a snapshot: the whole state of its module, which the next one
replaces. Whoever starts later, or again, needs only the newest. `step` is the step of the fleet
(`FleetState.step`) that a snapshot reflects.

Cells are (column, row), counted from 0 at the top left; one cell is one metre, unless the site
says otherwise. Times that end in `_s` are seconds since the epoch, or since the start of a
simulation. JSON spells fields in camel case.
"""

from datetime import datetime
from enum import StrEnum
from functools import lru_cache
from typing import Final

import msgspec

__all__ = [
    'ORDER_ENDS',
    'Action',
    'ActionState',
    'ActionStatus',
    'Assignment',
    'Assignments',
    'Blocked',
    'Costs',
    'Error',
    'ErrorLevel',
    'FailureEvent',
    'FleetOrders',
    'FleetReport',
    'FleetState',
    'InstantAction',
    'InstantActions',
    'Line',
    'LineStatus',
    'Load',
    'Message',
    'OpenOrders',
    'OperatorCommand',
    'Order',
    'OrderEvent',
    'OrderLine',
    'OrderNode',
    'OrderRequest',
    'OrderStatus',
    'Plan',
    'Plans',
    'Position',
    'PowerSupply',
    'RobotOrder',
    'RobotReport',
    'RobotState',
    'SafetyState',
    'Task',
    'TaskStatus',
    'Tasks',
    'ValidatorReport',
    'Violation',
    'node_cell',
    'node_id',
]

Cell = tuple[int, int]

_COMMAND_LASTS_S = 60.0


class Message(msgspec.Struct, frozen=True, rename='camel', omit_defaults=True):
    """A value that goes over a topic; JSON by `warehouse.codec`."""


def node_id(cell: Cell) -> str:
    """The name of a cell as a node of VDA 5050, for example `3,14`."""
    return f'{cell[0]},{cell[1]}'


@lru_cache(maxsize=65_536)  # asked for each robot in each step
def node_cell(node: str) -> Cell:
    """The cell that a node names.

    Raises:
        ValueError: It names none.
    """
    column, row = node.split(',')
    return int(column), int(row)


# Orders: a customer asks, `orders` and `task_organizer` answer.


class Line(Message, frozen=True):
    """One product of an order; becomes one task."""

    line_id: str
    product: str
    quantity: int = 1


class OrderRequest(Message, frozen=True):
    """What comes from the Kafka topic `warehouse.orders`.

    The same id and update with the same content again changes nothing; a lower update is
    refused, as is the same update with other content (VDA 5050, 6.1.4).
    """

    order_id: str
    order_update_id: int = 0
    station: str = ''
    lines: tuple[Line, ...] = ()
    priority: int = 0  # 0 to 9, the higher the sooner
    due_time: datetime | None = None
    cancel: bool = False


class OrderStatus(StrEnum):
    """Where an order stands. DELIVERED, PARTIAL, CANCELLED, FAILED and REJECTED are ends."""

    RECEIVED = 'RECEIVED'
    PLANNED = 'PLANNED'
    ASSIGNED = 'ASSIGNED'
    PICKING = 'PICKING'
    CARRYING = 'CARRYING'
    BLOCKED = 'BLOCKED'
    DELIVERED = 'DELIVERED'
    PARTIAL = 'PARTIAL'
    CANCELLED = 'CANCELLED'
    FAILED = 'FAILED'
    REJECTED = 'REJECTED'


# How an order ends that was taken; one that was not is REJECTED.
ORDER_ENDS: Final = frozenset(
    {OrderStatus.DELIVERED, OrderStatus.PARTIAL, OrderStatus.CANCELLED, OrderStatus.FAILED}
)


class LineStatus(StrEnum):
    """How the line of an order ended, or that it has not."""

    OPEN = 'OPEN'
    DELIVERED = 'DELIVERED'
    CANCELLED = 'CANCELLED'
    FAILED = 'FAILED'


class OrderLine(Message, frozen=True):
    """A line of an order that was accepted.

    Attributes:
        withdrawn: A later update no longer wants it.
        place: Where its load was left, if it no longer is in stock nor on a robot that works.
        attempt: That of its task. Both are the Task Organizer's memory, should it start again.
    """

    line_id: str
    product: str
    quantity: int = 1
    status: LineStatus = LineStatus.OPEN
    withdrawn: bool = False
    place: Cell | None = None
    attempt: int = 0


class Order(Message, frozen=True):
    """An order that was accepted and has not ended."""

    order_id: str
    order_update_id: int
    station: str
    lines: tuple[OrderLine, ...]
    released_s: float
    priority: int = 0
    due_s: float | None = None
    cancelled: bool = False
    status: OrderStatus = OrderStatus.RECEIVED
    eta_s: float | None = None


class OpenOrders(Message, frozen=True):
    """`/orders/open`: all orders that have not ended."""

    orders: tuple[Order, ...] = ()


class OrderEvent(Message, frozen=True):
    """`/orders/events`, and from there Kafka: a status that an order, or a line, has reached.

    `(order_id, order_update_id, line_id, status)` names an event: the same again is a repeat.
    The end of a line (`line_id` set) comes before the end of its order.
    """

    order_id: str
    order_update_id: int
    status: OrderStatus
    time_s: float
    line_id: str = ''
    reason: str = ''
    robot: str = ''
    eta_s: float | None = None
    late_s: float | None = None  # of an end: later than due, negative: sooner

    def is_end(self, *, was_received: bool) -> bool:
        """Whether the order, or the line, ends with it: a refused update ends nothing."""
        refused = self.status is OrderStatus.REJECTED and not was_received
        return refused or self.status in ORDER_ENDS


# Tasks: one for each line.


class TaskStatus(StrEnum):
    """Where a task stands. DELIVERED, FAILED and CANCELLED are ends."""

    OPEN = 'OPEN'
    ASSIGNED = 'ASSIGNED'
    PICKING = 'PICKING'
    CARRIED = 'CARRIED'
    BLOCKED = 'BLOCKED'
    DELIVERED = 'DELIVERED'
    FAILED = 'FAILED'
    CANCELLED = 'CANCELLED'


class Task(Message, frozen=True):
    """One product to be carried from its pick-up to the station of its order.

    Attributes:
        pickup: Where the load is now: a stock cell, or where a robot has left it.
        stranded: The load stands on a robot that failed, or on the floor: it is picked from
            `pickup` or from a free cell next to it.
        carried: A robot has the load (`robot` says which), also while the task is BLOCKED.
        attempt: Counted up each time the load has to be picked anew; in the ids of actions.
        excluded: Robots (serial numbers) and types that may not take it.
    """

    task_id: str  # order_id/line_id
    order_id: str
    line_id: str
    product: str
    weight_kg: float
    pickup: Cell
    delivery: Cell
    released_s: float
    status: TaskStatus = TaskStatus.OPEN
    robot: str = ''
    carried: bool = False
    stranded: bool = False
    attempt: int = 0
    priority: int = 0
    due_s: float | None = None
    excluded: tuple[str, ...] = ()
    reason: str = ''
    quantity: int = 1


class Tasks(Message, frozen=True):
    """`/tasks`: all tasks of the open orders, those that have ended, too."""

    step: int
    tasks: tuple[Task, ...] = ()


class Costs(Message, frozen=True):
    """`/costs`: what it costs each robot to do each task, in seconds; None: it cannot.

    `costs[i][j]` is for `robots[i]` and `tasks[j]`; `infeasible` says of a task why no robot can
    do it now. `urgency_s[j]` is what was subtracted for the urgency of `tasks[j]`.
    """

    step: int
    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    costs: tuple[tuple[float | None, ...], ...] = ()
    infeasible: dict[str, str] = {}
    urgency_s: tuple[float, ...] = ()


class Assignment(Message, frozen=True):
    """What one robot is to do: its tasks in order, or else a cell to go to.

    `charger`: the cell of the charger where it is to charge; that goes before its tasks.
    """

    serial_number: str
    tasks: tuple[str, ...] = ()
    charger: Cell | None = None
    eta_s: tuple[float, ...] = ()  # when each task should be delivered; not while no way is free


class Assignments(Message, frozen=True):
    """`/assignments`: for each robot that has something to do."""

    step: int
    assignments: tuple[Assignment, ...] = ()


# Robots: orders to them and states from them, in the terms of VDA 5050.


class Action(Message, frozen=True):
    """`pick`, `drop` or `startCharging`, done at the node where it stands.

    `action_id` is `<task_id>#<attempt>:pick` or `...:drop`, or names the charge.
    """

    action_id: str
    action_type: str
    load_id: str = ''  # the task's id
    product: str = ''
    weight_kg: float = 0.0
    source: Cell | None = None  # where the load is, if not on the node itself


class OrderNode(Message, frozen=True):
    """A node of an order; the robot may drive to it when it is released."""

    node_id: str
    sequence_id: int
    released: bool = True
    actions: tuple[Action, ...] = ()


class RobotOrder(Message, frozen=True):
    """The order for one robot: the node where it stands, the next one, and a horizon.

    The release of a node holds for one step: what the robot could not begin lapses, and the next
    order says anew.
    """

    serial_number: str
    order_id: str
    order_update_id: int
    nodes: tuple[OrderNode, ...]


class FleetOrders(Message, frozen=True):
    """`/robots/orders`: what the robots may do next, all planned on the state of `step`.

    Robots that are not named stay where they are. It is void once any robot has moved since.
    """

    step: int
    orders: tuple[RobotOrder, ...] = ()


class InstantAction(Message, frozen=True):
    """To be done at once: `startPause`, `stopPause`, `cancelOrder`, `retry`, `stopCharging`."""

    serial_number: str
    action_id: str
    action_type: str


class InstantActions(Message, frozen=True):
    """`/robots/instant_actions`."""

    actions: tuple[InstantAction, ...]


class ActionStatus(StrEnum):
    """How far an action is."""

    WAITING = 'WAITING'
    INITIALIZING = 'INITIALIZING'
    RUNNING = 'RUNNING'
    PAUSED = 'PAUSED'
    RETRIABLE = 'RETRIABLE'
    FINISHED = 'FINISHED'
    FAILED = 'FAILED'


class ActionState(Message, frozen=True):
    """An action of the robot: of its order now, and the last ten that have ended."""

    action_id: str
    action_type: str
    action_status: ActionStatus
    result_description: str = ''


class Load(Message, frozen=True):
    """A load on a robot."""

    load_id: str
    load_type: str = ''
    weight: float = 0.0


class Position(Message, frozen=True):
    """Where the robot believes to be: metres from the top left; `theta` in radians."""

    x: float
    y: float
    theta: float = 0.0
    localized: bool = True
    map_id: str = ''


class PowerSupply(Message, frozen=True):
    """The battery; `state_of_charge` in percent."""

    state_of_charge: float
    charging: bool = False


class SafetyState(Message, frozen=True):
    """`active_emergency_stop`: MANUAL, REMOTE or NONE."""

    active_emergency_stop: str = 'NONE'
    field_violation: bool = False


class ErrorLevel(StrEnum):
    """How much an error hinders (VDA 5050, 6.6.5.1)."""

    WARNING = 'WARNING'
    URGENT = 'URGENT'
    CRITICAL = 'CRITICAL'
    FATAL = 'FATAL'


class Error(Message, frozen=True):
    """What a robot reports of itself; `error_references` as key and value."""

    error_type: str
    error_level: ErrorLevel
    error_description: str = ''
    error_hint: str = ''
    error_references: tuple[tuple[str, str], ...] = ()


class RobotState(Message, frozen=True):
    """The state of one robot (VDA 5050, 6.6).

    `last_node_id` is the cell that it holds; while it drives, it holds the cell in `node_states`,
    too.
    """

    header_id: int
    serial_number: str
    robot_type: str
    last_node_id: str
    position: Position
    power_supply: PowerSupply
    order_id: str = ''
    order_update_id: int = 0
    last_node_sequence_id: int = 0
    driving: bool = False
    paused: bool = False
    node_states: tuple[str, ...] = ()
    action_states: tuple[ActionState, ...] = ()
    loads: tuple[Load, ...] = ()
    errors: tuple[Error, ...] = ()
    safety_state: SafetyState = SafetyState()
    operating_mode: str = 'AUTOMATIC'

    @property
    def cell(self) -> Cell:
        """The cell that it holds."""
        return node_cell(self.last_node_id)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells that it holds: one, or two while it drives."""
        if not self.driving:
            return (self.cell,)
        return (self.cell, *(node_cell(node) for node in self.node_states[:1]))


class FleetState(Message, frozen=True):
    """`/robots/state`: the robots that are heard of, at one step.

    `floor` is the simulation's own memory: what stands where (pallets, loads on the floor, faults
    that nothing shows), for a simulation that starts again. No module that decides anything may
    read it; the validator does, to judge whether a robot drove through a pallet.
    """

    step: int
    states: tuple[RobotState, ...] = ()
    floor: dict[str, str] = {}


# Monitor.


class RobotReport(Message, frozen=True):
    """What the Monitor makes of one robot.

    Attributes:
        state: Its last state.
        seen_s: When that came.
        commissioned: It may get tasks; after a failure only when an operator says so.
        can_move: It may be given nodes to drive to.
        obstacle: The cells that it blocks for others as an obstacle, if it is one.
        keeps_task: False: what it carries or was to do goes to others.
        charge: '' no need, `soon` when its task is done, `now`: before anything else.
        failure: The code of its failure in the robot failure profile, or ''.
        level: Of that failure, or None.
        risk: Of failing during a task, 0 to 1, from its past.
        answer: What is being done about the failure.
    """

    serial_number: str
    state: RobotState
    seen_s: float
    commissioned: bool = True
    can_move: bool = True
    obstacle: tuple[Cell, ...] = ()
    keeps_task: bool = True
    charge: str = ''
    failure: str = ''
    level: ErrorLevel | None = None
    risk: float = 0.0
    answer: str = ''
    since_s: float = 0.0


class Blocked(Message, frozen=True):
    """A cell that is to be driven around, until it is tried again; 0: until it is unblocked."""

    cell: Cell
    reason: str
    since_s: float = 0.0
    until_s: float = 0.0


class FleetReport(Message, frozen=True):
    """`/monitor/fleet`: all robots, the cells that are blocked, and whether all must stand.

    `halted`: why no robot may move now (a pause, a violation of the rules), or ''. `floor` is
    that of the newest state, kept for the simulation; `memory` is the Monitor's own, for when it
    starts again.
    """

    step: int
    robots: tuple[RobotReport, ...] = ()
    blocked: tuple[Blocked, ...] = ()
    halted: str = ''
    faulty_chargers: tuple[Cell, ...] = ()
    floor: dict[str, str] = {}
    memory: str = ''


class FailureEvent(Message, frozen=True):
    """`/monitor/failures`, and from there Kafka: one step in the life of a failure.

    `event` is one of `FailureDetected`, `FailureDiagnosed`, `ResponseOrdered`,
    `FailureEscalated`, `TaskReassigned`, `FailureResolved`; those of one failure share
    `failure_id`. `(failure_id, sequence)` names an event: the same again is a repeat.
    """

    failure_id: str
    event: str
    time_s: float
    code: str = ''
    robot: str = ''
    cell: Cell | None = None
    level: ErrorLevel | None = None
    cause: str = ''
    evidence: str = ''
    response: str = ''
    outcome: str = ''
    task_id: str = ''
    sequence: int = 0


class OperatorCommand(Message, frozen=True):
    """`/operator/commands`, from Kafka: what a person orders. `command_id`: once only.

    `command`: `failRobot` (with `failure`: a code of the profile), `repairRobot`, `removeRobot`,
    `rejoinRobot`, `blockCell`, `unblockCell`, `pause`, `resume`, `acknowledge`.
    A blocked cell is known to nobody until a robot finds it, unless `known`. `time_s`: when it was
    given; 0: not said.
    """

    command_id: str
    command: str
    robot: str = ''
    failure: str = ''
    cell: Cell | None = None
    known: bool = False
    time_s: float = 0.0

    def is_old(self, now_s: float) -> bool:
        """Whether it has waited too long to be done: what it was given for has passed."""
        return self.time_s > 0 and now_s - self.time_s > _COMMAND_LASTS_S


# Plans for those who look on, and the validator's word.


class Plan(Message, frozen=True):
    """The way of one robot as foreseen now: cells from where it is to its goal."""

    serial_number: str
    path: tuple[Cell, ...]
    task_id: str = ''
    purpose: str = ''  # pick, drop, charge, yield


class Plans(Message, frozen=True):
    """`/path_planner/plans`: the ways of all robots that have a goal; planner time in ms."""

    step: int
    plans: tuple[Plan, ...] = ()
    planner_ms: float = 0.0
    stuck: int = 0  # robots without progress that were given the right of way


class Violation(Message, frozen=True):
    """A rule that a trace has broken."""

    step: int
    rule: str
    description: str
    robots: tuple[str, ...] = ()


class ValidatorReport(Message, frozen=True):
    """`/validator/report`: how many steps were checked, and what was broken."""

    step: int
    checked: int
    violations: tuple[Violation, ...] = ()
