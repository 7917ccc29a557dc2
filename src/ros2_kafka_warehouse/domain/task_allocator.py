"""Task Allocator: which robot does which tasks, in which order, and who charges where.

Every robot that carries nothing is matched anew at each look, so that a task goes to the robot
that is best for it now (`matching`); a robot with a load takes part with the time until it has
delivered.
Each gets a sequence: the task that it does, and those that it is to do after it.
"""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ros2_kafka_warehouse.domain.charging import give_chargers
from ros2_kafka_warehouse.domain.cost_estimator import CARRY
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.grid import Distances, Grid
from ros2_kafka_warehouse.domain.matching import match
from ros2_kafka_warehouse.domain.places import obstacles
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.tasks import (
    Assignment,
    Assignments,
    Costs,
    Task,
    Tasks,
    TaskStatus,
)

Table = NDArray[np.float64]

AHEAD: Final = 3  # tasks of a robot's sequence at most, with what it carries
STAYS_S: Final = (
    1.0  # so much better another robot must be to take a task from the one that has it
)


class Worker(NamedTuple):
    """A robot that does a task now, or can get one.

    Attributes:
        row: Its row in the costs.
        load: The task whose load it carries, or picks just now.
        free_in_s: When it will have delivered that.
        cell: Where it will be then.
    """

    name: str
    row: int
    load: Task | None
    free_in_s: float
    cell: Cell
    kind: RobotType


class TaskAllocator:
    """Allocates the tasks of a site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        stock = (cell for product in site.products.values() for cell in product.cells)
        self._free = Distances(
            Grid(site.rows), targets=(*stock, *site.stations.values(), *site.chargers)
        )
        self._distances = self._free
        self._first: dict[str, str] = {}
        self._chargers: dict[str, Cell] = {}

    def allocate(
        self,
        tasks: Tasks,
        report: FleetReport,
        costs: Costs,
        profiles: ExecutionProfiles,
        now_s: float,
    ) -> Assignments:
        """What each robot is to do now, and after that.

        A task that no robot can do now is in no sequence.
        """
        blocked = obstacles(report)
        self._distances = self._free if not blocked else self._distances.without(blocked)
        loads = {
            task.robot: task
            for task in tasks.tasks
            if task.carried or task.status is TaskStatus.PICKING
        }
        self._chargers = give_chargers(
            report,
            loads.keys(),
            profiles,
            self._site.chargers,
            self._distances,
            self._chargers,
            is_work=bool(costs.tasks),
        )
        by_id = {task.task_id: task for task in tasks.tasks}
        workers = self._workers(report, loads, costs, profiles)
        sequences = self._sequences(workers, [by_id.get(name) for name in costs.tasks], costs)
        self._first = {name: given[0][0] for name, given in sequences.items() if given}
        names = dict.fromkeys((*sequences, *self._chargers))
        return Assignments(
            tasks.step,
            tuple(
                Assignment(
                    name,
                    tuple(task_id for task_id, _ in sequences.get(name, ())),
                    self._chargers.get(name),
                    tuple(
                        round(now_s + in_s, 1) for _, in_s in sequences.get(name, ()) if in_s < inf
                    ),
                )
                for name in names
                if sequences.get(name) or name in self._chargers
            ),
        )

    def _workers(
        self,
        report: FleetReport,
        loads: Mapping[str, Task],
        costs: Costs,
        profiles: ExecutionProfiles,
    ) -> list[Worker]:
        rows = {name: row for row, name in enumerate(costs.robots)}
        return [
            self._worker(robot, loads.get(robot.serial_number), rows, kind)
            for robot in report.robots
            if robot.keeps_task
            and (robot.serial_number in rows or robot.serial_number in loads)
            and (robot.serial_number not in self._chargers or robot.serial_number in loads)
            and (kind := profiles.robot_types.get(robot.state.robot_type)) is not None
        ]

    def _worker(
        self, robot: RobotReport, load: Task | None, rows: Mapping[str, int], kind: RobotType
    ) -> Worker:
        name, cell = robot.serial_number, robot.state.cells[-1]
        may = rows.get(name, -1) if not robot.charge else -1
        if load is None:
            return Worker(name, may, None, 0.0, cell, kind)
        steps = self._distances.steps(cell, load.delivery) * kind.steps_per_cell + kind.drop_steps
        return Worker(name, may, load, steps * self._site.step_s, load.delivery, kind)

    def _sequences(
        self, workers: Sequence[Worker], tasks: Sequence[Task | None], costs: Costs
    ) -> dict[str, list[tuple[str, float]]]:
        """For each robot its tasks, and in how many seconds each should be delivered."""
        given: dict[str, list[tuple[str, float]]] = {
            worker.name: [(worker.load.task_id, worker.free_in_s)] if worker.load else []
            for worker in workers
        }
        able = [worker for worker in workers if worker.row >= 0]
        waiting = {column: task for column, task in enumerate(tasks) if task is not None}
        table = np.array(costs.costs, dtype=float).reshape(len(costs.robots), len(costs.tasks))
        urgency = np.array(costs.urgency_s)
        for _ in range(AHEAD):
            able = [worker for worker in able if len(given[worker.name]) < AHEAD]
            if not able or not waiting:
                break
            prices = self._prices(able, waiting, table, urgency)
            following = []
            for worker, column in self._match(able, waiting, prices):
                task = waiting.pop(column)
                done_in_s = worker.free_in_s + self._seconds(worker, task)
                given[worker.name].append((task.task_id, done_in_s))
                following.append(worker._replace(free_in_s=done_in_s, cell=task.delivery))
            able = following
        return given

    def _prices(
        self, workers: Sequence[Worker], tasks: Mapping[int, Task], table: Table, urgency: Table
    ) -> Table:
        """What each worker (row) asks for each task (column); NaN: it cannot.

        Who is free now asks its cost; who is free later, the same and the time until then.
        """
        columns = list(tasks)
        prices = table[np.ix_([worker.row for worker in workers], columns)]
        later = [number for number, worker in enumerate(workers) if worker.free_in_s > 0]
        if later:
            work = self._later_s([workers[number] for number in later], list(tasks.values()))
            possible = np.isfinite(prices[later]) & np.isfinite(work)
            prices[later] = np.where(possible, work - urgency[columns], np.nan)
        return prices

    def _match(
        self, workers: Sequence[Worker], tasks: Mapping[int, Task], prices: Table
    ) -> list[tuple[Worker, int]]:
        """Pairs of a worker and the column of its task, the cheapest for all together."""
        columns = list(tasks)
        numbers = {task.task_id: number for number, task in enumerate(tasks.values())}
        for row, worker in enumerate(workers):
            number = numbers.get(self._first.get(worker.name, ''))
            if number is not None:
                prices[row, number] -= STAYS_S
        return [(workers[row], columns[number]) for row, number in match(prices)]

    def _later_s(self, workers: Sequence[Worker], tasks: Sequence[Task]) -> Table:
        """What each task (column) takes each worker (row) after its others, as costs count it."""
        pickups = [task.pickup for task in tasks]
        travel = self._distances.between([worker.cell for worker in workers], pickups)
        carry = np.array([self._distances.steps(task.pickup, task.delivery) for task in tasks])
        pace = np.array([[worker.kind.steps_per_cell] for worker in workers])
        stands = np.array(
            [[worker.kind.pick_steps + worker.kind.drop_steps] for worker in workers]
        )
        free = np.array([[worker.free_in_s] for worker in workers])
        steps = (travel + CARRY * carry) * pace + stands
        return np.asarray(free + steps * self._site.step_s)

    def _seconds(self, worker: Worker, task: Task) -> float:
        """Seconds of a task for a worker that begins where it will be."""
        travel = self._distances.steps(worker.cell, task.pickup)
        carry = self._distances.steps(task.pickup, task.delivery)
        stands = worker.kind.pick_steps + worker.kind.drop_steps
        return ((travel + carry) * worker.kind.steps_per_cell + stands) * self._site.step_s
