"""Runs an instance: each step the robots without a load are matched with tasks, then all drive.

Unit steps, no time to pick or to drop. In the row of step t of the trace every robot stands where
it is at t, with the load that it has then: it takes a load in the row of the step in which it
stands on the pick-up, and gives it in the row of the step in which it stands on the delivery.
`load` is the number of the task in the order of the file, or null; `x` is the column, `y` the
row. A task is served in the steps from its release to its delivery.

A robot that crashes in a step does nothing from then on, stands where it is for good, and is an
obstacle. What it carries is taken from it, in a later step, by another one on a free cell beside
it.
"""

import json
import random
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ros2_kafka_warehouse.benchmark.instances import Instance
from ros2_kafka_warehouse.domain.grid import Distances, Grid, one_way
from ros2_kafka_warehouse.domain.matching import match, prices
from ros2_kafka_warehouse.domain.pibt import Pibt, Robot
from ros2_kafka_warehouse.messages.message import Cell

# Nothing is picked or delivered for so long: the run is given up, which the result shows.
GIVEN_UP_AFTER: Final = 3000
FAR: Final = float('inf')
# Where all robots drive all the time, stricter lanes pay off: measured on 33 x 46 cells.
NEVER_IDLE_FEE: Final = 30.0


class Crash(NamedTuple):
    """A robot fails for good."""

    robot: int
    step: int


class Outcome(NamedTuple):
    """What a run has done.

    Attributes:
        delivered: By number of the task, the step of its delivery.
        undone: By number of the task, why nobody could do it.
        left: Tasks that could have been done and were not: must be empty.
        planner_ms: By step, the time for matching and planning.
        trace: A JSON text for each step.
    """

    instance: Instance
    crashes: tuple[Crash, ...]
    delivered: Mapping[int, int]
    undone: Mapping[int, str]
    left: tuple[int, ...]
    planner_ms: tuple[float, ...]
    trace: tuple[str, ...]

    @property
    def service(self) -> list[int]:
        """Steps from the release to the delivery of each task that was done."""
        return [step - self.instance.jobs[job].release for job, step in self.delivered.items()]

    @property
    def makespan(self) -> int:
        """The step of the last delivery."""
        return max(self.delivered.values(), default=0)


class Throughput(NamedTuple):
    """What robots have done that each get a new random goal as soon as they arrive."""

    robots: int
    goals_a_step: float
    planner_ms: tuple[float, ...]
    trace: tuple[str, ...]
    rows: tuple[str, ...]


class Open(NamedTuple):
    """A task that is to be picked: from where, and how far it is from there to its delivery."""

    job: int
    cells: tuple[Cell, ...]
    carry: float


def run(
    instance: Instance,
    crashes: Sequence[Crash] = (),
    seed: int = 0,
    trace_file: Path | None = None,
) -> Outcome:
    """Run an instance until all tasks are done that can be done.

    Args:
        instance: What to run.
        crashes: Robots that fail on the way.
        seed: Of the planner.
        trace_file: Where the trace goes, too.
    """
    floor = _Floor(instance, crashes, seed)
    while not floor.is_over:
        floor.act()
        floor.drive()
    outcome = floor.outcome()
    if trace_file is not None:
        trace_file.write_text(''.join(f'{row}\n' for row in outcome.trace), encoding='utf-8')
    return outcome


def run_for_ever(rows: Sequence[str], robots: int, steps: int, seed: int = 0) -> Throughput:
    """Drive to random endpoints, one after the other, and count them.

    Args:
        rows: The map.
        robots: How many; they start at random cells.
        steps: How long.
        seed: Of everything.
    """
    chance = random.Random(seed)  # noqa: S311, no secret
    grid = Grid(rows)
    endpoints = [cell for cell in grid.cells if rows[cell[1]][cell[0]] == 'e']
    guide = one_way(grid, robots, NEVER_IDLE_FEE)
    distances = Distances(grid, targets=endpoints, guide=guide)
    pibt = Pibt(grid, seed, guide=guide)
    cells = chance.sample(grid.cells, robots)
    goals = [chance.choice(endpoints) for _ in cells]
    arrived, planner_ms, trace = 0, [], [_row(0, cells, [None] * robots)]
    for step in range(1, steps + 1):
        before = time.perf_counter()
        cells = pibt.step(
            [
                Robot(str(robot), cell, distances.to(goal))
                for robot, (cell, goal) in enumerate(zip(cells, goals, strict=True))
            ]
        )
        planner_ms.append((time.perf_counter() - before) * 1e3)
        trace.append(_row(step, cells, [None] * robots))
        for robot, cell in enumerate(cells):
            if cell == goals[robot]:
                arrived += 1
                goals[robot] = chance.choice([other for other in endpoints if other != cell])
    return Throughput(robots, arrived / steps, tuple(planner_ms), tuple(trace), tuple(rows))


class _Floor:
    """The state of a run."""

    def __init__(self, instance: Instance, crashes: Sequence[Crash], seed: int) -> None:
        self.instance = instance
        self.crashes = tuple(crashes)
        self.step = 0
        self.cells = list(instance.starts)
        self.loads: list[int | None] = [None] * len(self.cells)
        self.crashed: set[int] = set()
        self.waiting: dict[int, Open] = {}
        self.delivered: dict[int, int] = {}
        self.undone: dict[int, str] = {}
        self.stranded: dict[int, Cell] = {}
        self.heading: dict[int, Cell] = {}
        self.planner_ms: list[float] = []
        self.trace: list[str] = []
        self._unreleased = sorted(
            range(len(instance.jobs)), key=lambda job: instance.jobs[job].release, reverse=True
        )
        self._last_event = 0
        self._to_check = False
        grid = Grid(instance.rows)
        guide = one_way(grid, len(self.cells))
        ends = [cell for job in instance.jobs for cell in (job.pickup, job.delivery)]
        self._steps = Distances(grid, targets=ends)
        self._costs = Distances(grid, targets=ends, guide=guide)
        self._pibt = Pibt(grid, seed, guide=guide)

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to be done, or nothing has been done for long."""
        ended = len(self.delivered) + len(self.undone)
        idle = self.step - self._last_event
        return ended == len(self.instance.jobs) or (idle > GIVEN_UP_AFTER and not self._unreleased)

    def outcome(self) -> Outcome:
        """The result of the run."""
        jobs = range(len(self.instance.jobs))
        left = tuple(job for job in jobs if job not in self.delivered and job not in self.undone)
        return Outcome(
            self.instance,
            self.crashes,
            self.delivered,
            self.undone,
            left,
            tuple(self.planner_ms),
            tuple(self.trace),
        )

    def act(self) -> None:
        """What happens where the robots stand: new tasks, deliveries, pick-ups, crashes."""
        failing = [crash.robot for crash in self.crashes if crash.step == self.step]
        self.crashed.update(failing)
        self._release()
        before = time.perf_counter()
        self._deliver()
        if self._to_check:
            self._give_up_unreachable()
        self._match()
        self.planner_ms.append((time.perf_counter() - before) * 1e3)
        self.trace.append(_row(self.step, self.cells, self.loads))
        if failing:
            before = time.perf_counter()
            self._learn_of_crashes(failing)
            self.planner_ms[-1] += (time.perf_counter() - before) * 1e3

    def drive(self) -> None:
        """One step of all robots."""
        before = time.perf_counter()
        robots = [self._robot(robot) for robot in range(len(self.cells))]
        self.cells = self._pibt.step(robots, self._steps.blocked)
        self.planner_ms[-1] += (time.perf_counter() - before) * 1e3
        self.step += 1

    def _robot(self, robot: int) -> Robot:
        load = self.loads[robot]
        goal = self.heading.get(robot) if load is None else self.instance.jobs[load].delivery
        return Robot(
            str(robot),
            self.cells[robot],
            self._costs.to(goal) if goal is not None else None,
            can_move=robot not in self.crashed,
        )

    def _learn_of_crashes(self, failing: Sequence[int]) -> None:
        blocked = [self.cells[robot] for robot in self.crashed]
        self._steps = self._steps.without(blocked)
        self._costs = self._costs.without(blocked)
        for robot in failing:
            load = self.loads[robot]
            if load is not None:
                self.stranded[load] = self.cells[robot]
                self.waiting[load] = self._open(load)
        self.waiting = {job: self._open(job) for job in self.waiting}
        self._to_check = True

    def _release(self) -> None:
        jobs = self.instance.jobs
        while self._unreleased and jobs[self._unreleased[-1]].release <= self.step:
            job = self._unreleased.pop()
            self.waiting[job] = self._open(job)
            self._to_check = bool(self.crashed)

    def _open(self, number: int) -> Open:
        job = self.instance.jobs[number]
        holder = self.stranded.get(number)
        cells: tuple[Cell, ...] = (job.pickup,)
        if holder is not None:
            beside = self._steps.grid.neighbours(holder)
            cells = tuple(cell for cell in beside if cell not in self._steps.blocked)
        carry = min((self._steps.steps(cell, job.delivery) for cell in cells), default=FAR)
        return Open(number, cells, carry)

    def _deliver(self) -> None:
        for robot, load in enumerate(self.loads):
            if load is None or robot in self.crashed:
                continue
            if self.cells[robot] == self.instance.jobs[load].delivery:
                self.loads[robot] = None
                self.delivered[load] = self.step
                self._last_event = self.step

    def _give_up_unreachable(self) -> None:
        """Crashed robots stand for good: what nobody can reach now, nobody ever can."""
        self._to_check = False
        alive = [robot for robot in range(len(self.cells)) if robot not in self.crashed]
        table = self._approach(alive, list(self.waiting.values()))
        for number, job in enumerate(list(self.waiting)):
            reached = np.isfinite(table[:, number]).any() if alive else False
            if not reached or self.waiting[job].carry == FAR:
                what = 'delivery' if reached else 'pick-up'
                self.undone[job] = f'no robot can reach its {what}'
                del self.waiting[job]
        for robot in alive:
            load = self.loads[robot]
            if load is not None and load not in self.undone:
                delivery = self.instance.jobs[load].delivery
                if self._steps.steps(self.cells[robot], delivery) == FAR:
                    self.undone[load] = 'the robot that carries it cannot reach its delivery'
        if not any(self.loads[robot] not in self.undone for robot in alive):
            self.undone |= dict.fromkeys(self.waiting, 'no robot is left that could carry it')
            self.waiting.clear()

    def _approach(self, robots: Sequence[int], tasks: Sequence[Open]) -> NDArray[np.float64]:
        """Steps until each robot (row) is at the pick-up of each task (column)."""
        jobs = self.instance.jobs
        loads = [self.loads[robot] for robot in robots]
        starts = [
            self.cells[robot] if load is None else jobs[load].delivery
            for robot, load in zip(robots, loads, strict=True)
        ]
        before = np.array(
            [
                0.0 if load is None else self._steps.steps(self.cells[robot], jobs[load].delivery)
                for robot, load in zip(robots, loads, strict=True)
            ]
        )
        nearest = [task.cells[0] if task.cells else jobs[task.job].pickup for task in tasks]
        first = self._steps.between(starts, nearest)
        for number, task in enumerate(tasks):
            if len(task.cells) != 1:
                ways = self._steps.between(starts, task.cells)
                first[:, number] = ways.min(axis=1, initial=FAR)
        return np.asarray(first + before[:, np.newaxis])

    def _match(self) -> None:
        """Give each robot without a load its task; who stands at the pick-up takes the load."""
        self.heading = {}
        alive = [robot for robot in range(len(self.cells)) if robot not in self.crashed]
        tasks = list(self.waiting.values())
        if not tasks or all(self.loads[robot] is not None for robot in alive):
            return
        approach = self._approach(alive, tasks)
        carry = np.array([task.carry for task in tasks])
        age = np.array([self.step - self.instance.jobs[task.job].release for task in tasks])
        for row, column in match(prices(approach, carry, age)):
            robot, task = alive[row], tasks[column]
            if self.loads[robot] is None:
                self._send(robot, task)

    def _send(self, robot: int, task: Open) -> None:
        cell = min(task.cells, key=lambda cell: self._steps.steps(self.cells[robot], cell))
        if self.cells[robot] != cell:
            self.heading[robot] = cell
            return
        if task.job in self.loads:  # it stood on a robot that has crashed
            self.loads[self.loads.index(task.job)] = None
        self.loads[robot] = task.job
        self.stranded.pop(task.job, None)
        del self.waiting[task.job]
        self._last_event = self.step


def _row(step: int, cells: Sequence[Cell], loads: Sequence[int | None]) -> str:
    robots = [
        {'id': robot, 'x': x, 'y': y, 'load': load}
        for robot, ((x, y), load) in enumerate(zip(cells, loads, strict=True))
    ]
    return json.dumps({'step': step, 'robots': robots}, separators=(',', ':'))
