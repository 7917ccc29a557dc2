"""What people do to the simulated fleet, and that a fleet that was killed goes on where it was."""

import pytest
from support.warehouse.small_fleet import PROFILES, STOCK, Floor, loaded, pick, report_of, site

from ros2_kafka_warehouse.domain.faults import FaultPlan
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.robots import ErrorLevel, FleetOrders, FleetState


def test_a_blocked_cell_is_driven_on_by_nobody_until_it_is_unblocked() -> None:
    floor = Floor(('quick', (0, 0)))
    floor.obey('blockCell', cell=(1, 0))
    assert floor.cells_after(r0=(1, 0))['r0'] == (0, 0)
    floor.obey('unblockCell', cell=(1, 0))
    assert floor.cells_after(r0=(1, 0))['r0'] == (1, 0)


def test_a_pallet_for_a_cell_with_a_robot_waits_until_it_has_left() -> None:
    floor = Floor(('quick', (0, 0)))
    floor.command('blockCell', cell=(0, 0))
    floor.go(r0=(1, 0))
    assert floor.cells_after(r0=(1, 0))['r0'] == (1, 0)
    floor.step()
    assert floor.cells_after(r0=(0, 0))['r0'] == (1, 0)


def test_a_removed_robot_leaves_its_load_and_comes_back_to_its_home() -> None:
    floor = loaded('quick', ('quick', (4, 0)))
    floor.go(r0=(3, 1))
    floor.obey('removeRobot', 'r0')
    assert list(floor.cells()) == ['r1']
    floor.go(r1=STOCK)
    floor.do('r1', pick(attempt=1, source=(3, 1)))
    assert floor.robot('r1').loads
    floor.obey('rejoinRobot', 'r0')
    assert 'r0' not in floor.cells(), 'its home is not free'
    floor.go(r1=(4, 0))
    floor.step()
    assert floor.cells()['r0'] == STOCK
    assert not floor.robot('r0').loads


def test_a_robot_comes_back_to_its_home_when_all_know_that_another_was_removed_there() -> None:
    floor = Floor(('quick', (0, 0)), ('quick', (4, 0)))
    floor.go(r0=(1, 0))
    floor.command('removeRobot', 'r0')
    floor.step(10)
    for cell in ((3, 0), (2, 0), (1, 0), (0, 0)):
        floor.go(r1=cell)
    floor.command('rejoinRobot', 'r0')
    floor.command('removeRobot', 'r1')
    assert floor.step(3).states == (), 'others still see r1 there'
    floor.step(2)
    assert floor.cells() == {'r0': (0, 0)}


def test_a_command_is_obeyed_once() -> None:
    floor = Floor(('quick', (0, 0)))
    command = OperatorCommand('once', 'failRobot', 'r0', 'MOTION_FAULT')
    floor.fleet.operate(command)
    floor.command('repairRobot', 'r0')
    floor.fleet.operate(command)
    floor.step()
    assert floor.errors('r0') == {}


def test_faults_come_by_schedule_and_by_chance_the_same_for_the_same_seed() -> None:
    plan = FaultPlan(schedule=((3, 'r0', 'MOTION_FAULT'),))
    floor = Floor(('quick', (0, 0)), faults=plan)
    floor.step()
    assert floor.errors('r0') == {}
    floor.step()
    assert 'motionFault' in floor.errors('r0')

    def by_chance(seed: int) -> list[FleetState]:
        floor = Floor(
            ('quick', (0, 0)), ('quick', (3, 0)), seed=seed, faults=FaultPlan(mean_steps=20)
        )
        return [floor.step() for _ in range(100)]

    assert by_chance(1) == by_chance(1)
    assert by_chance(1) != by_chance(2)


def test_a_type_that_the_profiles_do_not_have_is_said() -> None:
    with pytest.raises(ValueError, match='robot r0 is of type tank; the execution profiles have'):
        Fleet(site(('tank', (0, 0))), PROFILES)


def test_a_fleet_that_was_killed_goes_on_where_it_was() -> None:
    floor = Floor(('carrier', STOCK), ('hauler', (0, 0)), ('quick', (5, 0)), ('quick', (5, 2)))
    floor.do('r0', pick())
    floor.step()
    floor.command('failRobot', 'r0', failure='MOTION_FAULT')
    floor.command('blockCell', cell=(3, 0))
    floor.go(r1=(1, 0))
    floor.obey('removeRobot', 'r2')
    heard = floor.robot('r3')
    floor.obey('failRobot', 'r3', failure='COMM_LOST')
    before = floor.state
    robots = {name: vars(robot).copy() for name, robot in floor.fleet._robots.items()}

    floor.fleet = Fleet(floor.site, PROFILES)
    floor.fleet.restore(report_of(before, [heard]))
    after = floor.step()

    assert after.step > before.step
    assert [state.serial_number for state in after.states] == ['r0', 'r1']
    for name, robot in floor.fleet._robots.items():
        for field in ('cell', 'load', 'faults', 'removed', 'deaf', 'stands'):
            assert getattr(robot, field) == robots[name][field], (name, field)
    assert floor.errors('r0') == {'motionFault': ErrorLevel.FATAL}
    assert (3, 0) in floor.fleet._floor.pallets
    floor.command('repairRobot', 'r3')
    assert 'r3' in {state.serial_number for state in floor.step().states}


def test_a_silent_robot_is_after_the_restart_where_it_was_and_not_where_it_was_heard() -> None:
    floor = Floor(('hauler', (0, 0)))
    floor.go(r0=(1, 0))
    heard = floor.robot('r0')
    floor.command('failRobot', 'r0', failure='COMM_LOST')
    floor.step(3)
    floor.fleet = Fleet(floor.site, PROFILES)
    floor.fleet.restore(report_of(floor.state, [heard]))
    assert floor.fleet._robots['r0'].cells == ((1, 0),)
    assert floor.step().states == ()


def test_orders_from_before_the_restart_are_void() -> None:
    floor = Floor(('quick', (0, 0)))
    old = FleetOrders(floor.state.step, (floor.order('r0', to=(1, 0)),))
    floor.fleet = Fleet(floor.site, PROFILES)
    floor.fleet.restore(report_of(floor.state))
    floor.fleet.order(old)
    floor.step()
    assert floor.cells() == {'r0': (0, 0)}


def test_an_action_that_ran_when_the_fleet_was_killed_is_ordered_again_under_its_id() -> None:
    floor = Floor(('carrier', STOCK))
    floor.do('r0', pick())
    floor.fleet = Fleet(floor.site, PROFILES)
    floor.fleet.restore(report_of(floor.state))
    floor.step()
    assert floor.statuses('r0') == {}
    floor.do('r0', pick())
    floor.step()
    assert floor.robot('r0').loads
