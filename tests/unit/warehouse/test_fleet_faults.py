"""What a fault does to a simulated robot, what the robot shows of it, and how it ends."""

import pytest
from support.warehouse.small_fleet import CHARGER, QUICK, STOCK, Floor, loaded, pick

from ros2_kafka_warehouse.domain.faults import CRASH_STEPS
from ros2_kafka_warehouse.messages.robots import Action, ActionStatus, ErrorLevel, FleetOrders


def broken(code: str, floor: Floor | None = None) -> Floor:
    floor = floor or Floor(('quick', STOCK))
    floor.obey('failRobot', 'r0', failure=code)
    return floor


@pytest.mark.parametrize(
    ('code', 'error_type', 'level'),
    [
        ('MOTION_FAULT', 'motionFault', ErrorLevel.FATAL),
        ('NODE_UNREACHABLE', 'NODE_UNREACHABLE', ErrorLevel.CRITICAL),
        ('LOCALIZATION_ERROR', 'LOCALIZATION_ERROR', ErrorLevel.FATAL),
        ('OUTSIDE_OF_CORRIDOR', 'OUTSIDE_OF_CORRIDOR', ErrorLevel.CRITICAL),
        ('BATTERY_DEPLETED', 'batteryEmpty', ErrorLevel.FATAL),
        ('UNKNOWN', 'gearboxSings', ErrorLevel.CRITICAL),
        ('A_CODE_OF_TOMORROW', 'A_CODE_OF_TOMORROW', ErrorLevel.CRITICAL),
    ],
)
def test_a_robot_that_says_what_is_wrong_stands_until_it_is_repaired(
    code: str, error_type: str, level: ErrorLevel
) -> None:
    floor = broken(code)
    assert floor.errors('r0') == {error_type: level}
    assert floor.cells_after(r0=(4, 0))['r0'] == STOCK
    assert floor.robot('r0').position.localized == (code != 'LOCALIZATION_ERROR')
    floor.obey('repairRobot', 'r0')
    assert floor.cells_after(r0=(4, 0))['r0'] == (4, 0)
    assert floor.errors('r0') == {}


def test_a_safety_stop_is_no_error_but_a_safety_state() -> None:
    stopped = broken('EMERGENCY_STOP')
    assert stopped.robot('r0').safety_state.active_emergency_stop == 'MANUAL'
    stopped.go(r0=(4, 0))
    assert stopped.cells()['r0'] == STOCK
    assert broken('FIELD_VIOLATION').robot('r0').safety_state.field_violation


def test_a_stalled_robot_says_nothing_and_takes_long() -> None:
    floor = broken('STALLED')
    floor.go(r0=(4, 0))
    floor.step(4)
    assert floor.robot('r0').driving
    assert floor.errors('r0') == {}
    floor.step()
    assert floor.cells()['r0'] == (4, 0)


def test_a_robot_off_plan_goes_once_where_it_was_not_ordered() -> None:
    floor = broken('OFF_PLAN')
    assert floor.cells_after(r0=(4, 0))['r0'] not in {(4, 0), STOCK}
    start = floor.cells()['r0']
    floor.go(r0=STOCK)
    assert start != floor.cells()['r0'] == STOCK


def test_a_pallet_stands_where_the_way_was_and_goes_with_the_repair() -> None:
    floor = broken('PATH_BLOCKED')
    for _ in range(3):
        assert floor.cells_after(r0=(4, 0))['r0'] == STOCK
    assert floor.errors('r0') == {}
    floor.obey('repairRobot', 'r0')
    assert floor.cells_after(r0=(4, 0))['r0'] == (4, 0)


def test_the_battery_is_as_low_as_the_fault_says() -> None:
    battery = QUICK.battery
    charge = broken('LOW_BATTERY').robot('r0').power_supply.state_of_charge
    assert battery.critical < charge < battery.low
    charge = broken('BATTERY_CRITICAL').robot('r0').power_supply.state_of_charge
    assert 0 < charge < battery.critical


def test_a_battery_runs_empty_by_itself() -> None:
    floor = broken('BATTERY_CRITICAL')
    floor.step(int(QUICK.battery.critical / QUICK.battery.per_idle_step))
    assert 'batteryEmpty' in floor.errors('r0')


def test_a_failed_pick_can_be_tried_again_and_cancelled() -> None:
    floor = broken('PICK_FAILED')
    floor.do('r0', pick())
    failed = (ActionStatus.RETRIABLE, 'PICK_FAILED')
    assert floor.statuses('r0') == {'a/1#0:pick': failed}
    floor.act('r0', 'retry')
    floor.step()
    assert floor.statuses('r0') == {'a/1#0:pick': failed}
    assert floor.errors('r0') == {'pickFailed': ErrorLevel.CRITICAL}
    floor.act('r0', 'cancelOrder')
    floor.step()
    assert floor.statuses('r0') == {'a/1#0:pick': (ActionStatus.FAILED, 'PICK_FAILED')}
    assert floor.errors('r0') == {}
    floor.obey('repairRobot', 'r0')
    floor.do('r0', pick(attempt=1))
    assert floor.robot('r0').loads


def test_a_robot_that_was_repaired_has_nothing_left_to_try_again() -> None:
    floor = broken('PICK_FAILED')
    floor.do('r0', pick())
    floor.obey('repairRobot', 'r0')
    assert floor.statuses('r0') == {'a/1#0:pick': (ActionStatus.FAILED, 'cancelled')}
    assert floor.cells_after(r0=(4, 0))['r0'] == (4, 0)


def test_a_load_that_slides_off_between_two_cells_lies_where_the_robot_was_going() -> None:
    floor = loaded('hauler')
    floor.go(r0=(4, 0))
    assert floor.robot('r0').driving
    broken('LOAD_DROPPED', floor)
    assert floor.fleet._floor.loads['a/1'][0] == (4, 0)


@pytest.mark.parametrize(
    ('code', 'error_type'),
    [('LOAD_MISSING', 'loadMissing'), ('OVERWEIGHT', 'overweight'), ('MISFIT', 'misfit')],
)
def test_the_next_pick_fails_once(code: str, error_type: str) -> None:
    floor = broken(code)
    floor.do('r0', pick())
    assert floor.statuses('r0')['a/1#0:pick'] == (ActionStatus.FAILED, code)
    assert floor.errors('r0') == {error_type: ErrorLevel.CRITICAL}
    floor.send(floor.order('r0', action=pick(attempt=1), order_id='other'))
    assert floor.robot('r0').loads


def test_a_dropped_load_lies_on_the_floor_for_another_robot() -> None:
    floor = broken('LOAD_DROPPED', loaded('quick', ('quick', (4, 0))))
    assert not floor.robot('r0').loads
    assert floor.errors('r0') == {'loadDropped': ErrorLevel.CRITICAL}
    floor.do('r1', pick(attempt=1, source=STOCK))
    assert floor.robot('r1').loads


def test_a_robot_that_lost_contact_ends_its_move_unheard_and_comes_back_by_repair() -> None:
    floor = Floor(('hauler', (0, 0)), ('quick', (5, 0)))
    floor.go(r0=(1, 0))
    floor.command('failRobot', 'r0', failure='COMM_LOST')
    floor.step(3)
    assert list(floor.cells()) == ['r1']
    floor.fleet.order(FleetOrders(floor.state.step, (floor.order('r0', to=(2, 0)),)))
    floor.obey('repairRobot', 'r0')
    assert floor.cells()['r0'] == (1, 0)


def test_a_robot_whose_software_crashed_comes_back_without_its_order() -> None:
    floor = loaded()
    before = floor.robot('r0')
    floor.command('failRobot', 'r0', failure='SOFTWARE_CRASH')
    floor.step(CRASH_STEPS)
    assert floor.cells() == {}
    floor.step(2)
    after = floor.robot('r0')
    assert (after.order_id, after.order_update_id) == ('', 0)
    assert after.header_id < before.header_id + 2
    assert (after.loads, after.cell) == (before.loads, before.cell)


def test_a_robot_refuses_two_orders_and_takes_the_third() -> None:
    floor = broken('ORDER_REJECTED')
    for _ in range(2):
        floor.go(r0=(4, 0))
        assert floor.errors('r0') == {'VALIDATION_FAILURE': ErrorLevel.WARNING}
        assert floor.cells()['r0'] == STOCK
    assert floor.cells_after(r0=(4, 0))['r0'] == (4, 0)
    assert floor.errors('r0') == {}


def test_a_dead_charger_charges_nobody_until_the_robot_is_repaired() -> None:
    floor = Floor(('quick', CHARGER), ('quick', (1, 2)))
    broken('CHARGER_FAULT', floor)
    floor.do('r0', Action('charge-1', 'startCharging'))
    assert floor.statuses('r0')['charge-1'] == (ActionStatus.FAILED, 'CHARGER_FAULT')
    floor.go(r0=(0, 1), r1=CHARGER)
    floor.do('r1', Action('charge-2', 'startCharging'))
    assert not floor.robot('r1').power_supply.charging
    floor.obey('repairRobot', 'r0')
    floor.do('r1', Action('charge-2', 'startCharging'))
    assert floor.robot('r1').power_supply.charging
