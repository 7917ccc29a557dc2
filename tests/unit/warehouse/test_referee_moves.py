"""The referee finds each rule that a robot breaks on its way."""

import pytest
from support.warehouse.referee_cases import HOMES, judged, robot

from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Rules
from ros2_kafka_warehouse.messages.message import Cell


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
