"""Task Organizer: makes a task of each line of an order, and knows where each load is.

What has happened to a load it believes only the robots: their loads, and the actions that they
say have ended. So it can start anew at any time, from the newest snapshots of its peers.
"""

from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.domain.task_book import Entry, TaskBook
from ros2_kafka_warehouse.domain.task_loads import TaskLoads
from ros2_kafka_warehouse.domain.task_maker import TaskMaker
from ros2_kafka_warehouse.domain.task_status import TaskStatuses
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.orders import LineStatus, OpenOrders, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import ActionState, ActionStatus, FleetState, RobotState
from ros2_kafka_warehouse.messages.tasks import Assignments, Costs, Tasks, TaskStatus

_TRIES: Final = 3  # picks of a task that may fail, before its line does
_ENDED_ACTIONS: Final = frozenset({ActionStatus.FINISHED, ActionStatus.FAILED})


class _ActionName(NamedTuple):
    task_id: str
    attempt: int
    kind: str  # pick, drop


class TaskOrganizer:
    """Organizes the tasks of a site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._maker = TaskMaker(site)
        self._book = TaskBook()
        self._loads = TaskLoads(self._book, self._maker, site)
        self._statuses = TaskStatuses(self._book, self._maker)
        self._open: OpenOrders | None = None
        self._has_followed = False
        self._actions: dict[str, tuple[ActionState, ...]] = {}
        self._picking: dict[str, tuple[str, ...]] = {}  # by robot: tasks
        self._snapshot = Tasks(0)
        self._is_old = True

    def tasks(self) -> Tasks:
        """All tasks of the open orders; none before the robots were heard for the first time."""
        if not self._has_followed or not self._book.has_orders:
            return Tasks(0)
        if self._is_old:
            self._is_old = False
            old = self._snapshot.tasks
            tasks = tuple([entry.task for entry in self._book.entries.values()])
            self._snapshot = Tasks(self._book.step, old if old == tasks else tasks)
        return self._snapshot

    # Orders.

    def take(self, open_orders: OpenOrders) -> None:
        """Takes the newest open orders: tasks for new lines, changes of those that wait."""
        if open_orders is self._open:
            return
        self._open = open_orders
        self._book.has_orders = self._is_old = True
        before, self._book.orders = self._book.orders, {}
        for order in open_orders.orders:
            self._book.orders[order.order_id] = order
            if before.pop(order.order_id, None) != order:
                for line in order.lines:
                    self._take_line(order, line)
        for order_id, order in before.items():
            for line in order.lines:
                self._book.leave(f'{order_id}/{line.line_id}')

    def _take_line(self, order: Order, line: OrderLine) -> None:
        task_id = f'{order.order_id}/{line.line_id}'
        entry = self._book.entries.get(task_id) or self._book.past.pop(task_id, None)
        if entry is None:
            entry = Entry(self._maker.new_task(order, line, task_id))
            self._actions.clear()  # what robots have said of it before counts now
        self._book.entries[task_id] = entry
        if entry.is_over:
            return
        entry.set(priority=order.priority, due_s=order.due_s)
        self._redirect(entry, self._site.stations[order.station])
        task = entry.task
        is_other = (task.product, task.quantity) != (line.product, line.quantity)
        if not is_other or task.carried or task.stranded or line.status is not LineStatus.OPEN:
            if entry.changing_step is not None:
                entry.changing_step = None
                entry.changed_step = self._book.step + 1
        elif entry.changing_step is None:
            entry.changing_step = entry.changed_step = self._book.step + 1
        if (order.cancelled or line.withdrawn) and line.status is LineStatus.OPEN:
            if entry.withdrawn_step is None:
                entry.withdrawn_step = entry.changed_step = self._book.step + 1
        elif entry.withdrawn_step is not None:
            entry.withdrawn_step = None
            entry.changed_step = self._book.step + 1

    def _redirect(self, entry: Entry, delivery: Cell) -> None:
        """Another station is wanted: until its robot stands at the old one, it is not too late."""
        task = entry.task
        if task.delivery == delivery:
            return
        if task.carried and self._book.cells.get(task.robot) == task.delivery:
            return
        entry.set(delivery=delivery)
        entry.changed_step = self._book.step + 1

    # Robots.

    def follow(
        self,
        fleet: FleetState,
        report: FleetReport | None,
        costs: Costs | None,
        assignments: Assignments | None,
        profiles: ExecutionProfiles,
    ) -> None:
        """Finds out what has happened to each load and task, by the newest snapshots."""
        self._book.step = fleet.step
        self._has_followed = self._is_old = True
        if report is not None and report is not self._book.report:
            self._book.report = report
            self._book.robots = {robot.serial_number: robot for robot in report.robots}
        for state in fleet.states:
            if self._actions.get(state.serial_number) != state.action_states:
                self._hear(state)
            self._book.cells[state.serial_number] = state.cell
        self._book.heard = {state.serial_number for state in fleet.states}
        self._loads.place(fleet)
        if self._picking:
            self._give_up_picks()
        picking = {task_id: robot for robot, tasks in self._picking.items() for task_id in tasks}
        self._statuses.settle(picking, costs, assignments, profiles)

    def _hear(self, state: RobotState) -> None:
        """What the actions of a robot tell."""
        name = state.serial_number
        if not self._book.has_orders:
            return
        self._actions[name] = state.action_states
        picking = []
        for action in state.action_states:
            if action.action_type in ('pick', 'drop'):
                told = _action_name(action.action_id)
                entry = self._book.entries.get(told.task_id)
                if entry is not None and not entry.is_over:
                    self._hear_of(entry, told, action, state)
                    if told.kind == 'pick' and action.action_status not in _ENDED_ACTIONS:
                        picking.append(told.task_id)
        if picking or name in self._picking:
            self._picking[name] = tuple(picking)

    def _hear_of(
        self, entry: Entry, told: _ActionName, action: ActionState, state: RobotState
    ) -> None:
        if action.action_status is ActionStatus.FINISHED and told.kind == 'drop':
            self._deliver(entry, state.serial_number)
        elif action.action_status is ActionStatus.FAILED and told.attempt >= entry.task.attempt:
            self._note_failure(entry, told, state, action.result_description)
        elif action.action_status is ActionStatus.FINISHED:
            entry.picked = max(entry.picked, told.attempt)

    def _deliver(self, entry: Entry, robot: str) -> None:
        entry.set(
            status=TaskStatus.DELIVERED,
            robot=robot,
            carried=False,
            stranded=False,
            excluded=(),
            reason='',
        )

    def _note_failure(
        self, entry: Entry, told: _ActionName, state: RobotState, result: str
    ) -> None:
        """An action has failed: its next try has another number."""
        task = entry.task
        entry.changed_step = self._book.step
        entry.set(attempt=told.attempt + 1)
        if told.kind == 'drop' or task.carried:
            return
        match result:
            case 'OVERWEIGHT' | 'MISFIT':
                entry.tries += 1
                entry.unfit.add(state.robot_type)
            case 'PICK_FAILED':
                entry.tries += 1
                entry.unfit.add(state.serial_number)
            case 'LOAD_MISSING' if task.stranded and not entry.maybe:
                entry.tries += 1
                if entry.tries >= _TRIES:
                    entry.waits = f'its load is not at {task.pickup}, where it was last seen'
                return
            case 'LOAD_MISSING':
                entry.tries += 1
                self._try_other_cell(entry)
            case 'cancelled' | 'replaced by another order':
                return
            case _:
                entry.tries += 1
        if entry.tries >= _TRIES:
            reason = f'{result}: picked {entry.tries} times in vain'
            entry.set(status=TaskStatus.FAILED, robot='', reason=reason)

    def _try_other_cell(self, entry: Entry) -> None:
        task = entry.task
        entry.maybe = False
        if not task.stranded:
            entry.empty.add(task.pickup)
        stock = self._maker.stock(task)
        cells = [cell for cell in stock if cell not in entry.empty] or stock or (task.pickup,)
        entry.set(pickup=self._maker.nearest(cells, task.delivery), stranded=False)
        entry.changed_step = self._book.step

    def _give_up_picks(self) -> None:
        """Picks of robots that fell silent on them: nobody knows whether they have the load."""
        for name in list(self._picking):
            if self._book.keeps(name):
                continue
            for task_id in self._picking.pop(name):
                entry = self._book.entries.get(task_id)
                if (
                    entry is None
                    or entry.is_over
                    or entry.task.carried
                    or name in self._book.heard
                ):
                    continue
                entry.maybe = not entry.task.stranded
                self._book.strand(entry, name, self._book.cells[name])
            self._actions.pop(name, None)


def _action_name(action_id: str) -> _ActionName:
    """The parts of `<task_id>#<attempt>:<kind>`; no task if it is none."""
    rest, _, kind = action_id.rpartition(':')
    task_id, _, attempt = rest.rpartition('#')
    return (
        _ActionName(task_id, int(attempt), kind) if attempt.isdigit() else _ActionName('', 0, '')
    )
