"""Where each robot of a fleet drives in one step, so that none meets another.

Priority inheritance with backtracking (PIBT): the robots choose in the order of their priority;
who wants the cell of another makes it choose next, with its own priority, and takes another cell
if that one cannot get away. Each step is free of collisions, whatever happened before.

PIBT alone can stand still for ever where a robot has come to meet another in a dead end (and
robots that fail make dead ends). Therefore a robot without progress draws a lot for the right of
way, again and again, until it gets on; after long it, or who cannot make room for it, drives to a
place near by at random for a while.
"""

import random
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ros2_kafka_warehouse.domain.grid import Grid, Guide
from ros2_kafka_warehouse.messages.message import Cell

UNDECIDED = -1
FAR = float('inf')
EVEN = (1.0, 1.0, 1.0, 1.0)
# So deep the chain of robots that make room for one another may be: each takes four of the 1000
# calls that Python allows for.
DEEPEST = 120
# A robot that is stuck goes aside 2, 4, 8 ... cells, at most this number of doublings.
FARTHEST = 6
# After so many times the patience a robot at rest forgets that it could not make room.
FORGOTTEN = 40


class Robot(NamedTuple):
    """What the planner knows of a robot in one step.

    Attributes:
        name: Tells it from the others from step to step.
        cell: Where it stands.
        goal_distances: `Distances.to(goal)`; None: no goal, it stays unless another needs to pass.
        priority: Higher goes first; among equals, who is longest on its way.
        holds: The cells that it holds: two while it drives; empty: just `cell`.
        can_move: False: it stays where it is now, whatever others wish.
        leaves_slowly: It takes several steps to the next cell: nobody may follow at once, and it
            enters only cells that are empty.
    """

    name: str
    cell: Cell
    goal_distances: Sequence[float] | None = None
    priority: float = 0.0
    holds: tuple[Cell, ...] = ()
    can_move: bool = True
    leaves_slowly: bool = False


class _Way:
    """What is remembered of a robot: how it gets on towards its goal."""

    __slots__ = ('age', 'best', 'lot', 'lot_ends', 'refused', 'row', 'tries', 'waited', 'wander')

    def __init__(self) -> None:
        self.row: Sequence[float] | None = None
        self.best = FAR
        self.age = 0
        self.waited = 0
        self.tries = 0
        self.refused = 0
        self.lot = 0.0
        self.lot_ends = 0
        self.wander: Sequence[float] | None = None

    def begin(self, row: Sequence[float] | None) -> None:
        """A new goal, or none."""
        self.__init__()  # type: ignore[misc]
        self.row = row

    @property
    def heading(self) -> Sequence[float] | None:
        """Where it drives now."""
        return self.row if self.wander is None else self.wander


class Pibt:
    """The planner of single steps. The same seed and the same robots: the same steps.

    Attributes:
        stuck: How many robots were without progress, and so drew lots, in the last step.
    """

    def __init__(
        self, grid: Grid, seed: int = 0, *, patience: int = 12, guide: Guide | None = None
    ) -> None:
        """A planner for a grid.

        Args:
            grid: The floor.
            seed: For the choice between ways of the same length.
            patience: Steps without progress until a robot draws lots; about twice what the
                slowest robot needs for a cell, a pick or a drop.
            guide: The guide with which the distances were made, if any.
        """
        self.grid = grid
        self.stuck = 0
        self._patience = patience
        self._random = random.Random(seed)  # noqa: S311, planning, no secret
        self._fees = _fees(grid, guide or {})
        self._ways: dict[str, _Way] = {}
        self._step = 0
        self._shut: frozenset[int] = frozenset()
        self._open_links: Sequence[Sequence[int]] = grid.links

    def step(self, robots: Sequence[Robot], blocked: frozenset[Cell] = frozenset()) -> list[Cell]:
        """The next cell of each robot: beside its own or the same.

        Args:
            robots: All robots on the floor.
            blocked: Cells that no robot may enter.
        """
        self._step += 1
        shut = frozenset(self.grid.index(cell) for cell in blocked if self.grid.is_free(cell))
        if shut != self._shut:
            self._shut, self._open_links = shut, _without(self.grid.links, shut)
        ways = self._follow(robots)
        choice = _Choice(self.grid, robots, ways, shut, self._fees, self._random)
        next_cells = choice.all()
        for number in choice.refused:
            if ways[number].row is None:
                ways[number].waited += 2
                ways[number].refused = self._step
        return [self.grid.cell(cell) for cell in next_cells]

    def _follow(self, robots: Sequence[Robot]) -> list[_Way]:
        known = self._ways
        ways = [known.get(robot.name) or _Way() for robot in robots]
        self._ways = {robot.name: way for robot, way in zip(robots, ways, strict=True)}
        self.stuck = 0
        for robot, way in zip(robots, ways, strict=True):
            self._see_progress(robot, way)
            if way.waited > self._patience or way.lot:
                self._draw_lots(robot, way)
            self.stuck += way.waited > self._patience
        return ways

    def _see_progress(self, robot: Robot, way: _Way) -> None:
        row = robot.goal_distances
        here = FAR if row is None else row[self.grid.index(robot.cell)]
        if here in (0.0, FAR):  # it is where it wants to be, or cannot get there
            row = None
        if row is not way.row:
            way.begin(row)
        if row is None:
            way.waited = max(0, way.waited - 1)
            if self._step - way.refused > FORGOTTEN * self._patience:
                way.tries = 0
        elif here < way.best:
            way.best = here
            way.waited = 0
        else:
            way.waited += robot.can_move
        way.age += 1

    def _draw_lots(self, robot: Robot, way: _Way) -> None:
        """Give the right of way for a while, by chance; who gets on with it keeps it."""
        if self._step < way.lot_ends:
            return
        way.wander = None
        if way.waited <= self._patience:
            if way.row is None:
                way.lot = 0.0
            return
        chance = self._random
        way.tries += 1
        reach = 2 << chance.randrange(min(way.tries, FARTHEST))
        # Who rests comes out first, because who wants to pass has nothing to try.
        way.lot = 1.0 - chance.random() + (way.row is None)
        way.lot_ends = self._step + chance.randint(self._patience, 2 * self._patience)
        if way.row is None or (way.tries > 2 and chance.random() < 0.5):
            way.wander, steps = self._place_aside(robot.cell, reach)
            way.lot_ends += 2 * steps

    def _place_aside(self, cell: Cell, radius: int) -> tuple[Sequence[float], int]:
        """A place at random behind a cell where robots can pass each other, and the way there.

        It lies within the radius, or farther off if nearer there is none.
        """
        links, start = self._open_links, self.grid.index(cell)
        near = _reached(links, start, radius)
        places = _passing_places(links, near)
        while not places and len(near) < len(further := _reached(links, start, 2 * radius)):
            near, radius = further, 2 * radius
            places = _passing_places(links, near)
        goal = self._random.choice(places or list(near))
        row = [FAR] * len(links)
        for index, steps in _reached(links, goal, 3 * radius).items():
            row[index] = steps
        return row, near[goal]


class _Choice:
    """The choices of all robots in one step.

    A robot is decided once its next cell is set. While robots make room for one another they are
    on the `chain`, from who asked first (depth 0) to who is asked now.

    Attributes:
        refused: Robots that were asked to make room and could not.
    """

    __slots__ = (
        'asked', 'cells', 'chain', 'fees', 'firm', 'links', 'next_cells', 'random', 'refused',
        'robots', 'shut', 'standing', 'taken', 'ways',
    )  # fmt: skip

    def __init__(
        self,
        grid: Grid,
        robots: Sequence[Robot],
        ways: Sequence[_Way],
        shut: frozenset[int],
        fees: Sequence[Sequence[float]] | None,
        chance: random.Random,
    ) -> None:
        self.robots = robots
        self.ways = ways
        self.shut = shut
        self.fees = fees
        self.links = grid.links
        self.random = chance.random
        self.cells = [grid.index(robot.cell) for robot in robots]
        self.next_cells = [UNDECIDED] * len(robots)
        self.standing: dict[int, int] = {}
        self.taken: dict[int, int] = {}
        self.chain: dict[int, int] = {}
        self.firm = 0
        self.refused: list[int] = []
        for number, robot in enumerate(robots):
            held = [grid.index(cell) for cell in robot.holds] or [self.cells[number]]
            self.standing.update(dict.fromkeys(held, number))
            if not robot.can_move:
                self.next_cells[number] = self.cells[number]
                self.taken.update(dict.fromkeys(held, number))

    def all(self) -> list[int]:
        """The next cell of each robot."""
        for number in sorted(range(len(self.robots)), key=self._rank):
            if self.next_cells[number] == UNDECIDED:
                self._choose(number, None)
        return self.next_cells

    def _rank(self, number: int) -> tuple[bool, float, float, int, float]:
        way = self.ways[number]
        idle = way.heading is None
        return idle, -way.lot, -self.robots[number].priority, -way.age, self.random()

    def _choose(self, number: int, asking: int | None) -> bool:
        """Decide on the next cell of a robot.

        Args:
            number: The robot.
            asking: The robot that needs its cell.

        Returns:
            Whether it found a cell; otherwise it stays.
        """
        depth = self.chain[number] = len(self.chain)
        found = depth < DEEPEST and any(
            self._enter(number, cell) for cell in self._wishes(number, asking)
        )
        if not found:
            self._take(number, self.cells[number])
            if asking is not None:
                self.refused.append(number)
        del self.chain[number]
        return found

    def _wishes(self, number: int, asking: int | None) -> list[int]:
        """The cells where it can go, the best first; who is asked does not stay."""
        here = self.cells[number]
        way = self.ways[number]
        row = way.heading
        if row is None:
            return [here] if asking is None else self._ways_aside(here, asking)
        # Who goes aside minds no lanes.
        fees = self.fees[here] if self.fees and way.wander is None else EVEN
        wishes = [
            (row[cell] + fee, cell in self.standing, self.random(), cell)
            for cell, fee in zip(self.links[here], fees, strict=False)
        ]
        if asking is None:
            wishes.append((row[here] + 1.0, False, 0.0, here))
        wishes.sort()
        return [wish[3] for wish in wishes]

    def _ways_aside(self, here: int, asking: int) -> list[int]:
        """Where a robot without a goal goes: to an empty cell, off the way of who asks."""
        row = self.ways[asking].heading
        wishes = [
            (cell in self.standing, -row[cell] if row else 0.0, self.random(), cell)
            for cell in self.links[here]
        ]
        wishes.sort()
        return [wish[3] for wish in wishes]

    def _enter(self, number: int, cell: int) -> bool:
        """Take a cell for a robot, if its holder, if any, gets away in time."""
        if cell in self.taken or (cell in self.shut and cell != self.cells[number]):
            return False
        other = self.standing.get(cell, number)
        if other == number:
            self._take(number, cell)
            return True
        if self.robots[number].leaves_slowly or self.robots[other].leaves_slowly:
            if self.next_cells[other] == UNDECIDED and other not in self.chain:
                self._ask_for_later(number, other)
            return False
        if self.next_cells[other] != UNDECIDED:
            return self._follow(number, cell, other)
        return other not in self.chain and self._push(number, cell, other)

    def _follow(self, number: int, cell: int, other: int) -> bool:
        """Take the cell of a robot that is to leave it, if they do not change places."""
        leaves = self.chain.get(other, self.firm) >= self.firm
        if not leaves or self.next_cells[other] == self.cells[number]:
            return False
        self._take(number, cell)
        return True

    def _push(self, number: int, cell: int, other: int) -> bool:
        """Take the cell of a robot that has yet to choose, if it finds another one."""
        self._take(number, cell)
        if self._choose(other, number):
            return True
        self.next_cells[number] = UNDECIDED
        return False

    def _ask_for_later(self, number: int, other: int) -> None:
        """Make one get away whose cell can be entered only once it is empty.

        What it does must not rest on any robot of the chain, all of which may yet stay.
        """
        before = self.firm
        self.firm = len(self.chain)
        self._choose(other, number)
        self.firm = before

    def _take(self, number: int, cell: int) -> None:
        self.next_cells[number] = cell
        self.taken[cell] = number


def _fees(grid: Grid, guide: Guide) -> list[list[float]] | None:
    """By index of a cell, what it costs to drive to each of its `links`."""
    if not guide:
        return None
    return [
        [guide.get((grid.cell(here), grid.cell(cell)), 1.0) for cell in beside]
        for here, beside in enumerate(grid.links)
    ]


def _without(links: Sequence[Sequence[int]], shut: frozenset[int]) -> Sequence[Sequence[int]]:
    """The links that do not lead to a cell that is shut."""
    if not shut:
        return links
    return [[cell for cell in beside if cell not in shut] for beside in links]


def _passing_places(links: Sequence[Sequence[int]], near: dict[int, int]) -> list[int]:
    """Cells beside a crossing of three ways or more, seen from the start of `near` behind it."""
    crossings = [cell for cell in near if len(links[cell]) > 2]
    behind = (
        beside for cell in crossings for beside in links[cell] if near.get(beside, 0) > near[cell]
    )
    return list(dict.fromkeys(behind))


def _reached(links: Sequence[Sequence[int]], start: int, radius: int) -> dict[int, int]:
    """The cells within so many steps, and how many it takes."""
    steps = {start: 0}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        if steps[cell] == radius:
            break
        for beside in links[cell]:
            if beside not in steps:
                steps[beside] = steps[cell] + 1
                queue.append(beside)
    return steps
