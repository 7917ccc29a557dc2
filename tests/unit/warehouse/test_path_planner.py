"""The Path Planner: goals, orders for one step, and who may pick what."""

from collections.abc import Sequence

from support.warehouse.floors import (
    CHARGER,
    PACKING,
    PROFILES,
    TEA,
    fleet,
    report,
    site,
    state,
    task,
    tasks,
)

from ros2_kafka_warehouse.domain.path_planner import PathPlanner
from ros2_kafka_warehouse.messages.message import Cell, node_cell
from ros2_kafka_warehouse.messages.monitor import Blocked, FleetReport, RobotReport
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    FleetOrders,
    RobotOrder,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments, Task, TaskStatus

START = (0, 0)


def assigned(*pairs: tuple[str, str]) -> Assignments:
    return Assignments(1, tuple(Assignment(robot, (task_id,)) for robot, task_id in pairs))


def plan(
    states: Sequence[RobotState],
    known: Sequence[Task] = (),
    given: Assignments | None = None,
    seen: FleetReport | None = None,
    planner: PathPlanner | None = None,
) -> dict[str, RobotOrder]:
    planner = planner or PathPlanner(site())
    orders = planner.plan(
        fleet(*states), tasks(*known), given or assigned(), seen or report(*states), PROFILES
    )
    return {order.serial_number: order for order in orders.orders}


def picks(orders: FleetOrders) -> list[str]:
    return [
        action.action_id
        for order in orders.orders
        for action in order.nodes[0].actions
        if action.action_type == 'pick'
    ]


def next_cell(order: RobotOrder) -> Cell:
    assert order.nodes[1].released
    return node_cell(order.nodes[1].node_id)


def test_a_robot_is_sent_one_cell_towards_its_load_and_told_the_way_behind_it() -> None:
    order = plan([state('r1', (4, 0))], [task('O/1')], assigned(('r1', 'O/1')))['r1']
    assert order.order_id == 'O/1#0'
    assert [node.node_id for node in order.nodes[:2]] == ['4,0', '3,0']
    assert [node.released for node in order.nodes] == [True, True, False, False, False]
    assert [node.sequence_id for node in order.nodes] == [0, 2, 4, 6, 8]


def test_at_the_load_it_picks() -> None:
    order = plan([state('r1', TEA)], [task('O/1')], assigned(('r1', 'O/1')))['r1']
    (node,) = order.nodes
    (action,) = node.actions
    assert (action.action_type, action.action_id, action.load_id) == ('pick', 'O/1#0:pick', 'O/1')


def test_with_the_load_it_drives_to_the_station_and_drops() -> None:
    carried = task('O/1', status=TaskStatus.CARRIED, carried=True, robot='r1')
    order = plan([state('r1', (7, 0), loads=('O/1',))], [carried])['r1']
    assert next_cell(order) == (8, 0)
    (node,) = plan([state('r1', PACKING, loads=('O/1',))], [carried])['r1'].nodes
    assert node.actions[0].action_id == 'O/1#0:drop'


def test_a_robot_whose_action_runs_is_left_alone_and_nobody_drives_into_it() -> None:
    runs = ActionState('O/1#0:pick', 'pick', ActionStatus.RUNNING)
    picking = state('r1', TEA, action_states=(runs,))
    carried = task('O/2', status=TaskStatus.CARRIED, carried=True, robot='r2', delivery=TEA)
    orders = plan([picking, state('r2', (1, 0), loads=('O/2',))], [task('O/1'), carried])
    assert 'r1' not in orders
    assert 'r2' not in orders or next_cell(orders['r2']) != TEA


def test_an_action_that_was_tried_is_not_ordered_again() -> None:
    failed = ActionState('O/1#0:pick', 'pick', ActionStatus.FAILED)
    robot = state('r1', TEA, action_states=(failed,))
    assert plan([robot], [task('O/1')], assigned(('r1', 'O/1'))) == {}
    again = plan([robot], [task('O/1', attempt=1)], assigned(('r1', 'O/1')))['r1']
    assert again.nodes[0].actions[0].action_id == 'O/1#1:pick'


def test_a_load_that_was_picked_is_not_picked_again_from_old_tasks() -> None:
    planner = PathPlanner(site())
    given = assigned(('r2', 'O/1'))
    robots = [state('r1', (3, 0), loads=('O/1',)), state('r2', TEA)]
    say = fleet(*robots, step=7)
    old, new = tasks(task('O/1'), step=7), tasks(task('O/1', attempt=1), step=8)
    assert picks(planner.plan(say, old, given, report(*robots), PROFILES)) == []
    later = fleet(state('r1', (3, 0)), robots[1], step=8)
    assert picks(planner.plan(later, new, given, report(*robots), PROFILES)) == ['O/1#1:pick']


def test_a_planner_that_began_again_waits_for_tasks_of_its_own_time() -> None:
    planner = PathPlanner(site())
    given, robot = assigned(('r1', 'O/1')), state('r1', TEA)
    say = fleet(robot, step=7)
    assert not planner.plan(say, tasks(task('O/1'), step=6), given, report(robot), PROFILES).orders
    assert planner.plan(say, tasks(task('O/1'), step=7), given, report(robot), PROFILES).orders


def test_the_load_of_a_dead_robot_is_picked_from_beside_it() -> None:
    place = (4, 0)
    dead = state('r2', place, loads=('O/1',))
    seen = RobotReport(
        'r2', dead, 0.0, commissioned=False, can_move=False, obstacle=(place,), keeps_task=False
    )
    stranded = task('O/1', pickup=place, stranded=True, attempt=1, excluded=('r2',))
    planner = PathPlanner(site())
    helper = state('r1', (2, 0))
    given = assigned(('r1', 'O/1'))
    order = plan([helper, dead], [stranded], given, report(helper, seen), planner)['r1']
    assert next_cell(order) == (3, 0)
    helper = state('r1', (3, 0))
    order = plan([helper, dead], [stranded], given, report(helper, seen), planner)['r1']
    (action,) = order.nodes[0].actions
    assert (action.action_type, action.source) == ('pick', place)


def test_blocked_cells_are_driven_around() -> None:
    robot = state('r1', (2, 0))
    seen = report(robot, blocked=(Blocked((1, 0), 'pallet'),))
    order = plan([robot], [task('O/1')], assigned(('r1', 'O/1')), seen)['r1']
    assert next_cell(order) != (1, 0)


def test_nobody_moves_while_the_fleet_is_halted() -> None:
    robot = state('r1', (4, 0))
    halted = report(robot, halted='paused')
    assert plan([robot], [task('O/1')], assigned(('r1', 'O/1')), halted) == {}


def test_a_robot_that_is_silent_holds_its_cells() -> None:
    silent, other = state('r2', (1, 0)), state('r1', (2, 0))
    planner = PathPlanner(site())
    orders = planner.plan(
        fleet(other), tasks(task('O/1')), assigned(('r1', 'O/1')), report(silent, other), PROFILES
    ).orders
    assert all(next_cell(order) != (1, 0) for order in orders)


def test_a_robot_that_nobody_reports_yet_is_not_ordered() -> None:
    assert plan([state('r1', (4, 0))], [task('O/1')], assigned(('r1', 'O/1')), report()) == {}


def test_an_idle_robot_makes_room() -> None:
    idle, busy = state('r2', (1, 0)), state('r1', (0, 0))
    orders = plan([idle, busy], [task('O/1', pickup=(1, 0))], assigned(('r1', 'O/1')))
    assert orders['r2'].order_id == 'yield-r2'
    assert next_cell(orders['r1']) == (1, 0)


def test_two_robots_never_get_the_same_cell_nor_change_places() -> None:
    robots = [state('r1', (3, 0)), state('r2', (5, 0)), state('r3', (4, 0))]
    known = [task('A/1', pickup=(9, 0)), task('B/1', pickup=(0, 0)), task('C/1', pickup=(4, 3))]
    given = assigned(('r1', 'A/1'), ('r2', 'B/1'), ('r3', 'C/1'))
    orders = plan(robots, known, given)
    cells = {robot.serial_number: robot.cell for robot in robots}
    after = cells | {name: next_cell(order) for name, order in orders.items()}
    assert len(set(after.values())) == 3
    assert not any(
        after[one] == cells[other] and after[other] == cells[one]
        for one in cells
        for other in cells
        if one < other
    )


def test_update_numbers_go_up_also_after_a_restart_of_the_planner() -> None:
    planner = PathPlanner(site())
    given, known = assigned(('r1', 'O/1')), [task('O/1')]
    first = plan([state('r1', (4, 0))], known, given, planner=planner)['r1']
    second = plan([state('r1', (4, 0))], known, given, planner=planner)['r1']
    assert (first.order_update_id, second.order_update_id) == (0, 1)
    had = state('r1', (4, 0), order_id='O/1#0', order_update_id=41)
    assert plan([had], known, given)['r1'].order_update_id == 42


def test_a_robot_with_a_charger_goes_there_charges_and_stays() -> None:
    to_charge = Assignments(1, (Assignment('r1', charger=CHARGER),))
    order = plan([state('r1', (0, 1))], given=to_charge)['r1']
    assert next_cell(order) == (0, 2)
    (node,) = plan([state('r1', CHARGER)], given=to_charge)['r1'].nodes
    assert node.actions[0].action_type == 'startCharging'
    assert plan([state('r1', CHARGER, charging=True)], given=to_charge) == {}


def test_the_plans_show_the_whole_way() -> None:
    planner = PathPlanner(site())
    plan([state('r1', (4, 0))], [task('O/1')], assigned(('r1', 'O/1')), planner=planner)
    (way,) = planner.plans(planner_ms=1.5).plans
    assert (way.path[0], way.path[-1], way.purpose, way.task_id) == ((4, 0), TEA, 'pick', 'O/1')


def test_a_goal_that_cannot_be_reached_is_waited_for() -> None:
    robot = state('r1', START)
    walls = tuple(Blocked(cell, 'pallet') for cell in ((1, 0), (0, 1)))
    seen = report(robot, blocked=walls)
    assert plan([robot], [task('O/1')], assigned(('r1', 'O/1')), seen) == {}
