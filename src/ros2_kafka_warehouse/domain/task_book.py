"""What the Task Organizer knows: its tasks, and what robots have shown of late."""

from typing import TYPE_CHECKING, Any, Final

from msgspec.structs import replace

from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.tasks import TASK_ENDS, Task, TaskStatus

if TYPE_CHECKING:
    from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
    from ros2_kafka_warehouse.messages.orders import Order
    from ros2_kafka_warehouse.messages.robots import RobotState

_PAST: Final = 1000  # ended tasks of ended orders that are remembered, should one come back


class Entry:
    """A task, and what only the organizer needs to know of it.

    Attributes:
        tries: Picks that failed.
        empty: Stock cells where the load was missing.
        unfit: Robots and types that could not pick it.
        gave_up: The robot that had the load and gave the task up, or ''.
        waits: Why it has to wait for a person or a robot, or ''.
        maybe: It is not sure that the load was picked at all.
        withdrawn_step: When it was no longer wanted, or None.
        changing_step: When another product or quantity was wanted, or None.
        picked: The last attempt that a robot says it has picked it in, or -1.
        missed_step: Since when its robot does not show the load (or shows one that has ended).
        changed_step: When its pick-up or who may take it changed; older costs do not count.
    """

    __slots__ = (
        'changed_step',
        'changing_step',
        'empty',
        'gave_up',
        'maybe',
        'missed_step',
        'picked',
        'task',
        'tries',
        'unfit',
        'waits',
        'withdrawn_step',
    )

    def __init__(self, task: Task) -> None:
        self.task = task
        self.tries = 0
        self.empty: set[Cell] = set()
        self.unfit: set[str] = set()
        self.gave_up = ''
        self.waits = ''
        self.maybe = False
        self.withdrawn_step: int | None = None
        self.changing_step: int | None = None
        self.missed_step: int | None = None
        self.picked = -1
        self.changed_step = 0

    @property
    def is_over(self) -> bool:
        """Whether the task has ended."""
        return self.task.status in TASK_ENDS

    def set(self, **changes: Any) -> None:
        """Changes the task, if that makes a difference."""
        if any(getattr(self.task, name) != value for name, value in changes.items()):
            self.task = replace(self.task, **changes)


class TaskBook:
    """All tasks, and what is known of the robots that do them.

    Attributes:
        entries: The tasks of the open orders, and those that a robot still has to do with.
        past: Others that have ended.
        orders: The open orders, by id.
        has_orders: They were heard of.
        step: Of the newest state.
        report: The newest of the Monitor; `robots` are those in it.
        heard: The robots in the newest state.
        cells: Where each robot was when it was heard of last.
        holders: By load: the robot that has it.
    """

    def __init__(self) -> None:
        self.entries: dict[str, Entry] = {}
        self.past: dict[str, Entry] = {}
        self.orders: dict[str, Order] = {}
        self.has_orders = False
        self.step = 0
        self.report: FleetReport | None = None
        self.robots: dict[str, RobotReport] = {}
        self.heard: set[str] = set()
        self.cells: dict[str, Cell] = {}
        self.holders: dict[str, RobotState] = {}

    def keeps(self, robot: str) -> bool:
        """Whether a robot keeps what it has, or is to do."""
        report = self.robots.get(robot)
        return report is None or report.keeps_task

    def leave(self, task_id: str) -> None:
        """Forgets a task of an order that has ended, unless a robot still has to do with it."""
        entry = self.entries.get(task_id)
        if entry is None or (not entry.is_over and entry.task.carried):
            return
        entry.changing_step = None
        del self.entries[task_id]
        self.past[task_id] = entry
        if len(self.past) > _PAST:
            del self.past[next(iter(self.past))]

    def strand(self, entry: Entry, robot: str, cell: Cell) -> None:
        """Its robot has given the task up: others pick the load from where it is."""
        task = entry.task
        if task.stranded and task.pickup == cell and entry.gave_up == robot:
            return
        entry.gave_up = robot
        entry.changed_step = self.step
        entry.missed_step = None
        entry.set(
            status=TaskStatus.OPEN,
            robot='',
            carried=False,
            stranded=True,
            pickup=cell,
            attempt=task.attempt if task.stranded else task.attempt + 1,
        )
