"""The floor as a grid and the distances on it."""

from collections import deque
from collections.abc import Collection

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_warehouse.domain.grid import Distances, Grid, one_way
from ros2_kafka_warehouse.messages.message import Cell

FLOORS = st.integers(1, 7).flatmap(
    lambda width: st.lists(st.text('..@', min_size=width, max_size=width), min_size=1, max_size=7)
)
ROOM = Grid(('..@.', '....', '@..@'))


def _search(grid: Grid, start: Cell, goal: Cell, blocked: Collection[Cell]) -> float:
    """Steps by a search of its own, from the start forwards."""
    steps = {start: 0.0}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        for beside in grid.neighbours(cell):
            if beside not in steps and beside not in blocked:
                steps[beside] = steps[cell] + 1
                queue.append(beside)
    return steps.get(goal, float('inf'))


def test_a_cell_is_free_unless_it_is_a_wall_or_off_the_map() -> None:
    assert ROOM.is_free((0, 0))
    assert not ROOM.is_free((2, 0))
    assert not any(ROOM.is_free(cell) for cell in ((-1, 0), (4, 0), (0, 3), (0, -1)))
    assert (ROOM.width, ROOM.height) == (4, 3)
    assert ROOM.cells[:3] == ((0, 0), (1, 0), (3, 0))


def test_neighbours_are_the_free_cells_above_left_right_and_below() -> None:
    assert ROOM.neighbours((1, 1)) == ((1, 0), (0, 1), (2, 1), (1, 2))
    assert ROOM.neighbours((3, 0)) == ((3, 1),)


@given(FLOORS, st.data())
def test_distances_are_those_of_a_search_whatever_is_blocked(
    rows: list[str], data: st.DataObject
) -> None:
    grid = Grid(rows)
    if not grid.cells:
        return
    cells = st.sampled_from(grid.cells)
    blocked = data.draw(st.frozensets(cells, max_size=4))
    start, goal = data.draw(cells), data.draw(cells)
    distances = Distances(grid).without(blocked)
    assert distances.steps(start, goal) == _search(grid, start, goal, blocked)
    assert distances.to(goal)[grid.index(start)] == distances.steps(start, goal)
    table = distances.between([goal, start], [start, goal, goal])
    expected = [[distances.steps(a, b) for b in (start, goal, goal)] for a in (goal, start)]
    np.testing.assert_array_equal(table, expected)


def test_a_robot_on_a_blocked_cell_finds_its_way_out_and_nobody_in() -> None:
    distances = Distances(ROOM, frozenset({(1, 1)}))
    assert distances.steps((1, 1), (0, 0)) == 2
    assert distances.steps((0, 0), (1, 1)) == float('inf')


def test_blocking_the_same_cells_again_keeps_all_tables() -> None:
    distances = Distances(ROOM, targets=[(0, 0)])
    assert distances.without([]) is distances
    shut = distances.without([(1, 1)])
    assert shut is not distances
    assert shut.without([(1, 1)]) is shut
    assert shut.without([]).steps((3, 0), (0, 0)) == distances.steps((3, 0), (0, 0))


def test_the_row_of_a_goal_is_the_same_object_each_time() -> None:
    distances = Distances(ROOM)
    assert distances.to((0, 0)) is distances.to((0, 0))


def test_between_no_cells_there_is_an_empty_table() -> None:
    assert Distances(ROOM).between([], [(0, 0)]).shape == (0, 1)


def test_with_a_guide_the_tables_hold_what_the_cheapest_way_costs() -> None:
    guide = {((0, 0), (1, 0)): 5.0}
    distances = Distances(ROOM, guide=guide)
    assert distances.steps((0, 0), (1, 0)) == 3, 'round about'
    assert distances.steps((1, 0), (0, 0)) == 1, 'only one direction is dear'
    assert distances.without([(1, 1)]).steps((0, 0), (1, 0)) == 5, 'the only way that is left'


@given(FLOORS, st.integers(1, 50))
def test_lanes_are_one_way_by_cost_only_and_shut_no_way(rows: list[str], robots: int) -> None:
    grid = Grid(rows)
    guide = one_way(grid, robots)
    assert all(cost > 1 for cost in guide.values())
    pairs = [(cell, beside) for cell in grid.cells for beside in grid.neighbours(cell)]
    assert all(((a, b) in guide) != ((b, a) in guide) for a, b in pairs)
    if grid.cells:
        goal = grid.cells[0]
        free, guided = Distances(grid), Distances(grid, guide=guide)
        np.testing.assert_array_equal(np.isinf(free.array(goal)), np.isinf(guided.array(goal)))


def test_more_robots_make_lanes_stricter() -> None:
    assert max(one_way(ROOM, 8).values()) > max(one_way(ROOM, 2).values())
    with pytest.raises(ValueError, match='max'):
        max(one_way(Grid(['@']), 2).values())
