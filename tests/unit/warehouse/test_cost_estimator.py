"""The Cost Estimator: what a task costs, and who cannot do it."""

from msgspec.structs import replace
from support.warehouse.floors import (
    CHARGER,
    PACKING,
    PROFILES,
    SAFE,
    TEA,
    report,
    site,
    state,
    task,
    tasks,
)

from ros2_kafka_warehouse.domain.cost_estimator import BATTERY_S, CARRY, SPARE_S, CostEstimator
from ros2_kafka_warehouse.domain.execution_profiles import Battery
from ros2_kafka_warehouse.messages.monitor import Blocked, FleetReport, RobotReport
from ros2_kafka_warehouse.messages.tasks import Costs, Tasks, TaskStatus

HOME = (0, 0)


def estimate(all_tasks: Tasks, fleet: FleetReport, now_s: float = 0.0) -> Costs:
    return CostEstimator(site()).estimate(all_tasks, fleet, PROFILES, now_s)


def test_a_cost_is_the_time_to_go_there_pick_and_drop_and_a_part_of_the_way_with_the_load() -> (
    None
):
    costs = estimate(tasks(task('O/1')), report(state('r1', HOME)))
    travel, carry = 2, 9
    wear, spare = BATTERY_S * 0.05 * (travel + carry) / (90 - 10), SPARE_S * (1 - 1 / 30)
    assert costs.costs == ((round(travel + CARRY * carry + 2 + 1 + wear + spare, 1),),)
    assert (costs.robots, costs.tasks, costs.infeasible) == (('r1',), ('O/1',), {})


def test_a_slow_robot_costs_more() -> None:
    costs = estimate(
        tasks(task('O/1')), report(state('r1', HOME), state('r2', HOME, kind='hauler'))
    )
    (fast,), (slow,) = costs.costs
    assert fast is not None
    assert slow is not None
    assert slow - fast >= 2 + CARRY * 9


def test_what_is_too_heavy_for_a_robot_has_no_cost_for_it() -> None:
    costs = estimate(
        tasks(task('O/1', product='safe')),
        report(state('r1', HOME), state('r2', HOME, kind='hauler')),
    )
    assert costs.costs[0] == (None,)
    assert costs.costs[1][0] is not None
    assert costs.infeasible == {}


def test_a_task_that_no_robot_in_service_can_carry_says_so() -> None:
    costs = estimate(tasks(task('O/1', product='safe')), report(state('r1', HOME)))
    assert costs.infeasible == {'O/1': 'no robot in service can carry safe (80 kg)'}


def test_urgency_makes_a_task_cheaper_so_that_none_waits_for_ever() -> None:
    plain, important, late, old = (
        task('O/1', released_s=1000.0),
        task('O/2', released_s=1000.0, priority=5),
        task('O/3', released_s=1000.0, due_s=900.0),
        task('O/4', released_s=0.0),
    )
    costs = estimate(tasks(plain, important, late, old), report(state('r1', HOME)), 1000.0)
    row = costs.costs[0]
    assert all(other is not None and row[0] is not None and other < row[0] for other in row[1:])
    assert [round(row[0] - cost) for cost in row if cost and row[0]] == [
        round(urgency) for urgency in costs.urgency_s
    ]


def test_a_robot_that_often_fails_costs_more() -> None:
    risky = RobotReport('r2', state('r2', HOME), 0.0, risk=0.5)
    (well,), (often,) = estimate(tasks(task('O/1')), report(state('r1', HOME), risky)).costs
    assert well is not None
    assert often is not None
    assert often > well


def test_a_task_costs_more_with_less_charge_and_with_strength_that_it_does_not_need() -> None:
    (full,), (low,) = estimate(
        tasks(task('O/1')), report(state('r1', HOME), state('r2', HOME, charge=11.2))
    ).costs
    assert full is not None
    assert low is not None
    assert full < low
    weak = replace(PROFILES.robot_types['carrier'], name='weak', max_load_kg=2)
    profiles = replace(PROFILES, robot_types={**PROFILES.robot_types, 'weak': weak})
    robots = report(state('r1', HOME, kind='weak'), state('r2', HOME))
    costs = CostEstimator(site()).estimate(tasks(task('O/1')), robots, profiles, 0.0)
    assert costs.costs[0][0] is not None
    assert costs.costs[1][0] is not None
    assert costs.costs[0][0] < costs.costs[1][0]


def test_the_last_line_of_an_order_is_more_urgent_than_the_first_of_another() -> None:
    done = task('O/1', status=TaskStatus.DELIVERED)
    costs = estimate(tasks(done, task('O/2'), task('P/1'), task('P/2')), report(state('r1', HOME)))
    assert costs.tasks == ('O/2', 'P/1', 'P/2')
    assert costs.urgency_s == (5.0, 0.0, 0.0)


def test_a_battery_has_to_last_to_a_charger_after_the_task() -> None:
    # 2 + 9 cells of the task and 12 to the charger take 1.15 %; below 10 % is critical.
    costs = estimate(
        tasks(task('O/1')),
        report(state('r1', HOME, charge=11.2), state('r2', HOME, charge=11.1)),
    )
    assert costs.costs[0][0] is not None
    assert costs.costs[1] == (None,)
    assert costs.infeasible == {}, 'it waits for a charge, it is not impossible'


def test_work_goes_on_while_no_charger_can_be_reached_and_then_says_why_not() -> None:
    shut = (Blocked(CHARGER, 'pallet'),)
    costs = estimate(tasks(task('O/1')), report(state('r1', HOME, charge=90), blocked=shut))
    assert costs.costs[0][0] is not None
    costs = estimate(tasks(task('O/1')), report(state('r1', HOME, charge=10.2), blocked=shut))
    assert costs.costs == ((None,),)
    assert costs.infeasible == {'O/1': 'no battery lasts for it, and no way to a charger is free'}


def test_a_way_that_is_too_long_for_any_battery_says_so() -> None:
    thirsty = replace(PROFILES.robot_types['carrier'], battery=Battery(per_cell=5.0))
    profiles = replace(PROFILES, robot_types={'carrier': thirsty})
    robots = report(state('r1', HOME, charge=80))
    costs = CostEstimator(site()).estimate(tasks(task('O/1')), robots, profiles, 0.0)
    assert costs.infeasible == {'O/1': 'no battery lasts for the way of 23 cells'}


def test_a_load_behind_blocked_cells_is_infeasible_until_the_way_is_free() -> None:
    estimator = CostEstimator(site())
    walls = tuple(Blocked(cell, 'pallet') for cell in ((1, 0), (0, 1), (0, 2)))
    shut = report(state('r1', HOME), blocked=walls)
    costs = estimator.estimate(tasks(task('O/1')), shut, PROFILES, 0.0)
    assert costs.infeasible == {'O/1': f'no robot that fits has a free way to {TEA}'}
    again = estimator.estimate(tasks(task('O/1')), report(state('r1', HOME)), PROFILES, 0.0)
    assert again.infeasible == {}
    assert again.costs[0][0] is not None


def test_the_reasons_name_the_cell() -> None:
    robot = state('r1', HOME)
    under = report(robot, blocked=(Blocked(TEA, 'pallet'),))
    assert estimate(tasks(task('O/1')), under).infeasible == {
        'O/1': f'the stock cell {TEA} is blocked'
    }
    station = report(robot, blocked=(Blocked(PACKING, 'pallet'),))
    assert estimate(tasks(task('O/1')), station).infeasible == {
        'O/1': f'no way is free from {TEA} to the station at {PACKING}'
    }
    assert estimate(tasks(task('O/1')), report()).infeasible == {'O/1': 'no robot is in service'}


def test_a_load_on_its_way_that_is_cut_off_is_infeasible_too() -> None:
    carried = task('O/1', status=TaskStatus.CARRIED, carried=True, robot='r1')
    shut = report(state('r1', HOME, loads=('O/1',)), blocked=(Blocked(PACKING, 'pallet'),))
    assert list(estimate(tasks(carried), shut).infeasible) == ['O/1']


def test_a_stranded_load_is_reached_from_the_cell_beside_the_dead_robot() -> None:
    place = (4, 0)
    dead = RobotReport('r2', state('r2', place), 0.0, commissioned=False, obstacle=(place,))
    stranded = task('O/1', pickup=place, stranded=True, excluded=('r2',))
    costs = estimate(tasks(stranded), report(state('r1', HOME), dead))
    # (3, 0) and round the dead robot by the other aisle.
    assert costs.infeasible == {}
    assert costs.costs[0][0] is not None


def test_tasks_that_are_picked_or_ended_have_no_costs() -> None:
    several = [
        task('O/1', status=TaskStatus.PICKING),
        task('O/2', status=TaskStatus.CARRIED, carried=True, robot='r1'),
        task('O/3', status=TaskStatus.DELIVERED),
        task('O/4', status=TaskStatus.BLOCKED),
    ]
    assert estimate(tasks(*several), report(state('r1', HOME))).tasks == ('O/4',)


def test_robots_that_are_out_of_service_or_cannot_move_are_not_asked() -> None:
    out = RobotReport('r2', state('r2', HOME), 0.0, commissioned=False)
    stands = RobotReport('r3', state('r3', HOME), 0.0, can_move=False)
    strange = state('r4', HOME, kind='unheard-of')
    costs = estimate(tasks(task('O/1')), report(state('r1', HOME), out, stands, strange))
    assert costs.robots == ('r1',)


def test_the_small_site_is_what_these_tests_think() -> None:
    assert site().rows[TEA[1]][TEA[0]] == site().rows[SAFE[1]][SAFE[0]] == 'e'
    assert CHARGER in site().chargers
