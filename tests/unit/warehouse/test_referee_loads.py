"""The referee finds each rule that is broken with a load."""

from typing import Any

import pytest
from support.warehouse.referee_cases import AT_STOCK, RULES, TEA, WITH_TEA, judged, robot

from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Job, Limits, Seen
from ros2_kafka_warehouse.messages.message import Cell


def carried(*frames: tuple[Seen, ...], job: Job = TEA) -> list[str]:
    return judged(*frames, jobs=(job,))


def drive(name: str, start: Cell, end: Cell, **more: Any) -> list[tuple[Seen, ...]]:
    """From one cell to another in row 2, a cell a step."""
    sign = 1 if end[0] > start[0] else -1
    return [(robot(name, (x, start[1]), **more),) for x in range(start[0], end[0] + sign, sign)]


def test_picking_and_dropping_where_it_should_be_breaks_nothing() -> None:
    way = drive('a', (0, 2), (5, 2), loads=('1/tea',))
    assert carried((AT_STOCK,), *way, (robot('a', (5, 2)),)) == []


def test_a_load_that_comes_from_elsewhere_than_its_stock_is_found() -> None:
    assert carried((robot('a', (1, 2)),), (robot('a', (1, 2), loads=('1/tea',)),)) == ['source']


def test_a_load_that_is_taken_before_its_release_is_found() -> None:
    assert carried((AT_STOCK,), (WITH_TEA,), job=TEA._replace(released_s=1.5)) == ['release']


def test_a_load_that_is_too_heavy_or_too_large_is_found() -> None:
    assert carried((AT_STOCK,), (WITH_TEA,), job=TEA._replace(weight_kg=31)) == ['weight']
    assert carried((AT_STOCK,), (WITH_TEA,), job=TEA._replace(size='large')) == ['size']


def test_two_loads_on_a_robot_are_found() -> None:
    both = WITH_TEA._replace(loads=('1/tea', '1/rice'))
    rice = TEA._replace(task_id='1/rice')
    assert judged((AT_STOCK,), (WITH_TEA,), (both,), jobs=(TEA, rice)) == ['loads']


def test_a_load_that_is_set_down_elsewhere_is_found() -> None:
    assert carried((AT_STOCK,), (WITH_TEA,), (robot('a', (1, 2)),)) == ['drop']


def test_a_load_that_falls_from_a_robot_that_says_so_lies_there() -> None:
    fallen = robot('a', (0, 2), faulty=True)
    other = robot('b', (1, 2))
    there = [(AT_STOCK, other), (WITH_TEA, other), (fallen, other)]
    assert carried(*there, (fallen, other._replace(loads=('1/tea',)))) == []
    away = robot('b', (2, 2))
    far = [(AT_STOCK, away), (WITH_TEA, away), (fallen, away)]
    assert carried(*far, (fallen, away._replace(loads=('1/tea',)))) == ['source']


def test_a_robot_that_acts_at_once_may_have_left_the_cell() -> None:
    rules = RULES._replace(types={'carrier': Limits(acts_at_once=True)})
    for start, broken in (((0, 2), ()), ((2, 2), ('source',))):
        referee = Referee(rules)
        referee.loads.know(TEA)
        referee.check(Frame(1, 1.0, (robot('a', start),)))
        found = referee.check(Frame(2, 2.0, (robot('a', (1, 2), loads=('1/tea',)),)))
        assert tuple(violation.rule for violation in found) == broken


def test_a_load_on_two_robots_is_found() -> None:
    other = robot('b', (1, 2))
    frames = [(AT_STOCK, other), (WITH_TEA, other), (WITH_TEA, other._replace(loads=('1/tea',)))]
    assert carried(*frames, job=TEA._replace(stranded=True)) == ['doubled']


def test_a_load_that_was_given_up_is_taken_from_beside_it() -> None:
    other = robot('b', (1, 2))
    frames = [(AT_STOCK, other), (WITH_TEA, other), (AT_STOCK, other._replace(loads=('1/tea',)))]
    assert carried(*frames, job=TEA._replace(stranded=True)) == []
    assert carried(*frames) == ['taken']


def test_a_load_that_is_taken_from_a_robot_far_away_is_found() -> None:
    other = robot('b', (2, 2))
    frames = [(AT_STOCK, other), (WITH_TEA, other), (AT_STOCK, other._replace(loads=('1/tea',)))]
    assert carried(*frames, job=TEA._replace(stranded=True)) == ['source']


def test_a_load_of_a_silent_robot_may_be_taken_over_but_once() -> None:
    job = TEA._replace(stranded=True)
    other = robot('b', (1, 2))
    taken = other._replace(loads=('1/tea',))
    frames = [(AT_STOCK, other), (WITH_TEA, other), (other,), (taken,)]
    assert carried(*frames, (AT_STOCK, taken), job=job) == []
    assert carried(*frames, (WITH_TEA, taken), job=job) == []  # unchanged: it has it no more ...
    again = robot('a', (0, 2), loads=('1/tea',), charge=90.0)
    assert carried(*frames, (AT_STOCK, taken), (again, taken), job=job) == ['doubled']


def test_a_load_that_a_robot_has_picked_before_it_was_silent_is_taken_from_it() -> None:
    other, far = robot('b', (1, 2)), robot('b', (2, 2))
    job = TEA._replace(stranded=True)
    took = other._replace(loads=('1/tea',))
    assert carried((AT_STOCK, other), (other,), (took,), job=job) == []
    assert carried((AT_STOCK, other), (other,), (took,)) == ['source']
    assert carried((AT_STOCK, far), (far,), (far._replace(loads=('1/tea',)),), job=job) == [
        'source'
    ]


def test_a_load_may_be_taken_by_a_robot_that_falls_silent() -> None:
    job = TEA._replace(stranded=True)
    taker, later = robot('b', (1, 2)), robot('c', (3, 2))
    lost = [(AT_STOCK, taker), (WITH_TEA, taker, later), (WITH_TEA, later), (AT_STOCK, later)]
    assert carried(*lost, job=job) == []
    assert carried(*lost) == ['drop']
    # Then nobody knows where it is, until somebody has it.
    assert carried(*lost, (AT_STOCK, later._replace(loads=('1/tea',))), job=job) == []
    assert carried(*lost, (AT_STOCK, taker._replace(loads=('1/tea',))), job=job) == []


def test_a_load_that_nobody_could_have_taken_unseen_is_lost() -> None:
    job = TEA._replace(stranded=True)
    far = robot('b', (4, 2))
    assert carried((AT_STOCK, far), (WITH_TEA, far), (WITH_TEA,), (AT_STOCK,), job=job) == ['drop']


def test_a_load_on_the_floor_may_be_taken_by_a_robot_that_is_silent() -> None:
    job = TEA._replace(stranded=True)
    near, last = robot('b', (1, 2)), robot('c', (3, 2))
    fallen = robot('a', (0, 2), faulty=True)
    lies = [(AT_STOCK, near, last), (WITH_TEA, near, last), (fallen, near, last)]
    taken = last._replace(loads=('1/tea',))
    assert carried(*lies, (fallen, last), (fallen, taken), job=job) == []
    assert carried(*lies, (fallen, near, taken), job=job) == ['source']


def test_a_load_may_go_from_a_silent_robot_to_another_by_way_of_a_third() -> None:
    job = TEA._replace(stranded=True)
    between, last = robot('b', (1, 2)), robot('c', (3, 2))
    before = [(AT_STOCK, between, last), (WITH_TEA, between, last)]
    taken = last._replace(loads=('1/tea',))
    assert carried(*before, (last,), (taken,), job=job) == []
    assert carried(*before, (between, last), (between, taken), job=job) == ['source']


def test_a_load_that_is_delivered_twice_is_found() -> None:
    way = drive('a', (0, 2), (5, 2), loads=('1/tea',))
    end = (robot('a', (5, 2)),)
    again = (robot('a', (5, 2), loads=('1/tea',)),)
    assert carried((AT_STOCK,), *way, end, again, end) == ['repeated']


def test_a_delivery_that_nobody_heard_of_counts_when_the_robot_says_so() -> None:
    way = drive('a', (0, 2), (4, 2), loads=('1/tea',))
    referee = Referee(RULES)
    referee.loads.know(TEA)
    frames = [(AT_STOCK,), *way, (), (), (), (robot('a', (5, 2), dropped=frozenset({'1/tea'})),)]
    for step, robots in enumerate(frames):
        assert referee.check(Frame(step, float(step), robots)) == ()
    assert referee.loads.was_delivered('1/tea')


def test_a_task_that_becomes_known_after_its_load_was_taken_is_judged_then() -> None:
    referee = Referee(RULES)
    referee.check(Frame(0, 0.0, (robot('a', (1, 2)),)))
    assert referee.check(Frame(1, 1.0, (robot('a', (1, 2), loads=('1/tea',)),))) == ()
    referee.loads.know(TEA)
    found = referee.check(Frame(2, 2.0, (robot('a', (1, 2), loads=('1/tea',)),)))
    assert [violation.rule for violation in found] == ['source']


def test_a_load_that_nobody_asked_for_is_found() -> None:
    frames = [(AT_STOCK,)] + [(WITH_TEA,)] * 500
    assert judged(*frames) == ['task']


def test_a_load_may_be_taken_from_a_robot_that_falls_silent_in_the_same_step() -> None:
    giver, taker = robot('a', (2, 2), loads=(TEA.task_id,)), robot('b', (3, 2))
    loaded = taker._replace(loads=giver.loads)
    assert judged((giver, taker), (loaded,), (loaded,), jobs=(TEA._replace(stranded=True),)) == []


def taken_at(step: int, cell: Cell, weight_kg: float) -> list[str]:
    """The rules that are broken by a pick after another product was ordered."""
    referee = Referee(RULES)
    referee.loads.know(TEA)
    referee.check(Frame(1, 1.0, (robot('a', cell),)))
    referee.loads.know(TEA._replace(sources=frozenset({(0, 0)}), weight_kg=weight_kg))
    found: list[str] = []
    for now in range(2, step + 1):
        loads = (TEA.task_id,) if now == step else ()
        frame = Frame(now, float(now), (robot('a', cell, loads=loads),))
        found += [violation.rule for violation in referee.check(frame)]
    return found


@pytest.mark.parametrize('cell', [(0, 0), (0, 2)])
def test_what_was_ordered_before_may_be_taken_shortly_after_the_change(cell: Cell) -> None:
    assert taken_at(3, cell, 99.0) == []


def test_what_was_ordered_long_before_may_not_be_taken() -> None:
    assert taken_at(60, (0, 2), 5.0) == ['source']
    assert taken_at(60, (0, 0), 99.0) == ['weight']


def test_a_change_allows_no_other_place() -> None:
    assert taken_at(3, (2, 2), 5.0) == ['source']
