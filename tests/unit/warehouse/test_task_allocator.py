"""The Task Allocator: who does what, in which order, and who charges."""

from support.warehouse.floors import (
    CHARGER,
    PACKING,
    PROFILES,
    SAFE,
    report,
    site,
    state,
    task,
    tasks,
)

from ros2_kafka_warehouse.domain.cost_estimator import CostEstimator
from ros2_kafka_warehouse.domain.task_allocator import TaskAllocator
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import Blocked, FleetReport, RobotReport
from ros2_kafka_warehouse.messages.tasks import Assignment, Task, TaskStatus

LEFT, RIGHT = (0, 0), (9, 3)
OTHER_CHARGER = (9, 1)


class Office:
    """Cost Estimator and Task Allocator, as they work together."""

    def __init__(self, *chargers: Cell) -> None:
        place = site()
        if chargers:
            place = type(place)(
                **{name: getattr(place, name) for name in place.__struct_fields__}
                | {'chargers': chargers}
            )
        self._estimator = CostEstimator(place)
        self._allocator = TaskAllocator(place)

    def give(
        self, fleet: FleetReport, *several: Task, now_s: float = 0.0
    ) -> dict[str, Assignment]:
        all_tasks = tasks(*several)
        costs = self._estimator.estimate(all_tasks, fleet, PROFILES, now_s)
        given = self._allocator.allocate(all_tasks, fleet, costs, PROFILES, now_s)
        return {assignment.serial_number: assignment for assignment in given.assignments}


def test_each_task_goes_to_the_robot_that_is_best_for_all_together() -> None:
    near_tea, near_safe = state('r1', LEFT, kind='hauler'), state('r2', RIGHT, kind='hauler')
    given = Office().give(report(near_safe, near_tea), task('A/1', product='safe'), task('B/1'))
    assert given['r1'].tasks[0] == 'B/1'
    assert given['r2'].tasks[0] == 'A/1'


def test_a_task_is_in_one_sequence_only() -> None:
    several = [task(f'O/{number}') for number in range(9)]
    given = Office().give(report(state('r1', LEFT), state('r2', RIGHT)), *several)
    all_given = [name for one in given.values() for name in one.tasks]
    assert len(all_given) == len(set(all_given)) == 6


def test_a_robot_with_a_load_brings_it_first_and_gets_a_task_for_after_it() -> None:
    carried = task('A/1', status=TaskStatus.CARRIED, carried=True, robot='r1')
    given = Office().give(report(state('r1', LEFT, loads=('A/1',))), carried, task('B/1'))
    assert given['r1'].tasks == ('A/1', 'B/1')
    first, second = given['r1'].eta_s
    assert first == 9 + 1
    assert second > first


def test_a_task_that_is_being_picked_stays_with_its_robot() -> None:
    picking = task('A/1', status=TaskStatus.PICKING, robot='r1')
    given = Office().give(report(state('r1', (1, 1)), state('r2', LEFT)), picking, task('B/1'))
    assert given['r1'].tasks == ('A/1',)
    assert given['r2'].tasks == ('B/1',)


def test_a_load_that_cannot_get_to_its_station_has_no_time_of_arrival() -> None:
    carried = task('A/1', status=TaskStatus.BLOCKED, carried=True, robot='r1')
    shut = report(state('r1', LEFT, loads=('A/1',)), blocked=(Blocked(PACKING, 'pallet'),))
    given = Office().give(shut, carried, task('B/1'))
    assert given['r1'].tasks == ('A/1',)
    assert given['r1'].eta_s == ()


def test_a_robot_about_to_be_free_near_by_gets_the_task_rather_than_one_far_away() -> None:
    carried = task('A/1', status=TaskStatus.CARRIED, carried=True, robot='r1')
    beside_packing = (8, 0)
    almost = state('r1', beside_packing, loads=('A/1',), kind='hauler')
    given = Office().give(
        report(almost, state('r2', (0, 3), kind='hauler')), carried, task('B/1', product='safe')
    )
    assert given['r1'].tasks == ('A/1', 'B/1')
    assert 'r2' not in given


def test_a_task_does_not_jump_between_two_robots_that_are_as_good() -> None:
    office = Office()
    first = office.give(report(state('r1', (0, 1)), state('r2', (1, 0))), task('O/1'))
    (name,) = first
    again = office.give(report(state('r2', (1, 0)), state('r1', (0, 1))), task('O/1'))
    assert set(again) == {name}


def test_more_urgent_tasks_come_first() -> None:
    several = [task(f'O/{number}') for number in range(5)]
    urgent = task('U/1', priority=9)
    given = Office().give(report(state('r1', LEFT)), *several, urgent)
    assert given['r1'].tasks[0] == 'U/1'


def test_a_robot_out_of_service_gets_nothing() -> None:
    dead = RobotReport('r1', state('r1', LEFT), 0.0, commissioned=False, can_move=False)
    assert Office().give(report(dead), task('O/1')) == {}


def test_a_robot_that_needs_a_charge_soon_charges_instead_of_taking_a_task() -> None:
    low = RobotReport('r1', state('r1', LEFT, charge=20), 0.0, charge='soon')
    given = Office().give(report(low, state('r2', RIGHT)), task('O/1'))
    assert given['r1'].charger == CHARGER
    assert given['r1'].tasks == ()
    assert given['r2'].tasks == ('O/1',)


def test_a_robot_that_carries_brings_its_load_before_it_charges_unless_it_is_critical() -> None:
    carried = task('A/1', status=TaskStatus.CARRIED, carried=True, robot='r1')
    robot = state('r1', LEFT, loads=('A/1',), charge=20)
    soon = Office().give(report(RobotReport('r1', robot, 0.0, charge='soon')), carried)
    assert soon['r1'].charger is None
    assert soon['r1'].tasks == ('A/1',)
    now = Office().give(report(RobotReport('r1', robot, 0.0, charge='now')), carried)
    assert now['r1'].charger == CHARGER


def test_one_robot_for_each_charger_and_the_others_wait() -> None:
    robots = [
        RobotReport(name, state(name, cell, charge=20), 0.0, charge='soon')
        for name, cell in (('r1', RIGHT), ('r2', (1, 3)))
    ]
    given = Office().give(report(*robots))
    assert {name: one.charger for name, one in given.items()} == {'r2': CHARGER}


def test_a_robot_keeps_the_charger_that_it_was_given() -> None:
    office = Office()
    far = RobotReport('r1', state('r1', RIGHT, charge=20), 0.0, charge='soon')
    assert office.give(report(far))['r1'].charger == CHARGER
    near = RobotReport('r2', state('r2', (1, 3), charge=20), 0.0, charge='soon')
    assert list(office.give(report(near, far))) == ['r1']


def test_a_faulty_charger_is_left_alone() -> None:
    low = RobotReport('r1', state('r1', LEFT, charge=20), 0.0, charge='soon')
    office = Office(CHARGER, OTHER_CHARGER)
    given = office.give(report(low, faulty_chargers=(CHARGER,)))
    assert given['r1'].charger == OTHER_CHARGER


def test_idle_robots_use_the_time_to_charge_but_not_while_tasks_wait() -> None:
    half = state('r1', LEFT, charge=50)
    assert Office().give(report(half))['r1'].charger == CHARGER
    assert Office().give(report(half), task('O/1'))['r1'].charger is None
    full = state('r1', LEFT, charge=95)
    assert Office().give(report(full)) == {}


def test_the_small_site_is_what_these_tests_think() -> None:
    assert PACKING == (9, 0)
    assert SAFE == (8, 2)
