"""Task Organizer: makes a task of each line of an order, and knows where each load is.

What has happened to a load it believes only the robots: their loads, and the actions that they
say have ended. So it can start anew at any time, from the newest snapshots of its peers.
"""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.grid import Distances, Grid
from warehouse.domain.places import obstacles
from warehouse.domain.site import Site
from warehouse.messages import (
    ActionState,
    ActionStatus,
    Assignments,
    Cell,
    Costs,
    FleetReport,
    FleetState,
    LineStatus,
    Load,
    OpenOrders,
    Order,
    OrderLine,
    RobotReport,
    RobotState,
    Task,
    Tasks,
    TaskStatus,
)

__all__ = ['TaskOrganizer']

_TRIES: Final = 3  # picks of a task that may fail, before its line does
_WITHDRAW_STEPS: Final = 6  # until a robot that was sent before would be seen to pick
_LOST_STEPS: Final = 4  # that a load has to be gone before it is believed
_PAST: Final = 1000  # ended tasks of ended orders that are remembered, should one come back

_ENDS: Final = frozenset({TaskStatus.DELIVERED, TaskStatus.FAILED, TaskStatus.CANCELLED})
_LINE_ENDS: Final = {
    LineStatus.DELIVERED: TaskStatus.DELIVERED,
    LineStatus.FAILED: TaskStatus.FAILED,
    LineStatus.CANCELLED: TaskStatus.CANCELLED,
}
_ENDED_ACTIONS: Final = frozenset({ActionStatus.FINISHED, ActionStatus.FAILED})


class _Entry:
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
        return self.task.status in _ENDS

    def set(self, **changes: Any) -> bool:
        """Changes the task; says whether that made a difference."""
        task = self.task
        if all(getattr(task, name) == value for name, value in changes.items()):
            return False
        self.task = replace(task, **changes)
        return True


class _ActionName(NamedTuple):
    task_id: str
    attempt: int
    kind: str  # pick, drop


class TaskOrganizer:
    """Organizes the tasks of a site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._types = {robot.robot_type for robot in site.robots.values()}
        self._distances = Distances(Grid(site.rows), targets=tuple(site.stations.values()))
        self._entries: dict[str, _Entry] = {}
        self._past: dict[str, _Entry] = {}
        self._orders: dict[str, Order] = {}
        self._open: OpenOrders | None = None
        self._step = 0
        self._has_followed = False
        self._report: FleetReport | None = None
        self._robots: dict[str, RobotReport] = {}
        self._actions: dict[str, tuple[ActionState, ...]] = {}
        self._picking: dict[str, tuple[str, ...]] = {}  # by robot: tasks
        self._cells: dict[str, Cell] = {}
        self._holders: dict[str, RobotState] = {}  # by load
        self._heard: set[str] = set()
        self._snapshot = Tasks(0)
        self._is_old = True

    def tasks(self) -> Tasks:
        """All tasks of the open orders; none before the robots were heard for the first time."""
        if not self._has_followed or self._open is None:
            return Tasks(0)
        if self._is_old:
            self._is_old = False
            old = self._snapshot.tasks
            tasks = tuple([entry.task for entry in self._entries.values()])
            self._snapshot = Tasks(self._step, old if old == tasks else tasks)
        return self._snapshot

    # Orders.

    def take(self, open_orders: OpenOrders) -> None:
        """Takes the newest open orders: tasks for new lines, changes of those that wait."""
        if open_orders is self._open:
            return
        self._open = open_orders
        self._is_old = True
        before, self._orders = self._orders, {}
        for order in open_orders.orders:
            self._orders[order.order_id] = order
            if before.pop(order.order_id, None) != order:
                for line in order.lines:
                    self._take_line(order, line)
        for order_id, order in before.items():
            for line in order.lines:
                self._leave(f'{order_id}/{line.line_id}')

    def _take_line(self, order: Order, line: OrderLine) -> None:
        task_id = f'{order.order_id}/{line.line_id}'
        entry = self._entries.get(task_id) or self._past.pop(task_id, None)
        if entry is None:
            entry = _Entry(self._new_task(order, line, task_id))
            self._actions.clear()  # what robots have said of it before counts now
        self._entries[task_id] = entry
        if entry.is_over:
            return
        entry.set(priority=order.priority, due_s=order.due_s)
        self._redirect(entry, self._site.stations[order.station])
        task = entry.task
        is_other = (task.product, task.quantity) != (line.product, line.quantity)
        if not is_other or task.carried or task.stranded or line.status is not LineStatus.OPEN:
            if entry.changing_step is not None:
                entry.changing_step = None
                entry.changed_step = self._step + 1
        elif entry.changing_step is None:
            entry.changing_step = entry.changed_step = self._step + 1
        if (order.cancelled or line.withdrawn) and line.status is LineStatus.OPEN:
            if entry.withdrawn_step is None:
                entry.withdrawn_step = entry.changed_step = self._step + 1
        elif entry.withdrawn_step is not None:
            entry.withdrawn_step = None
            entry.changed_step = self._step + 1

    def _redirect(self, entry: _Entry, delivery: Cell) -> None:
        """Another station is wanted: until its robot stands at the old one, it is not too late."""
        task = entry.task
        if task.delivery == delivery:
            return
        if task.carried and self._cells.get(task.robot) == task.delivery:
            return
        entry.set(delivery=delivery)
        entry.changed_step = self._step + 1

    def _new_task(self, order: Order, line: OrderLine, task_id: str) -> Task:
        product = self._site.products[line.product]
        delivery = self._site.stations[order.station]
        return Task(
            task_id=task_id,
            order_id=order.order_id,
            line_id=line.line_id,
            product=line.product,
            weight_kg=round(line.quantity * product.weight_kg, 3),
            pickup=line.place or self._nearest(product.cells, delivery),
            delivery=delivery,
            released_s=order.released_s,
            status=_LINE_ENDS.get(line.status, TaskStatus.OPEN),
            stranded=line.place is not None,
            attempt=line.attempt,
            priority=order.priority,
            due_s=order.due_s,
            quantity=line.quantity,
        )

    def _nearest(self, cells: Iterable[Cell], delivery: Cell) -> Cell:
        return min(cells, key=lambda cell: self._distances.steps(cell, delivery))

    def _leave(self, task_id: str) -> None:
        """Forgets a task of an order that has ended, unless a robot still has to do with it."""
        entry = self._entries.get(task_id)
        if entry is None or (not entry.is_over and entry.task.carried):
            return
        entry.changing_step = None
        del self._entries[task_id]
        self._past[task_id] = entry
        if len(self._past) > _PAST:
            del self._past[next(iter(self._past))]

    # Robots.

    def follow(
        self,
        fleet: FleetState,
        report: FleetReport | None,
        costs: Costs | None,
        assignments: Assignments | None,
        profiles: ExecutionProfiles,
        now_s: float,  # noqa: ARG002 - the organizer counts steps
    ) -> None:
        """Finds out what has happened to each load and task, by the newest snapshots."""
        self._step = fleet.step
        self._has_followed = self._is_old = True
        if report is not None and report is not self._report:
            self._report = report
            self._robots = {robot.serial_number: robot for robot in report.robots}
        for state in fleet.states:
            if self._actions.get(state.serial_number) != state.action_states:
                self._hear(state)
            self._cells[state.serial_number] = state.cell
        self._heard = {state.serial_number for state in fleet.states}
        self._place_loads(fleet)
        self._settle(costs, assignments, profiles)

    def _keeps(self, robot: str) -> bool:
        report = self._robots.get(robot)
        return report is None or report.keeps_task

    def _being_picked(self) -> dict[str, str]:
        """The tasks that are being picked, and by which robot."""
        return {task_id: robot for robot, tasks in self._picking.items() for task_id in tasks}

    def _hear(self, state: RobotState) -> None:
        """What the actions of a robot tell."""
        name = state.serial_number
        if self._open is None:
            return
        self._actions[name] = state.action_states
        picking = []
        for action in state.action_states:
            if action.action_type in ('pick', 'drop'):
                told = _action_name(action.action_id)
                entry = self._entries.get(told.task_id)
                if entry is not None and not entry.is_over:
                    self._hear_of(entry, told, action, state)
                    if told.kind == 'pick' and action.action_status not in _ENDED_ACTIONS:
                        picking.append(told.task_id)
        if picking or name in self._picking:
            self._picking[name] = tuple(picking)

    def _hear_of(
        self, entry: _Entry, told: _ActionName, action: ActionState, state: RobotState
    ) -> None:
        if action.action_status is ActionStatus.FINISHED and told.kind == 'drop':
            self._deliver(entry, state.serial_number)
        elif action.action_status is ActionStatus.FAILED and told.attempt >= entry.task.attempt:
            self._note_failure(entry, told, state, action.result_description)
        elif action.action_status is ActionStatus.FINISHED:
            entry.picked = max(entry.picked, told.attempt)

    def _deliver(self, entry: _Entry, robot: str) -> None:
        entry.set(
            status=TaskStatus.DELIVERED,
            robot=robot,
            carried=False,
            stranded=False,
            excluded=(),
            reason='',
        )

    def _note_failure(
        self, entry: _Entry, told: _ActionName, state: RobotState, result: str
    ) -> None:
        """An action has failed: its next try has another number."""
        task = entry.task
        entry.changed_step = self._step
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

    def _try_other_cell(self, entry: _Entry) -> None:
        task = entry.task
        entry.maybe = False
        if not task.stranded:
            entry.empty.add(task.pickup)
        stock = self._stock(task)
        cells = [cell for cell in stock if cell not in entry.empty] or stock or (task.pickup,)
        entry.set(pickup=self._nearest(cells, task.delivery), stranded=False)
        entry.changed_step = self._step

    # Loads.

    def _place_loads(self, fleet: FleetState) -> None:
        """Where each load is, as its robot shows it, or has shown last."""
        heard = {state.serial_number: state for state in fleet.states}
        self._holders = self._find_holders(fleet, heard)
        for load_id, state in self._holders.items():
            entry = self._entries.get(load_id) or self._adopt(load_id, state)
            if entry is None:
                continue
            if entry.is_over and not self._is_late(entry):
                continue
            if self._keeps(state.serial_number):
                self._carry(entry, state)
            else:
                is_heard = state.serial_number in heard
                # A silent robot drives on to the cell to which it was released.
                cell = state.cell if is_heard else state.cells[-1]
                self._strand(entry, state.serial_number, cell)
                if is_heard:
                    entry.waits = ''
        for task_id, entry in self._entries.items():
            if entry.task.carried and task_id not in self._holders and not entry.is_over:
                self._miss(entry, heard.get(entry.task.robot))
        if self._picking:
            self._give_up_picks(heard)

    def _find_holders(
        self, fleet: FleetState, heard: dict[str, RobotState]
    ) -> dict[str, RobotState]:
        """The robot that has each load; of a silent one nobody else must have had it since."""
        holders = {load.load_id: state for state in fleet.states for load in state.loads}
        for name, robot in self._robots.items():
            if name not in heard:
                for load in robot.state.loads:
                    if load.load_id not in holders and self._had_it_last(name, load.load_id):
                        holders[load.load_id] = robot.state
        return holders

    def _had_it_last(self, robot: str, load_id: str) -> bool:
        """Whether a robot that is silent is the last that was known to have a load."""
        entry = self._entries.get(load_id)
        if entry is None or entry.is_over:
            return False
        if entry.task.carried or entry.gave_up:
            return robot in (entry.gave_up, entry.task.robot)
        # A new task: the organizer has just started, and knows no more than the Monitor.
        return entry.task.status is TaskStatus.OPEN and not entry.task.stranded

    def _carry(self, entry: _Entry, state: RobotState) -> None:
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

    def _believe(self, entry: _Entry, state: RobotState) -> None:
        """What was picked before a change reached the robot is what the load is."""
        load = next(load for load in state.loads if load.load_id == entry.task.task_id)
        product = self._site.products.get(load.load_type)
        if product is not None and load.weight > 0:
            entry.set(
                product=load.load_type,
                quantity=max(1, round(load.weight / product.weight_kg)),
                weight_kg=load.weight,
            )

    def _strand(self, entry: _Entry, robot: str, cell: Cell) -> None:
        """Its robot has given the task up: others pick the load from where it is."""
        task = entry.task
        if task.stranded and task.pickup == cell and entry.gave_up == robot:
            return
        entry.gave_up = robot
        entry.changed_step = self._step
        entry.missed_step = None
        entry.set(
            status=TaskStatus.OPEN,
            robot='',
            carried=False,
            stranded=True,
            pickup=cell,
            attempt=task.attempt if task.stranded else task.attempt + 1,
        )

    def _miss(self, entry: _Entry, state: RobotState | None) -> None:
        """The load of a task is not where it was carried."""
        if self._report is None:
            return
        task = entry.task
        report = self._robots.get(task.robot)
        if report is None or not report.keeps_task:
            place = state or (report.state if report is not None else None)
            cell = (
                place.cells[-1] if place is not None else self._cells.get(task.robot, task.pickup)
            )
            self._strand(entry, task.robot, cell)
            return
        if state is None or state.errors:
            return  # the Monitor will say what has become of the robot
        if entry.missed_step is None:
            entry.missed_step = self._step
        if self._step - entry.missed_step < _LOST_STEPS:
            return
        # It was picked by a robot whose newest deeds are undone, as after a restart of it.
        entry.missed_step = None
        entry.changed_step = self._step
        entry.set(
            status=TaskStatus.OPEN,
            robot='',
            carried=False,
            stranded=task.pickup not in self._stock(task),
        )

    def _is_late(self, entry: _Entry) -> bool:
        """Whether a robot still has the load of a task that has ended: then it goes on."""
        if entry.missed_step is None:
            entry.missed_step = self._step
        if self._step - entry.missed_step < _LOST_STEPS:
            return False
        entry.missed_step = entry.withdrawn_step = None
        entry.set(status=TaskStatus.OPEN, attempt=entry.task.attempt + 1, reason='')
        return True

    def _adopt(self, load_id: str, state: RobotState) -> _Entry | None:
        """Finds or makes a task for a load of which no open order knows: it goes to a station."""
        if self._open is None:
            return None
        entry = self._past.pop(load_id, None)
        if entry is None:
            load = next(load for load in state.loads if load.load_id == load_id)
            entry = _Entry(self._orphan(load, state))
        entry.missed_step = None
        self._entries[load_id] = entry
        return entry

    def _stock(self, task: Task) -> tuple[Cell, ...]:
        product = self._site.products.get(task.product)
        return () if product is None else product.cells

    def _orphan(self, load: Load, state: RobotState) -> Task:
        order_id, _, line_id = load.load_id.rpartition('/')
        stations = self._site.stations.values()
        delivery = min(stations, key=lambda cell: self._distances.steps(state.cell, cell))
        return Task(
            task_id=load.load_id,
            order_id=order_id,
            line_id=line_id,
            product=load.load_type,
            weight_kg=load.weight,
            pickup=state.cell,
            delivery=delivery,
            released_s=0.0,
            status=TaskStatus.CANCELLED,
            reason='no open order knows its load',
        )

    def _give_up_picks(self, heard: dict[str, RobotState]) -> None:
        """Picks of robots that fell silent on them: nobody knows whether they have the load."""
        for name in list(self._picking):
            if self._keeps(name):
                continue
            for task_id in self._picking.pop(name):
                entry = self._entries.get(task_id)
                if entry is None or entry.is_over or entry.task.carried or name in heard:
                    continue
                entry.maybe = not entry.task.stranded
                self._strand(entry, name, self._cells[name])
            self._actions.pop(name, None)

    # Status.

    def _settle(
        self,
        costs: Costs | None,
        assignments: Assignments | None,
        profiles: ExecutionProfiles,
    ) -> None:
        """The status of each task, from all that is known."""
        picking = self._being_picked()
        assigned = {
            task_id: assignment.serial_number
            for assignment in (assignments.assignments if assignments is not None else ())
            for task_id in assignment.tasks
        }
        for task_id, entry in list(self._entries.items()):
            task = entry.task
            if entry.is_over:
                if task.order_id not in self._orders and task_id not in self._holders:
                    self._leave(task_id)
                continue
            reason = self._infeasible(entry, costs)
            if task.carried:
                status = TaskStatus.BLOCKED if reason else TaskStatus.CARRIED
                entry.set(status=status, reason=reason)
            elif task_id in picking:
                entry.set(status=TaskStatus.PICKING, robot=picking[task_id], reason='')
            else:
                if entry.picked >= task.attempt:
                    # The load was lost before it was seen; no robot does an action twice.
                    entry.set(attempt=entry.picked + 1)
                self._settle_waiting(entry, assigned.get(task_id, ''), reason, profiles)

    def _settle_waiting(
        self, entry: _Entry, robot: str, reason: str, profiles: ExecutionProfiles
    ) -> None:
        """The status of a task whose load nobody has."""
        changing_step = None if entry.task.stranded else entry.changing_step
        since = changing_step if entry.withdrawn_step is None else entry.withdrawn_step
        if since is not None:
            if robot or self._step - since < _WITHDRAW_STEPS:
                entry.set(status=TaskStatus.OPEN, robot='', excluded=tuple(profiles.robot_types))
            elif entry.withdrawn_step is None:
                self._renew(entry.task)
            else:
                entry.set(
                    status=TaskStatus.CANCELLED, robot='', excluded=(), reason='no longer wanted'
                )
            return
        if lost := self._lost(entry, profiles):
            entry.set(status=TaskStatus.FAILED, robot='', excluded=(), reason=lost)
        elif entry.waits:
            entry.set(
                status=TaskStatus.BLOCKED,
                robot='',
                reason=entry.waits,
                excluded=tuple(profiles.robot_types),
            )
        elif reason:
            self._avoid_obstacle(entry)
            self._let_try_again(entry, profiles)
            entry.set(
                status=TaskStatus.BLOCKED, robot='', reason=reason, excluded=self._excluded(entry)
            )
        else:
            status = TaskStatus.ASSIGNED if robot else TaskStatus.OPEN
            entry.set(status=status, robot=robot, reason='', excluded=self._excluded(entry))

    def _renew(self, task: Task) -> None:
        """Makes the task anew, as it is wanted now."""
        order = self._orders[task.order_id]
        line = next(line for line in order.lines if line.line_id == task.line_id)
        wanted = self._new_task(order, replace(line, place=None), task.task_id)
        renewed = replace(wanted, attempt=task.attempt + 1, released_s=task.released_s)
        self._entries[task.task_id] = entry = _Entry(renewed)
        entry.changed_step = self._step

    def _infeasible(self, entry: _Entry, costs: Costs | None) -> str:
        """Why no robot can do the task now, or ''; costs of an older form of it do not count."""
        if costs is None or costs.step < entry.changed_step:
            return entry.task.reason if entry.task.status is TaskStatus.BLOCKED else ''
        return costs.infeasible.get(entry.task.task_id, '')

    def _avoid_obstacle(self, entry: _Entry) -> None:
        """Picks from another stock cell of the product, if the one that was chosen is blocked."""
        task = entry.task
        if task.stranded or self._report is None:
            return
        blocked = obstacles(self._report)
        others = [
            cell for cell in self._stock(task) if cell not in blocked and cell not in entry.empty
        ]
        if task.pickup in blocked and others:
            entry.set(pickup=self._nearest(others, task.delivery))
            entry.changed_step = self._step

    def _let_try_again(self, entry: _Entry, profiles: ExecutionProfiles) -> None:
        """Rather a robot that could not pick it before than nobody; its tries are counted."""
        again = entry.unfit & self._robots.keys()
        able = self._able(entry.task, profiles)
        if able <= entry.unfit:
            again |= able
        if again:
            entry.unfit -= again
            entry.changed_step = self._step

    def _excluded(self, entry: _Entry) -> tuple[str, ...]:
        """Who may not take it; a robot that had to give it up, until it is in service again."""
        if entry.gave_up and not self._keeps(entry.gave_up):
            return tuple(sorted({*entry.unfit, entry.gave_up}))
        return tuple(sorted(entry.unfit))

    def _may_have(self, robot: str) -> bool:
        """Whether a robot that is not heard may still have a load; one that is heard shows it."""
        report = self._robots.get(robot)
        return report is not None and report.failure != 'REMOVED' and robot not in self._heard

    def _lost(self, entry: _Entry, profiles: ExecutionProfiles) -> str:
        """Why no type of robot of this site will ever do the task, or ''."""
        task = entry.task
        if entry.waits and self._report is not None and not self._may_have(entry.gave_up):
            return f'{entry.waits}, and no robot has it'
        if self._able(task, profiles):
            return ''
        product = self._site.products.get(task.product)
        size = product.size if product is not None else 'unknown'
        return f'no type of robot here can carry {task.weight_kg:g} kg of size {size}'

    def _able(self, task: Task, profiles: ExecutionProfiles) -> set[str]:
        """The types of robots on this site that can carry a load, by their profiles."""
        product = self._site.products.get(task.product)
        kinds = (kind for kind in profiles.robot_types.values() if kind.name in self._types)
        return {
            kind.name
            for kind in kinds
            if task.weight_kg <= kind.max_load_kg
            and (product is None or product.size in kind.sizes)
        }


def _action_name(action_id: str) -> _ActionName:
    """The parts of `<task_id>#<attempt>:<kind>`; no task if it is none."""
    rest, _, kind = action_id.rpartition(':')
    task_id, _, attempt = rest.rpartition('#')
    return (
        _ActionName(task_id, int(attempt), kind) if attempt.isdigit() else _ActionName('', 0, '')
    )
