"""One step of all robots: never a collision, and everybody arrives."""

import random
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros2_kafka_warehouse.domain.grid import Distances, Grid, one_way
from ros2_kafka_warehouse.domain.pibt import Pibt, Robot
from ros2_kafka_warehouse.messages.message import Cell

DRIVE_STEPS = 3  # of a slow robot, from cell to cell


class Fleet:
    """Robots on a floor that drive as told, one goal after the other, and check each step."""

    def __init__(
        self,
        grid: Grid,
        cells: Sequence[Cell],
        goals: Sequence[Sequence[Cell]],
        *,
        slow: frozenset[int] = frozenset(),
        broken: frozenset[int] = frozenset(),
        busy: frozenset[int] = frozenset(),
        priorities: Sequence[float] = (),
        lanes: bool = False,
        seed: int = 0,
    ) -> None:
        self.grid = grid
        self.cells = list(cells)
        self.goals = [list(some) for some in goals]
        self.slow = slow
        self.still = broken | busy
        self.priorities = priorities or [0.0] * len(cells)
        self.driving: dict[int, tuple[Cell, int]] = {}
        blocked = frozenset(self.cells[robot] for robot in broken)
        guide = one_way(grid, len(cells)) if lanes else {}
        self.distances = Distances(grid, blocked, guide=guide)
        self.pibt = Pibt(grid, seed, patience=8, guide=guide)

    def held(self, robot: int) -> tuple[Cell, ...]:
        if robot in self.driving:
            return (self.cells[robot], self.driving[robot][0])
        return (self.cells[robot],)

    def step(self) -> None:
        before = [set(self.held(robot)) for robot in range(len(self.cells))]
        robots = [self._robot(robot) for robot in range(len(self.cells))]
        chosen = self.pibt.step(robots, self.distances.blocked)
        moves = set()
        for robot, cell in enumerate(chosen):
            if robot in self.driving:
                assert cell == self.cells[robot], 'who drives does nothing else'
                self._drive_on(robot)
            elif cell != self.cells[robot]:
                assert robot not in self.still, 'who cannot move does not'
                assert cell in self.grid.neighbours(self.cells[robot]), 'one cell at a time'
                assert cell not in self.distances.blocked
                moves.add((self.cells[robot], cell))
                self._begin(robot, cell)
        self._check(before, moves)

    def _robot(self, robot: int) -> Robot:
        goals = self.goals[robot]
        return Robot(
            str(robot),
            self.cells[robot],
            self.distances.to(goals[0]) if goals else None,
            self.priorities[robot],
            self.held(robot),
            can_move=robot not in self.driving and robot not in self.still,
            leaves_slowly=robot in self.slow,
        )

    def _begin(self, robot: int, cell: Cell) -> None:
        if robot in self.slow:
            self.driving[robot] = (cell, DRIVE_STEPS - 1)
        else:
            self.cells[robot] = cell

    def _drive_on(self, robot: int) -> None:
        cell, left = self.driving.pop(robot)
        if left > 1:
            self.driving[robot] = (cell, left - 1)
        else:
            self.cells[robot] = cell

    def _check(self, before: list[set[Cell]], moves: set[tuple[Cell, Cell]]) -> None:
        after = [set(self.held(robot)) for robot in range(len(self.cells))]
        everything = [cell for cells in after for cell in cells]
        assert len(everything) == len(set(everything)), 'two robots in one cell'
        assert not any((b, a) in moves for a, b in moves), 'two robots changed places'
        for robot, cells in enumerate(after):
            for other, old in enumerate(before):
                if robot != other and {robot, other} & self.slow:
                    assert not (cells - before[robot]) & old, 'entered a cell before it was empty'

    def drive(self, most: int) -> int:
        """Drive until all goals are reached; how many steps that took."""
        for step in range(most):
            for robot, goals in enumerate(self.goals):
                while goals and robot not in self.driving and self.cells[robot] == goals[0]:
                    goals.pop(0)
            if not any(self.goals):
                return step
            self.step()
        raise AssertionError(f'not at {self.goals} after {most} steps, but at {self.cells}')


def _component(rows: Sequence[str]) -> Grid:
    """The largest part of the floor that hangs together."""
    grid, best, left = Grid(rows), set[Cell](), set(Grid(rows).cells)
    while left:
        part = set[Cell]()
        edge = [left.pop()]
        while edge:
            cell = edge.pop()
            part.add(cell)
            edge += [beside for beside in grid.neighbours(cell) if beside not in part]
        left -= part
        best = max(best, part, key=len)
    cells = [
        ''.join('.' if (x, y) in best else '@' for x in range(grid.width))
        for y in range(grid.height)
    ]
    return Grid(cells)


def _longest_corridor(grid: Grid) -> int:
    """Cells of the longest stretch without a cell where robots can pass each other."""
    narrow = {cell for cell in grid.cells if len(grid.neighbours(cell)) <= 2}
    longest = 0
    while narrow:
        edge, size = [narrow.pop()], 0
        while edge:
            cell = edge.pop()
            size += 1
            beside = [other for other in grid.neighbours(cell) if other in narrow]
            narrow.difference_update(beside)
            edge += beside
        longest = max(longest, size)
    return longest


def _floor(chance: random.Random, robots: int) -> Grid:
    """A floor full of dead ends, with as much room as it takes to pass each other."""
    while True:
        width, height = chance.randint(3, 9), chance.randint(3, 9)
        walls = chance.uniform(0.1, 0.5)
        grid = _component(
            [
                ''.join('@' if chance.random() < walls else '.' for _ in range(width))
                for _ in range(height)
            ]
        )
        can_pass = any(len(grid.neighbours(cell)) > 2 for cell in grid.cells)
        if can_pass and len(grid.cells) - robots >= 2 * _longest_corridor(grid) + 4:
            return grid


@settings(max_examples=150)
@given(st.integers(0, 1 << 32), st.integers(2, 5), st.booleans(), st.booleans())
def test_every_robot_reaches_its_goals_on_floors_with_dead_ends(
    seed: int,
    robots: int,
    some_slow: bool,  # noqa: FBT001
    lanes: bool,  # noqa: FBT001
) -> None:
    chance = random.Random(seed)  # noqa: S311
    grid = _floor(chance, robots)
    slow = frozenset(robot for robot in range(robots) if some_slow and chance.random() < 0.5)
    idle = chance.random() < 0.5  # the first one has no goal and is only in the way
    goals = [
        [chance.choice(grid.cells) for _ in range(0 if idle and not robot else 3)]
        for robot in range(robots)
    ]
    fleet = Fleet(
        grid,
        chance.sample(grid.cells, robots),
        goals,
        slow=slow,
        priorities=[float(chance.randrange(3)) for _ in range(robots)],
        lanes=lanes,
        seed=seed,
    )
    fleet.drive(30_000)


@settings(max_examples=60)
@given(st.integers(0, 1 << 32))
def test_a_crowd_with_robots_that_crashed_or_are_busy_never_collides(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311
    grid = _floor(chance, 4)
    robots = chance.randint(2, max(2, len(grid.cells) * 2 // 3))
    broken = frozenset(robot for robot in range(robots) if chance.random() < 0.2)
    busy = frozenset(robot for robot in range(robots) if chance.random() < 0.2)
    slow = frozenset(robot for robot in range(robots) if chance.random() < 0.3)
    goals = [[chance.choice(grid.cells)] for _ in range(robots)]
    cells = chance.sample(grid.cells, robots)
    fleet = Fleet(grid, cells, goals, slow=slow, broken=broken, busy=busy, seed=seed)
    for _ in range(60):
        fleet.step()


DEAD_END = ('@@@@@@.@', '........', '@@@@@@.@')


@pytest.mark.parametrize('seed', range(20))
def test_two_robots_that_meet_in_a_dead_end_let_each_other_pass(seed: int) -> None:
    fleet = Fleet(Grid(DEAD_END), [(0, 1), (7, 1)], [[(7, 1)], [(0, 1)]], seed=seed)
    fleet.drive(2000)


@pytest.mark.parametrize('seed', range(20))
def test_a_robot_at_rest_in_a_dead_end_comes_out_for_one_that_has_to_go_there(seed: int) -> None:
    fleet = Fleet(Grid(DEAD_END), [(0, 1), (7, 1)], [[], [(0, 1)]], seed=seed)
    fleet.drive(2000)


@pytest.mark.parametrize('seed', range(5))
def test_a_dead_end_that_a_crashed_robot_made_holds_nobody_up(seed: int) -> None:
    rows = ('......', '.@@@@.', '......', '......')
    fleet = Fleet(
        Grid(rows),
        [(3, 0), (1, 0), (5, 0), (0, 2)],
        [[], [(2, 2)], [(4, 0), (1, 0)], [(2, 0), (4, 0)]],
        broken=frozenset({0}),
        seed=seed,
    )
    fleet.drive(3000)


def test_robots_that_follow_each_other_move_together() -> None:
    grid = Grid(['......'])
    distances = Distances(grid)
    robots = [Robot(str(x), (x, 0), distances.to((5, 0))) for x in range(3)]
    assert Pibt(grid).step(robots) == [(1, 0), (2, 0), (3, 0)]
    slow = [robots[0], robots[1], robots[2]._replace(leaves_slowly=True)]
    assert Pibt(grid).step(slow) == [(0, 0), (1, 0), (3, 0)], 'its cell is not empty at once'


def test_a_full_circle_of_robots_turns() -> None:
    grid = Grid(['..', '..'])
    distances = Distances(grid)
    circle: list[Cell] = [(0, 0), (1, 0), (1, 1), (0, 1)]
    following = circle[1:] + circle[:1]
    robots = [
        Robot(str(cell), cell, distances.to(goal))
        for cell, goal in zip(circle, following, strict=True)
    ]
    assert Pibt(grid).step(robots) == following


def test_the_robot_with_the_higher_priority_goes_first() -> None:
    grid = Grid(['.@', '..', '.@'])
    distances = Distances(grid)
    for first in (0, 1):
        robots = [
            Robot('a', (0, 0), distances.to((1, 1)), priority=1.0 - first),
            Robot('b', (0, 2), distances.to((1, 1)), priority=float(first)),
        ]
        cells = Pibt(grid).step(robots)
        assert cells[first] == (0, 1)
        assert cells[1 - first] == robots[1 - first].cell


def test_a_robot_without_a_way_stays_and_makes_room_all_the_same() -> None:
    grid = Grid(['....'])
    distances = Distances(grid, frozenset({(3, 0)}))
    robots = [
        Robot('lost', (1, 0), distances.to((3, 0))),
        Robot('goes', (0, 0), distances.to((2, 0))),
    ]
    pibt = Pibt(grid)
    assert pibt.step(robots[:1], distances.blocked) == [(1, 0)]
    assert pibt.step(robots, distances.blocked) == [(2, 0), (1, 0)]


def test_nobody_enters_a_blocked_cell_even_to_make_room() -> None:
    grid = Grid(['...', '@.@'])
    blocked = frozenset({(2, 0), (1, 1)})
    distances = Distances(grid)  # knows nothing of what is blocked
    robots = [
        Robot('goes', (0, 0), distances.to((2, 0)), priority=1.0),
        Robot('rests', (1, 0)),
    ]
    assert Pibt(grid).step(robots, blocked) == [(0, 0), (1, 0)]
    assert Pibt(grid).step([Robot('goes', (1, 0), distances.to((2, 0)))], blocked) == [(1, 0)]
    out = Pibt(grid).step([Robot('found it', (2, 0), distances.to((0, 0)))], blocked)
    assert out == [(1, 0)], 'it may leave one'


def test_robots_without_progress_are_counted() -> None:
    grid = Grid(['...'])
    distances = Distances(grid)
    robots = [Robot('a', (0, 0), distances.to((2, 0))), Robot('b', (1, 0), can_move=False)]
    pibt = Pibt(grid, patience=4)
    for _ in range(4):
        pibt.step(robots)
    assert pibt.stuck == 0
    for _ in range(3):
        pibt.step(robots)
    assert pibt.stuck == 1


def test_the_same_seed_gives_the_same_steps() -> None:
    def way(seed: int) -> list[list[Cell]]:
        chance = random.Random(1)  # noqa: S311
        grid = _floor(chance, 5)
        distances = Distances(grid)
        goals = chance.sample(grid.cells, 5)
        cells = chance.sample(grid.cells, 5)
        pibt = Pibt(grid, seed, patience=3)
        steps = []
        for _ in range(60):
            robots = [
                Robot(str(number), cell, distances.to(goal))
                for number, (cell, goal) in enumerate(zip(cells, goals, strict=True))
            ]
            cells = pibt.step(robots)
            steps.append(cells)
        return steps

    assert way(1) == way(1)


def test_a_chain_of_a_thousand_robots_is_no_trouble() -> None:
    grid = Grid(['.' * 1001])
    distances = Distances(grid)
    robots = [
        Robot(str(x), (x, 0), distances.to((1000, 0)), priority=1.0 if x == 0 else 0.0)
        for x in range(1000)
    ]
    cells = Pibt(grid).step(robots)
    assert len(set(cells)) == 1000
