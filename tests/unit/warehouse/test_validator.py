"""The validator finds each broken rule, and nothing in a floor where none is broken."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse.domain.claims import GRACE, QUIET
from warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from warehouse.domain.referee import Referee
from warehouse.domain.rules import Frame, Job, Limits, Rules, Seen
from warehouse.domain.site import Product, RobotPlace, Site
from warehouse.domain.trace_check import TraceError, validate_trace
from warehouse.domain.validator import Validator
from warehouse.messages import (
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    FleetReport,
    FleetState,
    LineStatus,
    Load,
    OpenOrders,
    Order,
    OrderLine,
    Position,
    PowerSupply,
    RobotReport,
    RobotState,
    Task,
    Tasks,
    TaskStatus,
    node_id,
)

Cell = tuple[int, int]

ROWS = (
    '......',
    '.@@.@.',
    '......',
    '.@.@@.',
    '......',
)
TYPES = {
    'carrier': Limits(1, 30, frozenset({'small'})),
    'hauler': Limits(2, 120, frozenset({'small', 'large'})),
}
HOMES = {'a': (0, 0), 'b': (5, 0), 'c': (0, 4), 'h': (5, 4)}
RULES = Rules(ROWS, TYPES, HOMES)
FREE = [(x, y) for y, row in enumerate(ROWS) for x, mark in enumerate(row) if mark != '@']


def robot(name: str, *cells: Cell, **more: Any) -> Seen:
    kind = 'hauler' if name.startswith('h') else 'carrier'
    return Seen(name, cells, type=kind)._replace(**more)


def judged(*frames: tuple[Seen, ...], jobs: tuple[Job, ...] = (), **more: Any) -> list[str]:
    """The rules that are broken by frames, a step each."""
    referee = Referee(RULES)
    for job in jobs:
        referee.loads.know(job)
    found: list[str] = []
    for step, robots in enumerate(frames):
        frame = Frame(step, float(step), robots)._replace(**more)
        found += [violation.rule for violation in referee.check(frame)]
    return found


TEA = Job('1/tea', frozenset({(0, 2)}), (5, 2), released_s=1.0, weight_kg=5, size='small')


# Moves


def test_driving_to_a_neighbour_breaks_nothing() -> None:
    assert judged((robot('a', (0, 0)),), (robot('a', (1, 0)),), (robot('a', (1, 0)),)) == []


def test_a_robot_in_a_wall_is_found() -> None:
    assert judged((robot('a', (1, 0)),), (robot('a', (1, 1)),)) == ['wall']


def test_a_robot_off_the_map_is_found() -> None:
    assert judged((robot('a', (0, 0)),), (robot('a', (-1, 0)),)) == ['wall']


@pytest.mark.parametrize('cell', [(2, 0), (1, 2), (5, 4)])
def test_a_jump_is_found(cell: Cell) -> None:
    assert judged((robot('a', (0, 0)),), (robot('a', cell),)) == ['teleport']


def test_a_robot_that_starts_towards_a_cell_that_is_not_next_to_it_is_found() -> None:
    assert judged((robot('h', (0, 0)),), (robot('h', (0, 0), (0, 2)),)) == ['teleport']


def test_a_robot_that_arrives_elsewhere_than_it_drove_to_is_found() -> None:
    frames = [(robot('h', (0, 2)),), (robot('h', (0, 2), (1, 2)),), (robot('h', (0, 3)),)]
    assert judged(*frames) == ['teleport']


def test_a_robot_that_is_faster_than_its_type_is_found() -> None:
    assert judged((robot('h', (0, 0)),), (robot('h', (1, 0)),)) == ['speed']


def test_a_slow_robot_holds_both_cells_until_it_has_arrived() -> None:
    between = robot('h', (0, 0), (1, 0))
    good = [(robot('h', (0, 0)),), (between,), (robot('h', (1, 0)),)]
    assert judged(*good) == []
    assert judged(good[0], good[1], good[1], good[1], good[2]) == []
    assert judged(good[0], good[1], good[0]) == []


@pytest.mark.parametrize('cell', [(0, 0), (1, 0)])
def test_a_cell_of_a_robot_that_drives_is_entered_by_nobody(cell: Cell) -> None:
    came_from = {(0, 0): (0, 1), (1, 0): (2, 0)}[cell]
    between = robot('h', (0, 0), (1, 0))
    found = judged((robot('h', (0, 0)), robot('a', came_from)), (between, robot('a', cell)))
    assert 'collision' in found


def test_two_robots_on_a_cell_are_found() -> None:
    before = (robot('a', (0, 0)), robot('b', (2, 0)))
    assert judged(before, (robot('a', (1, 0)), robot('b', (1, 0)))) == ['collision']
    assert judged(
        before, (robot('a', (0, 0)), robot('b', (2, 0))), (robot('a', (1, 0)), robot('b', (1, 0)))
    ) == ['collision']


def test_driving_into_a_robot_that_stands_is_found() -> None:
    before = (robot('a', (0, 0)), robot('b', (1, 0)))
    assert judged(before, (robot('a', (1, 0)), robot('b', (1, 0)))) == ['collision']


def test_a_swap_is_found() -> None:
    before = (robot('a', (0, 0)), robot('b', (1, 0)))
    assert judged(before, (robot('a', (1, 0)), robot('b', (0, 0)))) == ['swap']


def test_a_swap_of_which_one_half_was_not_seen_is_found() -> None:
    a, b = robot('a', (0, 0)), robot('b', (1, 0))
    swapped = (robot('a', (1, 0)), robot('b', (0, 0)))
    assert judged((a, b), (a,), swapped) == ['swap']
    assert judged((a, b), (b,), swapped) == ['swap']
    assert judged((a, b), (), swapped) == ['swap']


def test_a_silent_robot_may_have_gone_around_another() -> None:
    a, b = robot('a', (2, 0)), robot('b', (3, 0))
    swapped = (robot('a', (3, 0)), robot('b', (2, 0)))
    assert judged((a, b), (), (), swapped) == []


def test_a_silent_robot_that_was_carried_off_comes_back_beside_where_it_was() -> None:
    a, b = robot('a', (5, 0)), robot('b', (4, 0))
    swapped = (robot('a', (4, 0)), robot('b', HOMES['b']))
    assert judged((a, b), (a,), swapped, removed=frozenset({'b'})) == []


def test_a_train_and_a_circle_may_move_together() -> None:
    train = (robot('a', (0, 0)), robot('b', (1, 0)), robot('c', (2, 0)))
    moved = (robot('a', (1, 0)), robot('b', (2, 0)), robot('c', (3, 0)))
    assert judged(train, moved) == []
    # Around a block of four free cells of another map.
    referee = Referee(Rules(('..', '..')))
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for turn in range(3):
        robots = tuple(
            robot(name, ring[(number + turn) % 4]) for number, name in enumerate('abcd')
        )
        assert referee.check(Frame(turn, 0, robots)) == ()


def test_nobody_follows_into_the_cell_that_a_slow_robot_is_just_leaving() -> None:
    frames = [
        (robot('h', (1, 0)), robot('a', (0, 0))),
        (robot('h', (1, 0), (2, 0)), robot('a', (0, 0))),
        (robot('h', (2, 0)), robot('a', (1, 0))),
    ]
    assert judged(*frames) == ['held']
    assert judged(*frames[:2], (robot('h', (2, 0)), robot('a', (0, 0)))) == []


def test_a_slow_robot_does_not_claim_the_cell_that_another_is_just_leaving() -> None:
    before = (robot('a', (1, 0)), robot('h', (0, 0)))
    assert judged(before, (robot('a', (2, 0)), robot('h', (0, 0), (1, 0)))) == ['held']


def test_driving_with_an_empty_battery_is_found() -> None:
    frames = [(robot('a', (x, 0), charge=0.0),) for x in range(3)]
    assert judged(*frames) == ['battery']
    assert judged((robot('a', (0, 0), charge=0.1),), (robot('a', (1, 0), charge=0.0),)) == []
    assert judged((robot('a', (0, 0), charge=0.1),), (robot('a', (1, 0), charge=-0.1),)) == [
        'battery'
    ]


def test_driving_through_a_pallet_is_found() -> None:
    pallets = frozenset({(1, 0)})
    assert judged((robot('a', (0, 0)),), (robot('a', (1, 0)),), pallets=pallets) == ['pallet']


def test_the_place_of_a_silent_robot_is_entered_by_nobody() -> None:
    before = (robot('a', (0, 0)), robot('b', (1, 0)))
    assert judged(before, (robot('a', (0, 0)),), (robot('a', (1, 0)),)) == ['silent']


def test_the_place_of_a_robot_that_was_carried_off_is_free() -> None:
    before = (robot('a', (0, 0)), robot('b', (1, 0)))
    frames = (before, before[:1], (robot('a', (1, 0)),))
    assert judged(*frames, removed=frozenset({'b'})) == []


def test_a_robot_that_was_carried_off_comes_back_at_its_home_only() -> None:
    before = (robot('b', (1, 0)),)
    gone = frozenset({'b'})
    assert judged(before, (), (robot('b', HOMES['b']),), removed=gone) == []
    assert judged(before, (), (robot('b', (3, 4)),), removed=gone) == ['speed']
    assert judged(before, (), (robot('b', HOMES['b']),)) == ['speed']


def test_a_silent_robot_may_have_driven_on_as_far_as_it_can() -> None:
    before = (robot('b', (1, 0)),)
    assert judged(before, (), (robot('b', (3, 0)),)) == []
    assert judged(before, (), (robot('b', (4, 0)),)) == ['speed']


# Loads


def carried(*frames: tuple[Seen, ...], job: Job = TEA) -> list[str]:
    return judged(*frames, jobs=(job,))


AT_STOCK = robot('a', (0, 2))
WITH_TEA = robot('a', (0, 2), loads=('1/tea',))


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


# Starting again


def test_a_floor_that_started_again_is_taken_as_it_is() -> None:
    referee = Referee(RULES)
    referee.loads.know(TEA)
    for step, seen in ((5, AT_STOCK), (6, WITH_TEA), (7, robot('a', (1, 2), loads=('1/tea',)))):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()
    # The fleet knows only the state of step 5, and does it all once more.
    for step, seen in ((6, AT_STOCK), (7, WITH_TEA), (8, robot('a', (1, 2), loads=('1/tea',)))):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()


def test_a_robot_that_drives_in_the_first_frame_may_arrive_in_the_next() -> None:
    assert judged((robot('h', (0, 0), (1, 0)),), (robot('h', (1, 0)),)) == []


def test_frames_that_were_missed_raise_no_alarm() -> None:
    referee = Referee(RULES)
    assert referee.check(Frame(1, 0.0, (robot('a', (0, 0)), robot('b', (1, 0))))) == ()
    assert referee.check(Frame(9, 0.0, (robot('a', (1, 0)), robot('b', (0, 0))))) == ()
    far = Frame(10, 0.0, (robot('a', (2, 0)), robot('b', (4, 0))))
    assert [violation.rule for violation in referee.check(far)] == ['teleport']


def test_what_was_undone_by_a_floor_that_started_again_later_raises_no_alarm() -> None:
    referee = Referee(RULES)
    referee.loads.know(TEA)
    for step, seen in ((5, AT_STOCK), (6, WITH_TEA)):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()
    for step, seen in ((15, AT_STOCK), (16, WITH_TEA)):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()


# A random good floor, and one thing wrong with it.


@dataclass
class Floor:
    """Plays a floor by the rules, at random: the other side of the validator's bet."""

    random: Random
    jobs: list[Job] = field(default_factory=list)
    robots: dict[str, Seen] = field(default_factory=dict)
    waits: list[Job] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.robots = {name: robot(name, home) for name, home in HOMES.items()}
        for number in range(12):
            source, delivery = self.random.sample(FREE, 2)
            job = Job(f'{number}/x', frozenset({source}), delivery, 0.0, 10.0, 'small')
            self.jobs.append(job)
        self.waits = list(self.jobs)

    def frames(self, steps: int) -> list[Frame]:
        frames = [Frame(0, 0.0, tuple(self.robots.values()))]
        for step in range(1, steps):
            held = {cell: name for name, seen in self.robots.items() for cell in seen.cells}
            for name in self.random.sample(sorted(self.robots), len(self.robots)):
                before = self.robots[name]
                seen = self._act(before) or self._drive(before, held)
                self.robots[name] = seen
                held.update(dict.fromkeys(seen.cells, name))
            frames.append(Frame(step, float(step), tuple(self.robots.values())))
        return frames

    def _act(self, seen: Seen) -> Seen | None:
        if len(seen.cells) > 1:
            return None
        for job in self.jobs:
            if seen.loads == (job.task_id,) and seen.cells == (job.delivery,):
                return seen._replace(loads=())
        for job in self.waits:
            if not seen.loads and seen.cells[0] in job.sources:
                self.waits.remove(job)
                return seen._replace(loads=(job.task_id,))
        return None

    def _drive(self, seen: Seen, held: dict[Cell, str]) -> Seen:
        if len(seen.cells) > 1:
            return seen._replace(cells=seen.cells[1:])
        x, y = seen.cells[0]
        ways = [
            cell
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1))
            if cell in FREE and cell not in held
        ]
        if not ways or self.random.random() < 0.2:
            return seen
        cell = self.random.choice(ways)
        return seen._replace(cells=((x, y), cell) if seen.type == 'hauler' else (cell,))


def dice(seed: int) -> Random:
    return Random(seed)  # noqa: S311 - no secret


def rules_broken(jobs: list[Job], frames: list[Frame]) -> set[str]:
    referee = Referee(RULES)
    for job in jobs:
        referee.loads.know(job)
    return {violation.rule for frame in frames for violation in referee.check(frame)}


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_a_floor_that_keeps_the_rules_is_never_accused(seed: int) -> None:
    floor = Floor(dice(seed))
    frames = floor.frames(120)
    assert rules_broken(floor.jobs, frames) == set()


class Play(NamedTuple):
    """What a mutation may change, and its dice."""

    random: Random
    frames: list[Frame]
    jobs: list[Job]


Mutation = Callable[[Play], set[str] | None]


def change(frames: list[Frame], at: int, name: str, **more: Any) -> None:
    frames[at] = frames[at]._replace(
        robots=tuple(
            seen._replace(**more) if seen.robot == name else seen for seen in frames[at].robots
        )
    )


def any_robot(play: Play) -> tuple[int, Seen]:
    at = play.random.randrange(1, len(play.frames) - 1)
    return at, play.random.choice(play.frames[at].robots)


def put_into_a_wall(play: Play) -> set[str]:
    at, seen = any_robot(play)
    change(play.frames, at, seen.robot, cells=((1, 1),))
    return {'wall'}


def put_onto_another(play: Play) -> set[str]:
    at, seen = any_robot(play)
    other = play.random.choice([one for one in play.frames[at].robots if one.robot != seen.robot])
    change(play.frames, at, seen.robot, cells=other.cells)
    return {'collision'}


def jump(play: Play) -> set[str] | None:
    at, seen = any_robot(play)
    start = play.frames[at - 1].robots
    x, y = next(one.cells[0] for one in start if one.robot == seen.robot)
    far = [cell for cell in FREE if abs(cell[0] - x) + abs(cell[1] - y) > 2]
    change(play.frames, at, seen.robot, cells=(play.random.choice(far),))
    return {'teleport'}


def lose_a_load(play: Play) -> set[str] | None:
    places = [
        (at, seen)
        for at, frame in enumerate(play.frames[1:], 1)
        for seen in frame.robots
        if seen.loads
        and seen.cells
        != (next(job for job in play.jobs if job.task_id == seen.loads[0]).delivery,)
        and any(one.robot == seen.robot and one.loads for one in play.frames[at - 1].robots)
    ]
    if not places:
        return None
    at, seen = play.random.choice(places)
    for later in range(at, len(play.frames)):
        now = next(one for one in play.frames[later].robots if one.robot == seen.robot)
        if now.loads != seen.loads:
            break
        change(play.frames, later, seen.robot, loads=())
    return {'drop'}


def double_a_load(play: Play) -> set[str] | None:
    places = [
        (at, seen, other)
        for at, frame in enumerate(play.frames)
        for seen in frame.robots
        for other in frame.robots
        if seen.loads and not other.loads and at
    ]
    if not places:
        return None
    at, seen, other = play.random.choice(places)
    change(play.frames, at, other.robot, loads=seen.loads)
    return {'doubled', 'taken', 'source'}


def pick_from_afar(play: Play) -> set[str] | None:
    picked = {load for frame in play.frames for seen in frame.robots for load in seen.loads}
    free = [job for job in play.jobs if job.task_id not in picked]
    at, seen = any_robot(play)
    if not free or seen.loads or seen.cells[0] in free[0].sources:
        return None
    change(play.frames, at, seen.robot, loads=(free[0].task_id,))
    return {'source'}


def deliver_again(play: Play) -> set[str] | None:
    for at, frame in enumerate(play.frames[1:], 1):
        for seen in frame.robots:
            before = next(one for one in play.frames[at - 1].robots if one.robot == seen.robot)
            if before.loads and not seen.loads and at + 1 < len(play.frames):
                play.frames.insert(at + 1, frame)
                play.frames[at + 1 :] = [
                    later._replace(step=number)
                    for number, later in enumerate(play.frames[at + 1 :], at + 1)
                ]
                change(play.frames, at + 1, seen.robot, loads=before.loads)
                return {'repeated'}
    return None


def release_later(play: Play) -> set[str] | None:
    for frame in play.frames:
        for seen in frame.robots:
            for number, job in enumerate(play.jobs):
                if seen.loads == (job.task_id,):
                    play.jobs[number] = job._replace(
                        released_s=frame.time_s + play.random.uniform(0.1, 9)
                    )
                    return {'release'}
    return None


def make_it_heavy(play: Play) -> set[str] | None:
    for frame in play.frames:
        for seen in frame.robots:
            for number, job in enumerate(play.jobs):
                if seen.loads == (job.task_id,):
                    play.jobs[number] = job._replace(weight_kg=play.random.uniform(121, 999))
                    return {'weight'}
    return None


def set_a_pallet_in_the_way(play: Play) -> set[str] | None:
    for at in range(1, len(play.frames)):
        for before, seen in zip(play.frames[at - 1].robots, play.frames[at].robots, strict=True):
            new = [cell for cell in seen.cells if cell not in before.cells]
            if new and play.random.random() < 0.2:
                for number in (at - 1, at):
                    play.frames[number] = play.frames[number]._replace(pallets=frozenset(new))
                return {'pallet'}
    return None


def empty_the_battery(play: Play) -> set[str]:
    for name in HOMES:
        for at in range(len(play.frames)):
            change(play.frames, at, name, charge=0.0)
    return {'battery'}


@pytest.mark.parametrize(
    'mutation',
    [
        put_into_a_wall, put_onto_another, jump, lose_a_load, double_a_load, pick_from_afar,
        deliver_again, release_later, make_it_heavy, set_a_pallet_in_the_way, empty_the_battery,
    ],
)  # fmt: skip
@settings(max_examples=30)
@given(st.integers(0, 2**32))
def test_one_thing_wrong_in_a_random_floor_is_found(mutation: Mutation, seed: int) -> None:
    floor = Floor(dice(seed))
    play = Play(dice(seed), floor.frames(120), list(floor.jobs))
    expected = mutation(play)
    if expected is not None:
        assert rules_broken(play.jobs, play.frames) & expected


def test_a_load_may_be_taken_from_a_robot_that_falls_silent_in_the_same_step() -> None:
    giver, taker = robot('a', (2, 2), loads=(TEA.task_id,)), robot('b', (3, 2))
    loaded = taker._replace(loads=giver.loads)
    assert judged((giver, taker), (loaded,), (loaded,), jobs=(TEA._replace(stranded=True),)) == []


# A job that changes


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


# From the messages


SITE = Site(
    'small',
    ROWS,
    stations={'packing': (5, 2)},
    products={'tea': Product('tea', ((0, 2),), 5.0, 'small')},
    robots={name: RobotPlace(name, 'carrier', home) for name, home in HOMES.items()},
)
PROFILES = ExecutionProfiles({'carrier': RobotType('carrier', max_load_kg=30, sizes=('small',))})


def state(name: str, cell: Cell, **more: Any) -> RobotState:
    return RobotState(
        header_id=1,
        serial_number=name,
        robot_type='carrier',
        last_node_id=node_id(cell),
        position=Position(*cell),
        power_supply=PowerSupply(80.0),
        **more,
    )


def task(**more: Any) -> Task:
    return Task('1/tea', '1', '1', 'tea', 5.0, (0, 2), (5, 2), 0.0, **more)


LOADED = (Load('1/tea', 'tea', 5.0),)


def test_the_validator_counts_its_steps_and_keeps_what_it_found() -> None:
    validator = Validator(SITE, PROFILES)
    assert validator.check(FleetState(1, (state('a', (0, 0)),)), 1.0).violations == ()
    bad = validator.check(FleetState(2, (state('a', (3, 0)),)), 2.0)
    good = validator.check(FleetState(3, (state('a', (4, 0)),)), 3.0)
    assert [violation.rule for violation in bad.violations] == ['teleport']
    assert good.violations == bad.violations
    assert good.checked == 3


def test_a_delivery_that_is_only_claimed_is_found() -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    validator.know(Tasks(2, (task(status=TaskStatus.DELIVERED),)))
    for step in range(2, 2 + GRACE):
        report = validator.check(FleetState(step, (state('a', (0, 2)),)), 2.0)
    assert [violation.rule for violation in report.violations] == ['claimed']


def test_a_delivery_that_a_floor_which_starts_again_undoes_was_not_only_claimed() -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(carried=True, robot='a'),)))
    loaded, empty = state('a', (5, 2), loads=LOADED), state('a', (5, 2))
    validator.check(FleetState(1, (loaded,)), 1.0)
    validator.check(FleetState(2, (empty,)), 2.0)
    validator.know(Tasks(2, (task(status=TaskStatus.DELIVERED),)))
    assert validator.check(FleetState(2, (loaded,)), 2.0).violations == ()
    assert validator.check(FleetState(3, (empty,)), 3.0).violations == ()
    assert validator.finish() == ()


def test_a_load_comes_back_with_its_robot_before_anybody_says_that_it_was_given_up() -> None:
    validator = Validator(SITE, PROFILES)
    validator.check(FleetState(1, ()), 1.0)
    back = state('a', (3, 4), loads=LOADED)
    validator.check(FleetState(2, (back,)), 2.0)
    validator.know(Tasks(2, (task(status=TaskStatus.CANCELLED, stranded=True),)))
    assert validator.check(FleetState(3, (back,)), 3.0).violations == ()


def test_a_line_that_is_only_claimed_to_be_delivered_is_found_at_the_end() -> None:
    def orders(status: LineStatus) -> OpenOrders:
        line = OrderLine('1', 'tea', 1, status)
        return OpenOrders((Order('1', 0, 'packing', (line,), 0.0),))

    validator = Validator(SITE, PROFILES)
    validator.expect(orders(LineStatus.OPEN))
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    assert validator.finish() == ()
    validator.expect(orders(LineStatus.DELIVERED))
    assert [violation.rule for violation in validator.finish()] == ['claimed']


@pytest.mark.parametrize('status', [TaskStatus.CARRIED, TaskStatus.DELIVERED, TaskStatus.BLOCKED])
def test_a_validator_that_starts_later_takes_what_is_under_way_as_it_is(
    status: TaskStatus,
) -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(7, (task(status=status, carried=True, robot='a'),)))
    loads = () if status is TaskStatus.DELIVERED else LOADED
    validator.check(FleetState(8, (state('a', (5, 2), loads=loads),)), 8.0)
    validator.check(FleetState(9, (state('a', (5, 2)),)), 9.0)
    validator.know(Tasks(9, (task(status=TaskStatus.DELIVERED),)))
    assert validator.check(FleetState(10, (state('a', (5, 2)),)), 10.0).violations == ()
    assert validator.finish() == ()


def test_a_robot_that_the_monitor_says_is_off_the_floor_leaves_its_cell_free() -> None:
    a, b = state('a', (0, 0)), state('b', (1, 0))
    validator = Validator(SITE, PROFILES)
    validator.check(FleetState(1, (a, b)), 1.0)
    validator.hear(FleetReport(1, (RobotReport('a', a, 1.0), RobotReport('b', b, 1.0))))
    validator.hear(FleetReport(2, (RobotReport('b', b, 1.0, commissioned=False),)))
    validator.check(FleetState(2, (a,)), 2.0)
    assert validator.check(FleetState(3, (state('a', (1, 0)),)), 3.0).violations == ()


def test_a_load_may_fall_only_when_the_robot_reports_it() -> None:
    fault = (Error('loadDropped', ErrorLevel.CRITICAL),)
    for errors, rules in (((), ['drop']), (fault, [])):
        validator = Validator(SITE, PROFILES)
        validator.know(Tasks(1, (task(),)))
        validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
        validator.check(FleetState(2, (state('a', (0, 2), loads=LOADED),)), 2.0)
        report = validator.check(FleetState(3, (state('a', (0, 2), errors=errors),)), 3.0)
        assert [violation.rule for violation in report.violations] == rules


def test_what_a_robot_says_to_have_dropped_is_read_from_its_actions() -> None:
    dropped = ActionState('1/tea#0:drop', 'drop', ActionStatus.FINISHED)
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    for x in range(5):
        validator.check(FleetState(x + 2, (state('a', (x, 2), loads=LOADED),)), 2.0)
    validator.check(FleetState(8), 8.0)
    validator.check(FleetState(9), 9.0)
    validator.check(FleetState(10, (state('a', (5, 2), action_states=(dropped,)),)), 10.0)
    validator.know(Tasks(10, (task(status=TaskStatus.DELIVERED),)))
    assert validator.finish() == ()


# Traces


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
    first, *rest = trace(SIDE_BY_SIDE, *[{'a': SIDE_BY_SIDE['a']}] * (QUIET + 1))
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
