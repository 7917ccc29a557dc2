"""Cost Estimator: what it would cost each robot to do each task.

A cost is in seconds: the travel to the load and a part of that with it (short work first), picking
and dropping. It is dearer by the risk that the robot fails on the way, by what the task takes of
the battery that is left, and by the strength of the robot that the load does not need; cheaper by
how urgent the task is (its priority, its due time, how long it has waited, how much of its order
is done). A pair without a cost cannot be: the robot is too weak, its battery too low, or no way
leads there.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.grid import Distances, Grid
from ros2_kafka_warehouse.domain.matching import DEFAULT
from ros2_kafka_warehouse.domain.places import obstacles, pick_cells
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.tasks import Costs, Task, Tasks, TaskStatus

Table = NDArray[np.float64]

# Of the way with the load, see `matching`: short work first keeps the mean time low.
CARRY: Final = DEFAULT.carry
# What urgency is worth, in seconds of a robot's time.
PRIORITY_S: Final = 20.0
WAITING: Final = 0.02  # for each second that a task has waited: a low priority never starves
LATE: Final = 1.0  # for each second that a task would be late now
MOST_URGENT_S: Final = 1000.0
GROUPED_S: Final = 10.0  # for the last line of an order, and less for those before
FAILING_S: Final = 120.0  # what a failure on the way costs
BATTERY_S: Final = 3.0  # for a task that takes all that is left above critical
SPARE_S: Final = 2.0  # for a robot that could carry much more

_BEGUN: Final = frozenset((TaskStatus.PICKING, TaskStatus.CARRIED, TaskStatus.DELIVERED))
WAITS: Final = frozenset((TaskStatus.OPEN, TaskStatus.ASSIGNED, TaskStatus.BLOCKED))


class CostEstimator:
    """Estimates costs on a site; remembers only distances."""

    def __init__(self, site: Site) -> None:
        self._site = site
        grid = Grid(site.rows)
        stock = (cell for product in site.products.values() for cell in product.cells)
        self._distances = Distances(
            grid, targets=(*stock, *site.stations.values(), *site.chargers)
        )
        self._free = self._distances

    def estimate(
        self, tasks: Tasks, report: FleetReport, profiles: ExecutionProfiles, now_s: float
    ) -> Costs:
        """The costs of all tasks that wait for a robot, and what nobody can do now, and why.

        Robots without a known type take part in nothing.
        """
        self._distances = self._known(obstacles(report))
        waiting = [task for task in tasks.tasks if task.status in WAITS and not task.carried]
        robots = [
            robot
            for robot in report.robots
            if robot.commissioned
            and robot.can_move
            and robot.state.robot_type in profiles.robot_types
        ]
        types = [profiles.robot_types[robot.state.robot_type] for robot in robots]
        infeasible = self._lost_ways(tasks, report)
        if not waiting:
            return Costs(tasks.step, infeasible=infeasible)
        travel = self._travel(robots, waiting)
        carry = np.array([self._carry(task) for task in waiting])
        fits = self._fits(robots, types, waiting)
        can = fits & np.isfinite(travel) & np.isfinite(carry)
        for number, task in enumerate(waiting):
            if not can[:, number].any():
                infeasible[task.task_id] = self._why_not(
                    task, fits[:, number], travel[:, number], carry[number], robots
                )
        if self._site.chargers and robots:
            way = np.where(can, travel + carry, np.inf)
            lasts, reasons = self._batteries_last(robots, types, way, waiting)
            infeasible = reasons | infeasible  # that no robot can get there says more
            can &= lasts
        urgency = _urgency(waiting, tasks.tasks, now_s)
        costs = self._seconds(robots, types, travel, carry) + _wear(robots, types, travel + carry)
        costs += _spare(types, waiting) - urgency
        return Costs(
            tasks.step,
            tuple(robot.serial_number for robot in robots),
            tuple(task.task_id for task in waiting),
            _rows(costs, can),
            infeasible,
            tuple(urgency.round(1).tolist()),
        )

    def _known(self, blocked: frozenset[Cell]) -> Distances:
        """The distances of now; those of the free floor are kept for when it is free again."""
        return self._free if not blocked else self._distances.without(blocked)

    def _travel(self, robots: Sequence[RobotReport], tasks: Sequence[Task]) -> Table:
        """Steps from each robot to where it can pick each load, at one step a cell."""
        cells = [robot.state.cells[-1] for robot in robots]
        table = self._distances.between(cells, [task.pickup for task in tasks])
        for number, task in enumerate(tasks):
            if task.stranded:
                ways = self._distances.between(cells, self._pick_cells(task))
                table[:, number] = ways.min(axis=1, initial=np.inf)
        return table

    def _carry(self, task: Task) -> float:
        """Steps from where the load is picked to its station."""
        starts = self._pick_cells(task) if task.stranded else (task.pickup,)
        return min((self._distances.steps(cell, task.delivery) for cell in starts), default=np.inf)

    def _pick_cells(self, task: Task) -> tuple[Cell, ...]:
        return pick_cells(task, self._distances.grid, self._distances.blocked)

    def _fits(
        self, robots: Sequence[RobotReport], types: Sequence[RobotType], tasks: Sequence[Task]
    ) -> NDArray[np.bool_]:
        """Whether each robot may carry each load, wherever it is."""
        kinds = {kind.name: kind for kind in types}.values()
        able = {kind.name: [self._carries(kind, task) for task in tasks] for kind in kinds}
        fits = np.array([able[kind.name] for kind in types], dtype=bool)
        fits = fits.reshape(len(robots), len(tasks))
        names = {robot.serial_number: row for row, robot in enumerate(robots)}
        for column, task in enumerate(tasks):
            rows = [names[name] for name in task.excluded if name in names]
            fits[rows, column] = False
        return fits

    def _carries(self, kind: RobotType, task: Task) -> bool:
        product = self._site.products.get(task.product)
        return (
            task.weight_kg <= kind.max_load_kg
            and (product is None or product.size in kind.sizes)
            and kind.name not in task.excluded
        )

    def _seconds(
        self,
        robots: Sequence[RobotReport],
        types: Sequence[RobotType],
        travel: Table,
        carry: Table,
    ) -> Table:
        pace = _column([kind.steps_per_cell for kind in types])
        stands = _column([kind.pick_steps + kind.drop_steps for kind in types])
        risk = _column([robot.risk for robot in robots])
        return ((travel + CARRY * carry) * pace + stands) * self._site.step_s + risk * FAILING_S

    def _batteries_last(
        self,
        robots: Sequence[RobotReport],
        types: Sequence[RobotType],
        way: Table,
        tasks: Sequence[Task],
    ) -> tuple[NDArray[np.bool_], dict[str, str]]:
        """Which batteries last for each task and for the way to a charger after it.

        Where no way leads to a charger now, the task alone counts: nobody gains if all stand still
        with what they have.

        Returns:
            Whether each robot's battery lasts; and of the tasks for which charging would not help
            any robot, why not.
        """
        ends = [task.delivery for task in tasks]
        back = self._distances.between(ends, self._site.chargers).min(axis=1, initial=np.inf)
        can_charge = np.isfinite(back)
        cells = way + np.where(can_charge, back, 0.0)
        need = cells * _column([kind.battery.per_cell for kind in types])
        charge = _charges(robots)
        full = np.maximum(charge, _column([kind.battery.target for kind in types]))
        spared = _column([kind.battery.critical for kind in types])
        lasts = np.asarray(need <= charge - spared)
        helps = np.where(can_charge, need <= full - spared, lasts)
        reasons = {
            task.task_id: f'no battery lasts for the way of {cells[:, number].min():g} cells'
            if can_charge[number]
            else 'no battery lasts for it, and no way to a charger is free'
            for number, task in enumerate(tasks)
            if not helps[:, number].any()
        }
        return lasts, reasons

    def _lost_ways(self, tasks: Tasks, report: FleetReport) -> dict[str, str]:
        """Of the loads on a robot: those that cannot get to their station now."""
        places = {robot.serial_number: robot.state.cells[-1] for robot in report.robots}
        return {
            task.task_id: f'no way is free from {place} to the station at {task.delivery}'
            for task in tasks.tasks
            if task.carried
            and (place := places.get(task.robot)) is not None
            and self._distances.steps(place, task.delivery) == np.inf
        }

    def _why_not(
        self,
        task: Task,
        fits: NDArray[np.bool_],
        travel: Table,
        carry: float,
        robots: Sequence[RobotReport],
    ) -> str:
        if not robots:
            return 'no robot is in service'
        if not fits.any():
            return f'no robot in service can carry {task.product} ({task.weight_kg:g} kg)'
        if task.pickup in self._distances.blocked and not task.stranded:
            return f'the stock cell {task.pickup} is blocked'
        if carry == np.inf:
            return f'no way is free from {task.pickup} to the station at {task.delivery}'
        if not np.isfinite(travel[fits]).any():
            return f'no robot that fits has a free way to {task.pickup}'
        return f'no robot in service can do it from {task.pickup}'


def _wear(robots: Sequence[RobotReport], types: Sequence[RobotType], way: Table) -> Table:
    """What the tasks are dearer by for robots that have little charge left."""
    left = _charges(robots) - _column([kind.battery.critical for kind in types])
    need = way * _column([kind.battery.per_cell for kind in types])
    return BATTERY_S * np.minimum(1.0, need / np.maximum(left, 1e-9))


def _spare(types: Sequence[RobotType], tasks: Sequence[Task]) -> Table:
    """What the tasks are dearer by for robots that are stronger than the load needs."""
    weights = np.array([task.weight_kg for task in tasks])
    used = weights / _column([kind.max_load_kg for kind in types])
    return SPARE_S * np.maximum(0.0, 1.0 - used)


def _urgency(waiting: Sequence[Task], tasks: Sequence[Task], now_s: float) -> Table:
    """Seconds by which each waiting task is the cheaper."""
    lines = Counter(task.order_id for task in tasks)
    begun = Counter(task.order_id for task in tasks if task.status in _BEGUN)
    return np.array(
        [
            _urgency_of(task, now_s) + GROUPED_S * begun[task.order_id] / lines[task.order_id]
            for task in waiting
        ]
    )


def _urgency_of(task: Task, now_s: float) -> float:
    late_s = 0.0 if task.due_s is None else max(0.0, now_s - task.due_s)
    waited_s = max(0.0, now_s - task.released_s)
    return min(MOST_URGENT_S, PRIORITY_S * task.priority + WAITING * waited_s + LATE * late_s)


def _charges(robots: Sequence[RobotReport]) -> Table:
    return _column([robot.state.power_supply.state_of_charge for robot in robots])


def _column(values: Sequence[float]) -> Table:
    return np.array(values, dtype=float).reshape(-1, 1)


def _rows(costs: Table, can: NDArray[np.bool_]) -> tuple[tuple[float | None, ...], ...]:
    return tuple(
        tuple(cost if able else None for cost, able in zip(row, ables, strict=True))
        for row, ables in zip(costs.round(1).tolist(), can.tolist(), strict=True)
    )
