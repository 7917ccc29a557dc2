"""Tasks, one for each line: what they cost, and who does them."""

from enum import StrEnum
from typing import Final

from msgspec import field

from ros2_kafka_warehouse.messages.message import Cell, Message


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


TASK_ENDS: Final = frozenset({TaskStatus.DELIVERED, TaskStatus.FAILED, TaskStatus.CANCELLED})


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
    infeasible: dict[str, str] = field(default_factory=dict)
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
