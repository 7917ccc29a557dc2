"""Where the load of each task is, as its robot shows it, or has shown last."""

from typing import Final

from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.domain.task_book import Entry, TaskBook
from ros2_kafka_warehouse.domain.task_maker import TaskMaker
from ros2_kafka_warehouse.messages.robots import FleetState, RobotState
from ros2_kafka_warehouse.messages.tasks import TaskStatus

_LOST_STEPS: Final = 4  # that a load has to be gone before it is believed


class TaskLoads:
    """Finds the loads of the tasks of a book."""

    def __init__(self, book: TaskBook, maker: TaskMaker, site: Site) -> None:
        self._book = book
        self._maker = maker
        self._site = site

    def place(self, fleet: FleetState) -> None:
        """Take the newest states."""
        heard = {state.serial_number: state for state in fleet.states}
        self._book.holders = self._find_holders(fleet, heard)
        for load_id, state in self._book.holders.items():
            entry = self._book.entries.get(load_id) or self._adopt(load_id, state)
            if entry is None:
                continue
            if entry.is_over and not self._is_late(entry):
                continue
            if self._book.keeps(state.serial_number):
                self._carry(entry, state)
            else:
                is_heard = state.serial_number in heard
                # A silent robot drives on to the cell to which it was released.
                cell = state.cell if is_heard else state.cells[-1]
                self._book.strand(entry, state.serial_number, cell)
                if is_heard:
                    entry.waits = ''
        for task_id, entry in self._book.entries.items():
            if entry.task.carried and task_id not in self._book.holders and not entry.is_over:
                self._miss(entry, heard.get(entry.task.robot))

    def _find_holders(
        self, fleet: FleetState, heard: dict[str, RobotState]
    ) -> dict[str, RobotState]:
        """The robot that has each load; of a silent one nobody else must have had it since."""
        holders = {load.load_id: state for state in fleet.states for load in state.loads}
        for name, robot in self._book.robots.items():
            if name not in heard:
                for load in robot.state.loads:
                    if load.load_id not in holders and self._had_it_last(name, load.load_id):
                        holders[load.load_id] = robot.state
        return holders

    def _had_it_last(self, robot: str, load_id: str) -> bool:
        """Whether a robot that is silent is the last that was known to have a load."""
        entry = self._book.entries.get(load_id)
        if entry is None or entry.is_over:
            return False
        if entry.task.carried or entry.gave_up:
            return robot in (entry.gave_up, entry.task.robot)
        # A new task: the organizer has just started, and knows no more than the Monitor.
        return entry.task.status is TaskStatus.OPEN and not entry.task.stranded

    def _carry(self, entry: Entry, state: RobotState) -> None:
        entry.missed_step = entry.changing_step = None
        entry.waits = entry.gave_up = ''
        entry.maybe = False
        task, robot = entry.task, state.serial_number
        if not task.carried or task.robot != robot:
            entry.set(
                status=TaskStatus.CARRIED,
                carried=True,
                stranded=False,
                robot=robot,
                excluded=(),
                reason='',
            )
            self._believe(entry, state)

    def _believe(self, entry: Entry, state: RobotState) -> None:
        """What was picked before a change reached the robot is what the load is."""
        load = next(load for load in state.loads if load.load_id == entry.task.task_id)
        product = self._site.products.get(load.load_type)
        if product is not None and load.weight > 0:
            entry.set(
                product=load.load_type,
                quantity=max(1, round(load.weight / product.weight_kg)),
                weight_kg=load.weight,
            )

    def _miss(self, entry: Entry, state: RobotState | None) -> None:
        """The load of a task is not where it was carried."""
        if self._book.report is None:
            return
        task = entry.task
        report = self._book.robots.get(task.robot)
        if report is None or not report.keeps_task:
            place = state or (report.state if report is not None else None)
            cell = (
                place.cells[-1]
                if place is not None
                else self._book.cells.get(task.robot, task.pickup)
            )
            self._book.strand(entry, task.robot, cell)
            return
        if state is None or state.errors:
            return  # the Monitor will say what has become of the robot
        if entry.missed_step is None:
            entry.missed_step = self._book.step
        if self._book.step - entry.missed_step < _LOST_STEPS:
            return
        # It was picked by a robot whose newest deeds are undone, as after a restart of it.
        entry.missed_step = None
        entry.changed_step = self._book.step
        entry.set(
            status=TaskStatus.OPEN,
            robot='',
            carried=False,
            stranded=task.pickup not in self._maker.stock(task),
        )

    def _is_late(self, entry: Entry) -> bool:
        """Whether a robot still has the load of a task that has ended: then it goes on."""
        if entry.missed_step is None:
            entry.missed_step = self._book.step
        if self._book.step - entry.missed_step < _LOST_STEPS:
            return False
        entry.missed_step = entry.withdrawn_step = None
        entry.set(status=TaskStatus.OPEN, attempt=entry.task.attempt + 1, reason='')
        return True

    def _adopt(self, load_id: str, state: RobotState) -> Entry | None:
        """Finds or makes a task for a load of which no open order knows: it goes to a station."""
        if not self._book.has_orders:
            return None
        entry = self._book.past.pop(load_id, None)
        if entry is None:
            load = next(load for load in state.loads if load.load_id == load_id)
            entry = Entry(self._maker.orphan(load, state))
        entry.missed_step = None
        self._book.entries[load_id] = entry
        return entry
