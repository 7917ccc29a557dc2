"""Instances of the benchmark: read from public files, or made by the same rules.

The small warehouse is of the kind of Ma et al. (2017): 21 x 35 cells, ten shelves in the middle
with endpoints on both long sides, and at the left and the right places where tasks end and robots
wait. 500 tasks are released at `frequency` a step, each from a random endpoint to another one.
"""

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.domain.maps import FloorPlan, Job, read_map, read_scenario, read_tasks
from ros2_kafka_warehouse.messages.message import Cell

TASKS: Final = 500
SHELF_ROWS: Final = 5
SIDE_ENDPOINTS: Final = 102
HOMES: Final = 50


class InstanceError(Exception):
    """An instance that cannot be made as asked for."""


class Instance(NamedTuple):
    """What one run of the benchmark starts from.

    Attributes:
        name: For the table.
        rows: The map.
        starts: Where the robots start; their ids are 0, 1, ... in this order.
        jobs: The tasks; a task is known by its number in this order.
        frequency: Tasks released a step, if they were released evenly.
        standard: The small warehouse with 500 tasks, for which results are published.
    """

    name: str
    rows: tuple[str, ...]
    starts: tuple[Cell, ...]
    jobs: tuple[Job, ...]
    frequency: float | None = None
    standard: bool = False


def read(
    map_file: Path, task_file: Path | None, robots: int | None, frequency: float, seed: int
) -> Instance:
    """An instance from MAPD files; without a task file, tasks are made for the map.

    Args:
        map_file: MAPD or MovingAI.
        task_file: MAPD.
        robots: So many of the robots of the map; None: all of them.
        frequency: Of the tasks that are made.
        seed: Of what is made.

    Raises:
        MapError: A file cannot be used.
        InstanceError: The map has not so many robots.
    """
    floor = read_map(map_file)
    chance = random.Random(seed)  # noqa: S311, no secret
    name = task_file.stem if task_file else map_file.stem
    if task_file is None:
        jobs = _make_jobs(floor.endpoints, frequency, chance)
    else:
        jobs = read_tasks(task_file, floor.endpoints)
    starts = _starts(floor, robots, chance)
    found = _frequency(jobs) if task_file else frequency
    standard = len(floor.rows) == 21 and len(floor.rows[0]) == 35 and len(jobs) == TASKS
    return Instance(name, floor.rows, starts, jobs, found, standard)


def read_scene(map_file: Path, scene_file: Path, robots: int, frequency: float) -> Instance:
    """An instance from a MovingAI map and scenario.

    Robots start where the first trips start; each further trip is a task, from its start to its
    goal.

    Raises:
        MapError: A file cannot be used.
        InstanceError: The scenario is too short for so many robots.
    """
    floor = read_map(map_file)
    trips = read_scenario(scene_file, floor)
    starts = tuple(dict.fromkeys(trip.start for trip in trips[:robots]))
    if len(starts) < robots or len(trips) == robots:
        raise InstanceError(f'{scene_file}: {len(trips)} trips are too few for {robots} robots')
    jobs = tuple(
        Job(_release(number, frequency), trip.start, trip.goal)
        for number, trip in enumerate(trips[robots : robots + TASKS])
    )
    return Instance(scene_file.stem, floor.rows, starts, jobs, frequency)


def generate(robots: int, frequency: float, seed: int) -> Instance:
    """An instance of the standard kind; the same numbers give the same instance.

    Raises:
        InstanceError: The small warehouse has not so many places.
    """
    if not 1 <= robots <= HOMES:
        raise InstanceError(f'the small warehouse holds 1 to {HOMES} robots, not {robots}')
    chance = random.Random(seed)  # noqa: S311, no secret
    rows = small_warehouse(robots, chance)
    floor = FloorPlan(rows, _cells(rows, 'e'), _cells(rows, 'r'))
    jobs = _make_jobs(floor.endpoints, frequency, chance)
    return Instance(f'seed {seed}', rows, floor.starts, jobs, frequency, standard=True)


def small_warehouse(robots: int, chance: random.Random) -> tuple[str, ...]:
    """The rows of a small warehouse, with random places at its sides."""
    shelf = 'eeeeeeeeee'
    pattern = '.ss.ss.{0}.{0}.ss.ss.'
    empty = pattern.format('..........')
    rows = [empty.replace('s', '.')]
    for _ in range(SHELF_ROWS):
        beside = pattern.format(shelf)
        rows += [beside, pattern.format('@@@@@@@@@@'), beside, empty]
    rows[-1] = empty.replace('s', '.')
    sides = list(_cells(rows, 's'))
    chance.shuffle(sides)
    symbols = dict.fromkeys(sides[:SIDE_ENDPOINTS], 'e')
    symbols |= dict.fromkeys(sides[SIDE_ENDPOINTS : SIDE_ENDPOINTS + robots], 'r')
    return tuple(
        ''.join(
            symbols.get((x, y), '.') if symbol == 's' else symbol for x, symbol in enumerate(row)
        )
        for y, row in enumerate(rows)
    )


def large_warehouse() -> tuple[str, ...]:
    """A warehouse of 33 x 46 cells: 24 shelves, 480 endpoints beside them, 192 homes."""
    homes = '.rr.rr.'
    aisle = '.' * 46
    beside = f'{homes}{"eeeeeeeeee." * 3}{homes[1:]}'
    shelf = beside.replace('e', '@')
    return (aisle, *(row for _ in range(8) for row in (beside, shelf, beside, aisle)))


def _make_jobs(
    endpoints: Sequence[Cell], frequency: float, chance: random.Random
) -> tuple[Job, ...]:
    if len(endpoints) < 2:
        raise InstanceError('a map needs two endpoints for tasks')
    if frequency <= 0:
        raise InstanceError(f'the frequency must be more than 0, not {frequency:g}')
    return tuple(
        Job(_release(number, frequency), *chance.sample(endpoints, 2)) for number in range(TASKS)
    )


def _release(number: int, frequency: float) -> int:
    return int(number / frequency + 1e-9)


def _frequency(jobs: Sequence[Job]) -> float | None:
    """The frequency of tasks that were released evenly; of any others: None."""
    last = jobs[-1].release if jobs else 0
    if not last:
        return None
    for frequency in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0):
        if all(job.release == _release(number, frequency) for number, job in enumerate(jobs)):
            return frequency
    return None


def _starts(floor: FloorPlan, robots: int | None, chance: random.Random) -> tuple[Cell, ...]:
    if not floor.starts:  # a MovingAI map has none
        cells = Grid(floor.rows).cells
        if robots is None or not 1 <= robots <= len(cells):
            raise InstanceError(f'a map without robots needs a number of them, up to {len(cells)}')
        return tuple(chance.sample(cells, robots))
    if robots is not None and not 1 <= robots <= len(floor.starts):
        raise InstanceError(f'the map has {len(floor.starts)} robots, not {robots}')
    return floor.starts[:robots]


def _cells(rows: Sequence[str], symbol: str) -> tuple[Cell, ...]:
    return tuple(
        (x, y) for y, row in enumerate(rows) for x, found in enumerate(row) if found == symbol
    )
