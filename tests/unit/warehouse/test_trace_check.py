"""A trace that keeps the rules is right, and each wrong in one is found."""

import json
from collections.abc import Mapping
from typing import Any

import pytest

from ros2_kafka_warehouse.domain.trace_check import SILENT, TraceError, validate_trace


def trace(*rows: Mapping[str, tuple[int, int, int | None]]) -> list[str]:
    return [
        json.dumps(
            {
                'step': step,
                'robots': [
                    {'id': name, 'x': x, 'y': y, 'load': load}
                    for name, (x, y, load) in robots.items()
                ],
            }
        )
        for step, robots in enumerate(rows)
    ]


MAP = ('...', '...')
TASKS = [(0, (0, 0), (1, 0)), (2, (1, 0), (2, 0))]
SIDE_BY_SIDE = {'a': (0, 0, None), 'b': (1, 0, None)}
GOOD = trace({'r1': (0, 0, 0)}, {'r1': (1, 0, None)}, {'r1': (1, 0, 1)}, {'r1': (2, 0, None)})


def test_a_good_trace_breaks_nothing() -> None:
    assert validate_trace(MAP, TASKS, GOOD) == ()


def test_a_load_given_and_the_next_taken_in_one_row_is_fine() -> None:
    lines = trace({'r1': (0, 0, 0)}, {'r1': (1, 0, 1)}, {'r1': (2, 0, None)})
    assert validate_trace(MAP, [TASKS[0], (0, *TASKS[1][1:])], lines) == ()


@pytest.mark.parametrize(
    ('lines', 'rule'),
    [
        (trace({'r1': (1, 1, 0)}, {'r1': (1, 0, None)}), 'source'),
        (trace({'r1': (0, 0, 0)}, {'r1': (1, 0, 1)}, {'r1': (2, 0, None)}), 'release'),
        (trace({'r1': (0, 0, 0)}, {'r1': (0, 1, None)}), 'drop'),
        (trace({'r1': (0, 0, None)}, {'r1': (2, 0, None)}), 'teleport'),
        (trace({'r1': (0, 0, None)}, {'r1': (0, -1, None)}), 'wall'),
        (trace({'r1': (0, 0, None)}), 'undone'),
        (trace(SIDE_BY_SIDE, {'a': (1, 0, None), 'b': (0, 0, None)}), 'swap'),
        (trace(SIDE_BY_SIDE, {'a': (1, 0, None), 'b': (1, 0, None)}), 'collision'),
        (trace({'r1': (0, 5, None)}), 'wall'),
        (['{"step": 0, "robots": [{"id": "a", "x": 0, "y": 0, "to": [2, 0]}]}'], 'teleport'),
        (trace(SIDE_BY_SIDE, {'a': SIDE_BY_SIDE['a']}), 'vanished'),
    ],
)  # fmt: skip
def test_each_wrong_in_a_trace_is_found(lines: list[str], rule: str) -> None:
    assert rule in {violation.rule for violation in validate_trace(MAP, TASKS, lines)}


def test_a_step_that_is_missing_in_a_trace_is_found() -> None:
    lines = [GOOD[0], *GOOD[2:]]
    assert 'missing' in {violation.rule for violation in validate_trace(MAP, TASKS, lines)}


def test_what_is_wrong_in_the_first_step_is_said_once() -> None:
    lines = trace({'a': (0, 0, None), 'b': (0, 0, None), 'c': (9, 9, None)})
    found = validate_trace(MAP, None, lines)
    assert sorted((one.step, one.rule) for one in found) == [(0, 'collision'), (0, 'wall')]


@pytest.mark.parametrize(
    'more',
    [
        {'removed': ['b']},
        {'failures': [{'robot': 'b', 'event': 'FailureDetected'}]},
    ],
)
def test_a_robot_that_failed_or_was_taken_away_need_not_be_there(more: dict[str, Any]) -> None:
    first, last = trace(SIDE_BY_SIDE, {'a': SIDE_BY_SIDE['a']})
    assert validate_trace(MAP, None, [first, json.dumps(json.loads(last) | more)]) == ()


def test_a_floor_that_tells_of_failures_needs_time_to_see_that_a_robot_is_silent() -> None:
    first, *rest = trace(SIDE_BY_SIDE, *[{'a': SIDE_BY_SIDE['a']}] * (SILENT + 1))
    told = json.dumps(json.loads(first) | {'events': [{'order_id': '1'}]})
    assert validate_trace(MAP, None, [told, *rest[:-1]]) == ()
    assert [one.rule for one in validate_trace(MAP, None, [told, *rest])] == ['vanished']


def test_the_load_of_a_crashed_robot_may_be_taken_over_from_beside_it() -> None:
    lines = trace(
        {'r1': (0, 0, 0), 'r2': (1, 1, None)},
        {'r1': (0, 0, 0), 'r2': (0, 1, None)},
        {'r1': (0, 0, None), 'r2': (0, 1, 0)},
        {'r1': (0, 0, None), 'r2': (1, 1, 0)},
        {'r1': (0, 0, None), 'r2': (1, 0, None)},
    )
    assert validate_trace(MAP, TASKS, lines, crashed={'r1': 1}, unreachable=[1]) == ()
    rules = {violation.rule for violation in validate_trace(MAP, TASKS, lines, unreachable=[1])}
    assert rules == {'taken'}


def test_a_crashed_robot_that_drives_is_found() -> None:
    lines = trace({'r1': (0, 0, None)}, {'r1': (1, 0, None)})
    found = validate_trace(MAP, TASKS, lines, crashed={'r1': 0}, unreachable=[0, 1])
    assert [violation.rule for violation in found] == ['crashed']


def test_moves_alone_are_judged_where_the_tasks_are_not_known() -> None:
    assert validate_trace(MAP, None, trace({'r1': (1, 1, 4)}, {'r1': (1, 0, 7)})) == ()


@pytest.mark.parametrize(
    ('lines', 'says'),
    [
        (['{"step": 1'], 'line 1'),
        (['{"step": "x", "robots": []}'], 'line 1'),
        ([GOOD[1], GOOD[0]], 'step 0 comes after step 1'),
        ([], 'no step'),
        (['', ' '], 'no step'),
    ],
)
def test_a_trace_that_cannot_be_read_is_an_error_that_says_where(
    lines: list[str], says: str
) -> None:
    with pytest.raises(TraceError, match=says):
        validate_trace(MAP, TASKS, lines)
