"""The floor as a grid of cells, and how far it is from each cell to each goal."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ros2_kafka_warehouse.messages.message import Cell

# What it costs to drive from one cell to the next one; 1.0 where it does not say.
Guide = Mapping[tuple[Cell, Cell], float]
Indices = NDArray[np.int32]

TABLE_ROWS_AT_ONCE = 256
# Measured on warehouses of 600 to 1300 cells with 10 to 140 robots.
CROWD_FEE = 14.0


class Grid:
    """The cells of a floor and which of them lie side by side; never changes.

    Inside the planner a cell is its index, `y * width + x`: a small number is a fast key.
    """

    def __init__(self, rows: Sequence[str]) -> None:
        """A grid of rows of text: `@` is a wall or a shelf, anything else can be driven on."""
        self.rows = tuple(rows)
        self.width = max((len(row) for row in self.rows), default=0)
        self.height = len(self.rows)
        self._free = bytes(
            symbol != '@' for row in self.rows for symbol in row.ljust(self.width, '@')
        )

    def is_free(self, cell: Cell) -> bool:
        """Whether a robot can stand there: on the map, and no wall."""
        x, y = cell
        return 0 <= x < self.width and 0 <= y < self.height and bool(self._free[self.index(cell)])

    def index(self, cell: Cell) -> int:
        """The number of a cell of the map, counted row by row."""
        return cell[1] * self.width + cell[0]

    def cell(self, index: int) -> Cell:
        """The cell with that number."""
        return index % self.width, index // self.width

    def neighbours(self, cell: Cell) -> tuple[Cell, ...]:
        """The free cells beside a cell: above, left, right, below."""
        x, y = cell
        beside = ((x, y - 1), (x - 1, y), (x + 1, y), (x, y + 1))
        return tuple(other for other in beside if self.is_free(other))

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All free cells, row by row."""
        return tuple(self.cell(index) for index, free in enumerate(self._free) if free)

    @cached_property
    def links(self) -> tuple[tuple[int, ...], ...]:
        """By index of a cell: the indices of the free cells beside it; none for a wall."""
        return tuple(
            tuple(self.index(other) for other in self.neighbours(self.cell(index))) if free else ()
            for index, free in enumerate(self._free)
        )


class Distances:
    """How many steps it is from every cell to a goal.

    A blocked cell can be left but not entered: a robot that stands there finds out.

    Attributes:
        grid: The floor.
        blocked: Cells that cannot be entered.
        guide: What driving costs where it costs more than one step. With a guide the tables hold
            costs instead of steps.
    """

    def __init__(
        self,
        grid: Grid,
        blocked: frozenset[Cell] = frozenset(),
        targets: Iterable[Cell] = (),
        guide: Guide | None = None,
    ) -> None:
        """Tables for `targets` are made at once, those for other goals when first asked for."""
        self.grid = grid
        self.blocked = frozenset(blocked)
        self.guide = guide or {}
        self._arrays: dict[Cell, NDArray[np.float64]] = {}
        self._rows: dict[Cell, list[float]] = {}
        self.prepare(targets)

    def prepare(self, targets: Iterable[Cell]) -> None:
        """Make the tables of several goals together, which is faster than one by one."""
        missing = [goal for goal in dict.fromkeys(targets) if goal not in self._arrays]
        for start in range(0, len(missing), TABLE_ROWS_AT_ONCE):
            goals = missing[start : start + TABLE_ROWS_AT_ONCE]
            indices = [self.grid.index(goal) for goal in goals]
            table = dijkstra(self._towards_goals, indices=indices, unweighted=not self.guide)
            self._arrays.update(zip(goals, table, strict=True))

    def to(self, goal: Cell) -> list[float]:
        """Steps to `goal` by `Grid.index` of the cell where one starts; inf where no way leads.

        The same list each time, which nobody may change.
        """
        row = self._rows.get(goal)
        if row is None:
            row = self._rows[goal] = self.array(goal).tolist()
        return row

    def array(self, goal: Cell) -> NDArray[np.float64]:
        """The same as `to`, as an array."""
        if goal not in self._arrays:
            self.prepare((goal,))
        return self._arrays[goal]

    def steps(self, start: Cell, goal: Cell) -> float:
        """Steps from one cell to another; inf if no way leads there."""
        return self.to(goal)[self.grid.index(start)]

    def between(self, starts: Sequence[Cell], goals: Sequence[Cell]) -> NDArray[np.float64]:
        """Steps from each of `starts` (rows) to each of `goals` (columns)."""
        if not starts or not goals:
            return np.zeros((len(starts), len(goals)))
        self.prepare(goals)
        different = {goal: number for number, goal in enumerate(dict.fromkeys(goals))}
        indices = [self.grid.index(start) for start in starts]
        table = np.array([self._arrays[goal][indices] for goal in different])
        return table[[different[goal] for goal in goals]].T

    def without(self, blocked: Iterable[Cell]) -> 'Distances':
        """The distances when exactly `blocked` cannot be entered; itself if that is so now."""
        cells = frozenset(blocked)
        if cells == self.blocked:
            return self
        other = Distances(self.grid, cells, guide=self.guide)
        other._edges = self._edges  # the slowest part, and the same for both
        return other

    @cached_property
    def _edges(self) -> tuple[Indices, Indices, NDArray[np.float64]]:
        """Of each way from a cell to one beside it: the latter, the former, what it costs."""
        grid = self.grid
        entered = [cell for beside in grid.links for cell in beside]
        left = [cell for cell, beside in enumerate(grid.links) for _ in beside]
        costs = np.ones(len(left))
        if self.guide:
            ways = zip(left, entered, strict=True)
            costs[:] = [self.guide.get((grid.cell(a), grid.cell(b)), 1.0) for a, b in ways]
        return np.array(entered, dtype=np.int32), np.array(left, dtype=np.int32), costs

    @cached_property
    def _towards_goals(self) -> csr_array:
        """The edges turned round, because the search starts at the goal."""
        entered, left, costs = self._edges
        shut = np.zeros(len(self.grid.links), dtype=bool)
        shut[[self.grid.index(cell) for cell in self.blocked if self.grid.is_free(cell)]] = True
        is_open = ~shut[entered]
        ways = (entered[is_open], left[is_open])
        return csr_array((costs[is_open], ways), shape=(len(shut), len(shut)))


def one_way(grid: Grid, robots: int, crowd_fee: float = CROWD_FEE) -> Guide:
    """A guide that makes one-way lanes: even rows to the left, odd ones to the right, and so on.

    Robots that meet head-on cost each other more steps than a lane costs in detours; the more so,
    the more robots there are. Each way stays open, it only costs more against the lane.

    Args:
        grid: The floor.
        robots: How many drive there.
        crowd_fee: What a step against the lane costs more, if robots stood on all cells.
    """
    against = 1.0 + crowd_fee * robots / max(1, len(grid.cells))
    return {
        (cell, beside): against
        for cell in grid.cells
        for beside in grid.neighbours(cell)
        if _is_against(cell, beside)
    }


def _is_against(cell: Cell, beside: Cell) -> bool:
    (x, y), (to_x, to_y) = cell, beside
    if y == to_y:
        return (to_x > x) == (y % 2 == 0)
    return (to_y > y) == (x % 2 == 0)
