"""Which robot does which task."""

from itertools import permutations

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from ros2_kafka_warehouse.domain.matching import Weights, match, prices, sequences

INF = float('inf')
TABLES = arrays(
    float,
    array_shapes(min_dims=2, max_dims=2, max_side=5),
    elements=st.one_of(st.integers(-9, 30).map(float), st.just(INF)),
)


def _best(costs: npt.NDArray[np.float64]) -> tuple[int, float]:
    """Most pairs, and what they cost at least, by trying all."""
    table = costs if costs.shape[0] <= costs.shape[1] else costs.T
    results = []
    for columns in permutations(range(table.shape[1]), table.shape[0]):
        paid = [table[row, column] for row, column in enumerate(columns)]
        possible = [cost for cost in paid if cost != INF]
        results.append((-len(possible), sum(possible)))
    pairs, cost = min(results)
    return -pairs, cost


@given(TABLES)
def test_as_many_robots_get_a_task_as_can_and_no_other_choice_is_cheaper(
    costs: npt.NDArray[np.float64],
) -> None:
    pairs = match(costs)
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert (len(pairs), sum(costs[pair] for pair in pairs)) == _best(costs)


def test_nothing_is_matched_where_nothing_is_possible() -> None:
    assert match(np.full((2, 3), INF)) == []
    assert match(np.zeros((0, 3))) == []
    assert match(np.array([[np.nan, 1.0]])) == [(0, 1)]


def test_short_work_comes_first_and_age_outweighs_it_in_the_end() -> None:
    approach, carry = np.array([[5.0, 5.0]]), np.array([30.0, 3.0])
    young = prices(approach, carry, np.array([0.0, 0.0]))
    assert match(young) == [(0, 1)]
    old = prices(approach, carry, np.array([2000.0, 0.0]))
    assert match(old) == [(0, 0)], 'it waited too long'
    unhurried = prices(approach, carry, np.array([2000.0, 0.0]), Weights(age=0.0))
    assert match(unhurried) == [(0, 1)]


@given(st.integers(1, 5), st.integers(1, 8), st.integers(1, 4), st.randoms(use_true_random=False))
def test_each_task_is_in_one_sequence_only_and_none_is_left_that_has_room(
    robots: int, tasks: int, ahead: int, chance: 'np.random.Generator'
) -> None:
    def table(*shape: int) -> npt.NDArray[np.float64]:
        numbers = [float(chance.randint(0, 30)) for _ in range(int(np.prod(shape)))]  # type: ignore[attr-defined]
        return np.array(numbers).reshape(shape)

    given_tasks = sequences(
        table(robots, tasks), table(tasks), table(tasks, tasks), table(tasks), ahead
    )
    everything = [task for sequence in given_tasks for task in sequence]
    assert len(everything) == len(set(everything)) == min(tasks, robots * ahead)
    assert all(len(sequence) <= ahead for sequence in given_tasks)


def test_the_next_task_of_a_sequence_begins_where_the_one_before_ends() -> None:
    approach = np.array([[1.0, 9.0, 9.0]])
    after = np.array([[0.0, 7.0, 2.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert sequences(approach, np.ones(3), after, np.zeros(3), 3) == [[0, 2, 1]]


def test_a_robot_gets_no_task_that_it_cannot_do() -> None:
    approach = np.array([[INF, 3.0], [INF, 4.0]])
    assert sequences(approach, np.ones(2), np.ones((2, 2)), np.zeros(2), 2) == [[1], []]
