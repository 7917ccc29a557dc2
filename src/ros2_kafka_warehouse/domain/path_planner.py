"""Path Planner: what every robot may do in the next step, so that none meets another.

It gives each robot a goal (the load that it is to pick, the station of the load that it carries,
a charger), lets PIBT choose the next cell of all of them together, and writes an order for each:
one node released, the rest of the way as horizon. At its goal a robot is ordered to act instead.
"""

from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.grid import Distances, Grid, one_way
from ros2_kafka_warehouse.domain.pibt import Pibt, Robot
from ros2_kafka_warehouse.domain.places import obstacles, pick_cells
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.onlookers import Plan, Plans
from ros2_kafka_warehouse.messages.robots import (
    Action,
    ActionStatus,
    FleetOrders,
    FleetState,
    OrderNode,
    RobotOrder,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments, Task, Tasks, TaskStatus

UNDER_WAY: Final = frozenset(
    (ActionStatus.WAITING, ActionStatus.INITIALIZING, ActionStatus.RUNNING, ActionStatus.PAUSED)
)
PICKABLE: Final = frozenset((TaskStatus.OPEN, TaskStatus.ASSIGNED, TaskStatus.PICKING))
MANY_LOADS: Final = 1000
CARRIES: Final = 1.0  # a robot with a load goes before one without
SEQUENCE_STEP: Final = 2  # VDA 5050: nodes have even numbers, edges the odd ones between


class Goal(NamedTuple):
    """Where a robot is to go, what for, and what it does there."""

    cell: Cell
    purpose: str  # pick, drop, charge
    order_id: str
    task_id: str = ''
    action: Action | None = None


class PathPlanner:
    """Plans the steps of all robots of a site.

    Args:
        site: The site.
        seed: For the choice among ways of the same length.
        horizon: Nodes of the way ahead in an order, that are not released.
    """

    def __init__(self, site: Site, seed: int = 0, horizon: int = 3) -> None:
        self._grid = Grid(site.rows)
        self._guide = one_way(self._grid, len(site.robots))
        stock = (cell for product in site.products.values() for cell in product.cells)
        places = (*stock, *site.stations.values(), *site.chargers)
        # With the guide these hold costs, not steps.
        self._free = Distances(self._grid, targets=places, guide=self._guide)
        self._distances = self._free
        self._pibt = Pibt(self._grid, seed, patience=20, guide=self._guide)
        self._horizon = horizon
        self._updates: dict[str, tuple[str, int]] = {}
        self._taken: dict[str, int] = {}
        self._first_step: int | None = None
        self._goals: dict[str, Goal] = {}
        self._cells: dict[str, Cell] = {}
        self._seen: dict[str, RobotState] = {}
        self._step = 0

    def plan(
        self,
        fleet: FleetState,
        tasks: Tasks,
        assignments: Assignments,
        report: FleetReport,
        profiles: ExecutionProfiles,
    ) -> FleetOrders:
        """The orders for the step that follows the state `fleet`.

        Robots that the report knows and the state does not are silent: they hold their cells.
        """
        self._step = fleet.step
        self.see(fleet)
        if self._first_step is None:
            self._first_step = fleet.step
        blocked = obstacles(report)
        self._distances = self._free if not blocked else self._distances.without(blocked)
        known = {robot.serial_number: robot for robot in report.robots}
        self._note_loads(fleet, tasks, known)
        self._goals = {} if report.halted else self._choose_goals(fleet, tasks, assignments, known)
        self._cells = {state.serial_number: state.cell for state in fleet.states}
        orders = () if report.halted else self._orders(fleet, known, profiles, blocked)
        return FleetOrders(fleet.step, orders)

    def see(self, fleet: FleetState) -> None:
        """Note where the robots are, by a state on which nothing will be planned any more."""
        for state in fleet.states:
            self._seen[state.serial_number] = state

    def plans(self, planner_ms: float = 0.0) -> Plans:
        """The ways of all robots that have a goal, as foreseen after the last `plan`.

        Args:
            planner_ms: How long that took, for those who look on.
        """
        ways = tuple(
            Plan(
                name,
                self._way(self._cells[name], goal.cell, len(self._grid.cells)),
                goal.task_id,
                goal.purpose,
            )
            for name, goal in self._goals.items()
        )
        return Plans(self._step, ways, planner_ms, self._pibt.stuck)

    # Goals

    def _note_loads(self, fleet: FleetState, tasks: Tasks, known: dict[str, RobotReport]) -> None:
        """Remember which loads are taken, and when: an old assignment must not pick them anew."""
        for state in fleet.states:
            robot = known.get(state.serial_number)
            if robot is None or robot.keeps_task:
                for load_id in _taken(state):
                    self._taken[load_id] = fleet.step
        if len(self._taken) > MANY_LOADS:
            newer = {load: step for load, step in self._taken.items() if step >= tasks.step}
            listed = {task.task_id for task in tasks.tasks}
            kept = {load: step for load, step in self._taken.items() if load in listed}
            self._taken = {**kept, **newer}

    def _choose_goals(
        self,
        fleet: FleetState,
        tasks: Tasks,
        assignments: Assignments,
        known: dict[str, RobotReport],
    ) -> dict[str, Goal]:
        by_id = {task.task_id: task for task in tasks.tasks}
        given = {assignment.serial_number: assignment for assignment in assignments.assignments}
        goals: dict[str, Goal] = {}
        for state in fleet.states:
            robot = known.get(state.serial_number)
            if robot is not None and robot.can_move:
                goal = self._goal(state, robot, given.get(state.serial_number), by_id, tasks.step)
                if goal is not None:
                    goals[state.serial_number] = goal
        return goals

    def _goal(
        self,
        state: RobotState,
        robot: RobotReport,
        given: Assignment | None,
        tasks: dict[str, Task],
        tasks_step: int,
    ) -> Goal | None:
        charger = given.charger if given is not None else None
        if charger is not None and (robot.charge == 'now' or not state.loads):
            return _charge(state, charger)
        if state.loads:
            return _drop(state, tasks) if robot.keeps_task else None
        for task_id in given.tasks[:1] if given is not None and robot.commissioned else ():
            task = tasks.get(task_id)
            if task is not None and self._may_pick(task, tasks_step):
                return self._pick(state, task)
        return None

    def _may_pick(self, task: Task, tasks_step: int) -> bool:
        """Whether the task's load still waits, for all that was seen since it was said so."""
        assert self._first_step is not None
        seen = self._taken.get(task.task_id, self._first_step - 1)
        return task.status in PICKABLE and not task.carried and tasks_step > seen

    def _pick(self, state: RobotState, task: Task) -> Goal | None:
        cells = pick_cells(task, self._grid, self._distances.blocked)
        if not cells:
            return None
        before = self._goals.get(state.serial_number)
        order_id = f'{task.task_id}#{task.attempt}'
        if before is not None and before.order_id == order_id and before.cell in cells:
            cell = before.cell
        else:
            cell = min(cells, key=lambda cell: self._distances.steps(state.cell, cell))
        action = Action(
            f'{order_id}:pick',
            'pick',
            task.task_id,
            task.product,
            task.weight_kg,
            task.pickup if task.stranded else None,
        )
        return Goal(cell, 'pick', order_id, task.task_id, action)

    # Orders

    def _orders(
        self,
        fleet: FleetState,
        known: dict[str, RobotReport],
        profiles: ExecutionProfiles,
        blocked: frozenset[Cell],
    ) -> tuple[RobotOrder, ...]:
        kinds = profiles.robot_types
        robots = [
            self._robot(state, known.get(state.serial_number), kinds.get(state.robot_type))
            for state in fleet.states
        ]
        robots += [
            Robot(state.serial_number, state.cell, holds=state.cells, can_move=False)
            for state in self._silent(fleet, known)
        ]
        cells = self._pibt.step(robots, blocked)
        orders = (
            self._order(state, cell) for state, cell in zip(fleet.states, cells, strict=False)
        )
        return tuple(order for order in orders if order is not None)

    def _silent(self, fleet: FleetState, known: dict[str, RobotReport]) -> list[RobotState]:
        """The robots that are not heard of but on the floor, as they were seen last.

        The report may be older than what was seen here: they may have driven on since.
        """
        here = {state.serial_number for state in fleet.states}
        return [
            self._seen.get(name, robot.state)
            for name, robot in known.items()
            if name not in here and (robot.commissioned or robot.obstacle)
        ]

    def _robot(
        self, state: RobotState, report: RobotReport | None, kind: RobotType | None
    ) -> Robot:
        """The robot as PIBT sees it: one that acts, drives or failed stays where it is."""
        cell = state.cell
        goal = self._goals.get(state.serial_number)
        free = (
            report is not None
            and report.can_move
            and kind is not None
            and not state.driving
            and not state.paused
            and not _is_at_work(state)
        )
        acts = free and goal is not None and goal.cell == cell and self._acts(state, goal)
        return Robot(
            state.serial_number,
            cell,
            None if goal is None else self._distances.to(goal.cell),
            CARRIES if state.loads else 0.0,
            state.cells,
            free and not acts,
            kind is not None and kind.steps_per_cell > 1,
        )

    def _acts(self, state: RobotState, goal: Goal) -> bool:
        """Whether the robot is to act where it stands: its action has not been tried yet."""
        if goal.action is None:
            return False
        if goal.purpose == 'charge':
            return not _is_charging(state, goal)
        return all(action.action_id != goal.action.action_id for action in state.action_states)

    def _order(self, state: RobotState, cell: Cell) -> RobotOrder | None:
        """The order of one robot; None if it is to stay and do nothing new."""
        goal = self._goals.get(state.serial_number)
        if cell != state.cell:
            return self._drive(state, goal, cell)
        if goal is None or goal.cell != state.cell or goal.action is None or state.driving:
            return None
        if state.paused or _is_at_work(state) or not self._acts(state, goal):
            return None
        node = OrderNode(state.last_node_id, 0, actions=(goal.action,))
        return self._numbered(state, goal.order_id, (node,))

    def _drive(self, state: RobotState, goal: Goal | None, cell: Cell) -> RobotOrder:
        order_id = goal.order_id if goal is not None else f'yield-{state.serial_number}'
        way: tuple[Cell, ...] = (state.cell, cell)
        if goal is not None and self._horizon:
            way += self._way(cell, goal.cell, self._horizon)[1:]
        nodes = tuple(
            OrderNode(node_id(place), number * SEQUENCE_STEP, number < 2)
            for number, place in enumerate(way)
        )
        return self._numbered(state, order_id, nodes)

    def _numbered(
        self, state: RobotState, order_id: str, nodes: tuple[OrderNode, ...]
    ) -> RobotOrder:
        """The order with an update number above all that the robot has had of this order."""
        name = state.serial_number
        sent_id, sent = self._updates.get(name, ('', -1))
        last = sent if sent_id == order_id else -1
        if state.order_id == order_id:
            last = max(last, state.order_update_id)
        self._updates[name] = (order_id, last + 1)
        return RobotOrder(name, order_id, last + 1, nodes)

    def _way(self, start: Cell, goal: Cell, most: int) -> tuple[Cell, ...]:
        """The cheapest way, as far as `most` cells; just the start if there is none."""
        table, index, guide = self._distances.to(goal), self._grid.index, self._guide

        def cost(step: tuple[Cell, Cell]) -> float:
            return table[index(step[1])] + guide.get(step, 1.0)

        way = [start]
        while len(way) <= most and 0 < table[index(way[-1])] < float('inf'):
            steps = ((way[-1], cell) for cell in self._grid.neighbours(way[-1]))
            way.append(min(steps, key=cost)[1])
        return tuple(way)


def _is_at_work(state: RobotState) -> bool:
    """Whether it picks or drops; no other order may come between."""
    return any(
        action.action_status in UNDER_WAY
        for action in state.action_states
        if action.action_type != 'startCharging'
    )


def _taken(state: RobotState) -> list[str]:
    """The loads that a robot has, or is about to pick."""
    picked = [
        action.action_id.rpartition('#')[0]
        for action in state.action_states
        if action.action_type == 'pick' and action.action_status in UNDER_WAY
    ]
    return picked + [load.load_id for load in state.loads]


def _charge(state: RobotState, charger: Cell) -> Goal:
    order_id = f'charge-{state.serial_number}-{node_id(charger)}'
    return Goal(charger, 'charge', order_id, action=Action(order_id, 'startCharging'))


def _drop(state: RobotState, tasks: dict[str, Task]) -> Goal | None:
    load = state.loads[0]
    task = tasks.get(load.load_id)
    if task is None:
        return None
    order_id = f'{task.task_id}#{task.attempt}'
    action = Action(f'{order_id}:drop', 'drop', task.task_id, task.product, task.weight_kg)
    return Goal(task.delivery, 'drop', order_id, task.task_id, action)


def _is_charging(state: RobotState, goal: Goal) -> bool:
    assert goal.action is not None
    if goal.purpose != 'charge':
        return False
    return state.power_supply.charging or any(
        action.action_id == goal.action.action_id and action.action_status in UNDER_WAY
        for action in state.action_states
    )
