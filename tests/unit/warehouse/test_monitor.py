"""The Monitor: what it sees, what it makes of it, and what it has done about it."""

import msgspec
import pytest
from support.warehouse.watched import PROFILES, TABLE, Watched

from ros2_kafka_warehouse.domain.order_plan import OrderPlan
from ros2_kafka_warehouse.domain.simulation import Simulation
from ros2_kafka_warehouse.domain.site import read_site
from ros2_kafka_warehouse.messages.monitor import RobotReport
from ros2_kafka_warehouse.messages.robots import PowerSupply

# Nothing, and contact.


def test_nothing_is_said_of_robots_that_do_as_they_are_told(watched: Watched) -> None:
    for column in range(1, 9):
        watched.order((column - 1, 0), (column, 0), update=column)
        watched.change(last_node_id=f'{column},0')
        assert watched.wait() == []
    assert watched.robot() == RobotReport('a', watched.states['a'], watched.now_s)
    assert (watched.report.blocked, watched.report.halted, watched.actions) == ((), '', [])


def test_a_silent_robot_is_closed_off_with_the_cell_that_it_may_drive_to(watched: Watched) -> None:
    watched.order((0, 0), (1, 0))
    watched.wait()
    watched.absent.add('a')

    assert watched.wait() == []
    assert watched.robot().obstacle == ((0, 0), (1, 0))
    assert 'FailureDiagnosed COMM_LOST' in watched.wait(4)
    assert not watched.robot().can_move
    assert (watched.robot().keeps_task, watched.robot().commissioned) == (True, True)


def test_a_robot_that_is_heard_of_again_in_time_goes_on_by_itself(watched: Watched) -> None:
    watched.absent.add('a')
    watched.wait(8)
    watched.absent.clear()

    assert watched.wait() == ['FailureResolved COMM_LOST']
    assert watched.robot().can_move
    assert watched.robot().obstacle == ()


def test_a_robot_that_stays_silent_loses_its_tasks_and_has_to_be_told_to_rejoin(
    watched: Watched,
) -> None:
    watched.absent.add('a')
    said = watched.wait(24)
    lost = watched.robot()
    watched.absent.clear()
    watched.wait(20)
    back = watched.robot()
    watched.operate('rejoinRobot')

    assert 'FailureEscalated ROBOT_LOST' in said
    assert (lost.keeps_task, lost.commissioned, lost.obstacle) == (False, False, ((0, 0),))
    assert (back.commissioned, back.can_move, back.keeps_task) == (False, False, False)
    assert watched.wait() == ['FailureResolved ROBOT_LOST']
    assert watched.robot().commissioned


def test_a_robot_that_is_back_without_its_order_has_crashed(watched: Watched) -> None:
    watched.order((0, 0), (1, 0))
    watched.wait()
    watched.absent.add('a')
    watched.wait(5)
    watched.absent.clear()
    watched.change(order_id='', order_update_id=0)

    assert watched.wait()[:2] == [
        'FailureEscalated SOFTWARE_CRASH',
        'FailureDiagnosed SOFTWARE_CRASH',
    ]
    assert watched.robot().can_move
    assert watched.wait(8)[-1] == 'FailureResolved SOFTWARE_CRASH'


def test_a_robot_that_crashes_again_and_again_is_taken_out_of_service(watched: Watched) -> None:
    for _ in range(3):
        watched.absent.add('a')
        watched.wait(2)
        watched.absent.clear()
        watched.states['a'] = msgspec.structs.replace(watched.states['a'], header_id=0)
        watched.wait(10)
        watched.change()
        watched.wait()

    assert watched.robot().failure == 'OUT_OF_SERVICE'
    assert not watched.robot().commissioned


def test_a_fleet_that_is_silent_as_a_whole_is_no_failure_of_its_robots(watched: Watched) -> None:
    for _ in range(60):
        watched.step += 1
        watched.judge()
    said = [(event.event, event.code, event.robot) for event in watched.events]

    assert ('FailureDetected', 'FLEET_SILENT', '') in said
    assert [robot for _, _, robot in said if robot] == []
    assert watched.wait() == ['FailureResolved FLEET_SILENT']
    assert all(robot.can_move for robot in watched.report.robots)


# Risk.


def test_a_robot_that_has_failed_is_a_risk_that_fades(watched: Watched) -> None:
    watched.change(power_supply=PowerSupply(20.0))
    watched.wait()
    risk = watched.robot().risk
    watched.change(power_supply=PowerSupply(90.0))
    watched.wait()

    assert 0 < risk <= 1
    assert watched.robot().risk == risk
    watched.step += 8000
    watched.change(power_supply=PowerSupply(20.0))
    watched.wait()
    assert watched.robot().risk == risk


# With the real fleet.

STEPS_OF = {code: response.steps for code, response in PROFILES.responses.items()}


@pytest.mark.parametrize(
    'code',
    [
        'PATH_BLOCKED', 'NODE_UNREACHABLE', 'DELAYED', 'STALLED', 'MOTION_FAULT',
        'LOCALIZATION_ERROR', 'LOW_BATTERY', 'BATTERY_CRITICAL', 'BATTERY_DEPLETED',
        'PICK_FAILED', 'LOAD_MISSING', 'OVERWEIGHT', 'MISFIT', 'LOAD_DROPPED', 'COMM_LOST',
        'EMERGENCY_STOP', 'FIELD_VIOLATION', 'OUTSIDE_OF_CORRIDOR', 'OFF_PLAN',
        'ORDER_REJECTED', 'CHARGER_FAULT', 'SOFTWARE_CRASH', 'UNKNOWN',
    ],
)  # fmt: skip
def test_what_fails_in_the_fleet_is_found_answered_and_over_after_repair(code: str) -> None:
    simulation = Simulation(
        read_site(), PROFILES, TABLE, seed=3, orders=OrderPlan(per_hour=900), repair_s=None
    )
    simulation.run(60)
    while not (loaded := [state for state in simulation.state.states if state.loads]):
        simulation.step()
    name = loaded[0].serial_number
    simulation.command('failRobot', name, failure=code)
    if code == 'CHARGER_FAULT':
        simulation.command('failRobot', name, failure='LOW_BATTERY')
    simulation.run(200)
    mine = [event for event in simulation.failures if event.robot == name]
    simulation.command('repairRobot', name)
    simulation.run(6)
    simulation.command('rejoinRobot', name)
    simulation.run(60)
    report = next(one for one in simulation.report.robots if one.serial_number == name)
    others = {event.robot for event in simulation.failures} - {name, ''}

    assert code in {event.code for event in mine if event.event == 'FailureDiagnosed'}
    answers = [
        event.response for event in mine if event.event == 'ResponseOrdered' and event.code == code
    ]
    assert answers[:1] == list(STEPS_OF[code][:1])
    assert set(answers) <= {*STEPS_OF[code], 'wait'}
    assert (report.commissioned, report.can_move, report.keeps_task) == (True, True, True)
    assert simulation.validator.finish() == ()
    # A pallet is in the way of others, too, and the load of a silent robot may be elsewhere.
    assert others == set() or code in ('PATH_BLOCKED', 'CHARGER_FAULT', 'COMM_LOST')


def test_nothing_is_found_where_nothing_fails() -> None:
    simulation = Simulation(
        read_site(), PROFILES, TABLE, seed=5, orders=OrderPlan(per_hour=900), repair_s=None
    )
    simulation.run(1500)

    assert {event.code for event in simulation.failures} <= {'LOW_BATTERY'}


@pytest.mark.parametrize('seed', [1, 2])
def test_nothing_is_found_where_messages_are_late_and_the_monitor_is_killed_again_and_again(
    seed: int,
) -> None:
    simulation = Simulation(
        read_site(),
        PROFILES,
        TABLE,
        seed=seed,
        orders=OrderPlan(per_hour=900),
        repair_s=None,
        lateness=0.3,
    )
    for _ in range(20):
        simulation.run(37)
        simulation.restart('monitor')

    assert {event.code for event in simulation.failures} <= {'LOW_BATTERY'}
