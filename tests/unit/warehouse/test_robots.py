"""The simulated fleet does what it is ordered, shows what is broken, and never meets itself."""

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from warehouse.domain.faults import CODES, CRASH_STEPS, FaultPlan
from warehouse.domain.robots import Fleet
from warehouse.domain.site import Product, RobotPlace, Site
from warehouse.messages import (
    Action,
    ActionStatus,
    Cell,
    ErrorLevel,
    FleetOrders,
    FleetReport,
    FleetState,
    InstantAction,
    InstantActions,
    OperatorCommand,
    OrderNode,
    RobotOrder,
    RobotReport,
    RobotState,
    node_id,
)

QUICK = RobotType('quick', max_load_kg=30, sizes=('small',), pick_steps=0, drop_steps=0)
CARRIER = RobotType('carrier', max_load_kg=30, sizes=('small',))
HAULER = RobotType('hauler', max_load_kg=120, sizes=('small', 'large'), steps_per_cell=2)
PROFILES = ExecutionProfiles({kind.name: kind for kind in (QUICK, CARRIER, HAULER)})
ROWS = (
    '......',
    '.@@.e.',
    '......',
)
STATION, STOCK, CHARGER = (0, 0), (4, 1), (0, 2)
PRODUCTS = {
    'tea': Product('tea', (STOCK,), 1.0),
    'desk': Product('desk', (STOCK,), 20.0, 'large'),
}


def site(*robots: tuple[str, Cell]) -> Site:
    places = {
        f'r{number}': RobotPlace(f'r{number}', kind, home)
        for number, (kind, home) in enumerate(robots)
    }
    return Site('test', ROWS, {'s': STATION}, PRODUCTS, places, (CHARGER,))


class Floor:
    """A fleet with a person who orders it, one step at a time."""

    def __init__(self, *robots: tuple[str, Cell], **more: Any) -> None:
        self.site = site(*robots)
        self.fleet = Fleet(self.site, PROFILES, **more)
        self.update = 0
        self.command_id = 0
        self.state = self.fleet.step()

    def step(self, count: int = 1) -> FleetState:
        for _ in range(count):
            self.state = self.fleet.step()
        return self.state

    def go(self, **targets: Cell) -> FleetState:
        """Orders robots to their next cells, for one step."""
        return self.send(*(self.order(name, to=cell) for name, cell in targets.items()))

    def do(self, name: str, action: Action) -> FleetState:
        return self.send(self.order(name, action=action))

    def send(self, *orders: RobotOrder) -> FleetState:
        self.fleet.order(FleetOrders(self.state.step, orders))
        return self.step()

    def order(
        self,
        name: str,
        *,
        to: Cell | None = None,
        action: Action | None = None,
        order_id: str = 'o',
        update: int | None = None,
        at: Cell | None = None,
    ) -> RobotOrder:
        self.update = self.update + 1 if update is None else update
        start = at or self.fleet._robots[name].cell
        nodes = [OrderNode(node_id(start), 0, actions=(action,) if action else ())]
        if to is not None:
            nodes.append(OrderNode(node_id(to), 2))
        return RobotOrder(name, order_id, self.update, tuple(nodes))

    def command(self, command: str, robot: str = '', **more: Any) -> None:
        self.command_id += 1
        self.fleet.operate(OperatorCommand(f'c{self.command_id}', command, robot, **more))

    def act(self, name: str, action_type: str) -> None:
        self.command_id += 1
        actions = (InstantAction(name, f'i{self.command_id}', action_type),)
        self.fleet.act(InstantActions(actions))

    def robot(self, name: str) -> RobotState:
        return next(state for state in self.state.states if state.serial_number == name)

    def cells(self) -> dict[str, Cell]:
        return {state.serial_number: state.cell for state in self.state.states}

    def errors(self, name: str) -> dict[str, ErrorLevel]:
        return {error.error_type: error.error_level for error in self.robot(name).errors}

    def statuses(self, name: str) -> dict[str, tuple[ActionStatus, str]]:
        return {
            state.action_id: (state.action_status, state.result_description)
            for state in self.robot(name).action_states
        }


def pick(task: str = 'a/1', attempt: int = 0, source: Cell | None = None) -> Action:
    return Action(f'{task}#{attempt}:pick', 'pick', task, 'tea', 1.0, source)


def drop(task: str = 'a/1', attempt: int = 0) -> Action:
    return Action(f'{task}#{attempt}:drop', 'drop', task, 'tea', 1.0)


def loaded(kind: str = 'quick', *others: tuple[str, Cell]) -> Floor:
    """A floor on which r0 has just picked the load of task a/1."""
    floor = Floor((kind, STOCK), *others)
    floor.do('r0', pick())
    floor.step(3)
    assert [load.load_id for load in floor.robot('r0').loads] == ['a/1']
    return floor


# Driving


def test_a_robot_drives_one_cell_for_each_release_and_then_stands() -> None:
    floor = Floor(('carrier', (0, 0)))
    floor.go(r0=(1, 0))
    floor.step(3)
    assert floor.cells() == {'r0': (1, 0)}
    assert not floor.robot('r0').driving


def test_a_heavy_robot_holds_both_cells_while_it_drives() -> None:
    floor = Floor(('hauler', (0, 0)))
    floor.go(r0=(1, 0))
    assert floor.robot('r0').driving
    assert floor.robot('r0').cells == ((0, 0), (1, 0))
    assert floor.robot('r0').position.x == 1.0
    floor.step()
    assert floor.robot('r0').cells == ((1, 0),)


def test_trains_and_circles_move_together() -> None:
    floor = Floor(
        ('carrier', (3, 1)), ('carrier', (4, 1)), ('carrier', (4, 0)), ('carrier', (3, 0))
    )
    floor.go(r0=(4, 1), r1=(4, 0), r2=(3, 0), r3=(3, 1))
    assert floor.cells() == {'r0': (4, 1), 'r1': (4, 0), 'r2': (3, 0), 'r3': (3, 1)}
    floor.go(r3=(3, 2), r2=(3, 1))
    assert floor.cells()['r2'] == (3, 1)


@pytest.mark.parametrize(
    ('kinds', 'targets'),
    [
        (('carrier', 'carrier'), ((1, 0), (0, 0))),  # they change places
        (('hauler', 'carrier'), ((1, 0), (2, 0))),  # a slow one cannot follow
        (('carrier', 'hauler'), ((1, 0), (2, 0))),  # nor can a slow one be followed
        (('carrier', 'carrier'), ((1, 0), None)),  # someone stands there
        (('carrier', 'carrier'), ((1, 1), None)),  # a shelf, and no neighbour
        (('carrier', 'carrier'), ((0, -1), None)),  # off the map
    ],
)
def test_a_robot_stays_where_something_is_in_its_way(
    kinds: tuple[str, str], targets: tuple[Cell, Cell | None]
) -> None:
    floor = Floor((kinds[0], (0, 0)), (kinds[1], (1, 0)))
    orders = {f'r{number}': cell for number, cell in enumerate(targets) if cell}
    floor.go(**orders)
    assert floor.cells()['r0'] == (0, 0)
    assert not floor.robot('r0').driving
    assert not floor.robot('r0').errors


def test_orders_that_were_planned_before_the_floor_changed_are_void() -> None:
    floor = Floor(('carrier', (0, 0)), ('carrier', (5, 0)))
    late = FleetOrders(floor.state.step, (floor.order('r0', to=(1, 0)),))
    floor.go(r1=(4, 0))
    floor.fleet.order(late)
    floor.step()
    assert floor.cells()['r0'] == (0, 0)


def test_orders_are_good_however_late_they_come_if_nothing_has_changed() -> None:
    floor = Floor(('carrier', (0, 0)))
    late = FleetOrders(floor.state.step, (floor.order('r0', to=(1, 0)),))
    floor.step(5)
    floor.fleet.order(late)
    floor.step()
    assert floor.cells()['r0'] == (1, 0)


# Orders (VDA 5050, 6.1.4)


def test_the_same_order_again_does_nothing() -> None:
    floor = Floor(('carrier', (0, 0)), ('carrier', (1, 0)))
    order = floor.order('r0', to=(1, 0))
    floor.send(order)
    floor.go(r1=(2, 0))
    floor.send(order)
    assert floor.cells() == {'r0': (0, 0), 'r1': (2, 0)}
    assert floor.errors('r0') == {}


@pytest.mark.parametrize(
    ('more', 'error'),
    [
        ({'update': 4}, 'OUTDATED_ORDER_UPDATE'),
        ({'update': 5, 'to': (0, 1)}, 'SAME_ORDER_UPDATE_ID'),
        ({'at': (3, 0), 'to': (4, 0)}, 'START_NODE_OUT_OF_RANGE'),
    ],
)
def test_an_order_that_does_not_fit_is_refused_with_a_warning(
    more: dict[str, Any], error: str
) -> None:
    floor = Floor(('carrier', (0, 0)))
    floor.send(floor.order('r0', to=(1, 0), update=5))
    floor.send(floor.order('r0', **more))
    assert floor.errors('r0') == {error: ErrorLevel.WARNING}
    assert floor.cells() == {'r0': (1, 0)}
    floor.send(floor.order('r0', to=(2, 0), update=6))
    assert floor.errors('r0') == {}
    assert floor.cells() == {'r0': (2, 0)}


def test_another_order_is_refused_while_an_action_runs() -> None:
    floor = Floor(('carrier', STOCK))
    floor.do('r0', pick())
    floor.send(floor.order('r0', to=(4, 0), order_id='other'))
    assert 'OTHER_ORDER_ACTIVE' in floor.errors('r0')
    assert floor.robot('r0').order_id == 'o'


# Actions


def test_picking_and_dropping_take_their_steps_and_move_the_load() -> None:
    floor = Floor(('carrier', STOCK))
    floor.do('r0', pick())
    assert floor.statuses('r0') == {'a/1#0:pick': (ActionStatus.RUNNING, '')}
    floor.step()
    assert floor.statuses('r0') == {'a/1#0:pick': (ActionStatus.FINISHED, '')}
    assert [load.load_id for load in floor.robot('r0').loads] == ['a/1']
    for cell in ((4, 0), (3, 0), (2, 0), (1, 0), (0, 0)):
        floor.go(r0=cell)
    floor.do('r0', drop())
    floor.step()
    assert floor.statuses('r0')['a/1#0:drop'] == (ActionStatus.FINISHED, '')
    assert not floor.robot('r0').loads


def test_a_robot_that_needs_no_time_to_pick_drives_on_in_the_same_step() -> None:
    floor = Floor(('quick', STOCK))
    floor.send(floor.order('r0', action=pick(), to=(4, 0)))
    assert floor.cells() == {'r0': (4, 0)}
    assert floor.robot('r0').loads


def test_an_action_is_done_once_however_often_it_is_ordered() -> None:
    floor = loaded()
    floor.do('r0', drop())
    floor.do('r0', pick())
    assert not floor.robot('r0').loads


def test_a_load_leaves_the_stock_once() -> None:
    floor = loaded('quick', ('quick', (5, 1)))
    for cell in ((4, 0), (3, 0), (2, 0), (1, 0), (0, 0)):
        floor.go(r0=cell)
    floor.do('r0', drop())
    floor.go(r1=STOCK)
    floor.do('r1', pick(attempt=1))
    assert floor.statuses('r1')['a/1#1:pick'] == (ActionStatus.FAILED, 'LOAD_MISSING')
    assert floor.errors('r1') == {'loadMissing': ErrorLevel.CRITICAL}
    assert not floor.robot('r1').loads


def test_a_robot_with_an_error_of_its_order_drives_only_by_another_one() -> None:
    floor = Floor(('quick', (5, 1)))
    floor.do('r0', pick())  # nothing is in stock there
    floor.go(r0=(5, 0))
    assert floor.cells() == {'r0': (5, 1)}
    floor.send(floor.order('r0', to=(5, 0), order_id='other'))
    assert floor.cells() == {'r0': (5, 0)}
    assert floor.errors('r0') == {}


def test_the_load_of_a_failed_robot_is_picked_from_beside_it_and_is_then_gone() -> None:
    floor = loaded('quick', ('quick', (4, 0)))
    floor.command('failRobot', 'r0', failure='MOTION_FAULT')
    floor.step()
    floor.do('r1', pick(attempt=1, source=STOCK))
    assert [load.load_id for load in floor.robot('r1').loads] == ['a/1']
    assert not floor.robot('r0').loads


@pytest.mark.parametrize(
    ('product', 'weight_kg', 'result'),
    [('tea', 31.0, 'OVERWEIGHT'), ('desk', 20.0, 'MISFIT'), ('soap', 1.0, 'LOAD_MISSING')],
)
def test_a_load_that_the_robot_cannot_carry_or_find_is_not_picked(
    product: str, weight_kg: float, result: str
) -> None:
    floor = Floor(('quick', STOCK))
    floor.do('r0', Action('a/1#0:pick', 'pick', 'a/1', product, weight_kg))
    assert floor.statuses('r0')['a/1#0:pick'] == (ActionStatus.FAILED, result)


def test_a_robot_charges_at_a_charger_until_it_drives_off() -> None:
    floor = Floor(('quick', CHARGER))
    floor.command('failRobot', 'r0', failure='LOW_BATTERY')
    floor.step()
    low = floor.robot('r0').power_supply.state_of_charge
    floor.do('r0', Action('charge', 'startCharging'))
    floor.step(3)
    assert floor.robot('r0').power_supply.charging
    assert floor.robot('r0').power_supply.state_of_charge > low
    floor.go(r0=(1, 2))
    assert not floor.robot('r0').power_supply.charging


def test_a_paused_robot_stands_until_the_pause_ends() -> None:
    floor = Floor(('carrier', (0, 0)))
    floor.act('r0', 'startPause')
    floor.go(r0=(1, 0))
    assert (floor.cells()['r0'], floor.robot('r0').paused) == ((0, 0), True)
    floor.act('r0', 'stopPause')
    floor.go(r0=(1, 0))
    assert floor.cells()['r0'] == (1, 0)


# Faults


def broken(code: str, floor: Floor | None = None) -> Floor:
    floor = floor or Floor(('quick', STOCK))
    floor.command('failRobot', 'r0', failure=code)
    floor.step()
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
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] == STOCK
    assert floor.robot('r0').position.localized == (code != 'LOCALIZATION_ERROR')
    floor.command('repairRobot', 'r0')
    floor.step()
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] == (4, 0)
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
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] not in {(4, 0), STOCK}
    start = floor.cells()['r0']
    floor.go(r0=STOCK)
    assert start != floor.cells()['r0'] == STOCK


def test_a_pallet_stands_where_the_way_was_and_goes_with_the_repair() -> None:
    floor = broken('PATH_BLOCKED')
    for _ in range(3):
        floor.go(r0=(4, 0))
        assert floor.cells()['r0'] == STOCK
    assert floor.errors('r0') == {}
    floor.command('repairRobot', 'r0')
    floor.step()
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] == (4, 0)


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
    floor.command('repairRobot', 'r0')
    floor.step()
    floor.do('r0', pick(attempt=1))
    assert floor.robot('r0').loads


def test_a_robot_that_was_repaired_has_nothing_left_to_try_again() -> None:
    floor = broken('PICK_FAILED')
    floor.do('r0', pick())
    floor.command('repairRobot', 'r0')
    floor.step()
    assert floor.statuses('r0') == {'a/1#0:pick': (ActionStatus.FAILED, 'cancelled')}
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] == (4, 0)


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
    floor.command('repairRobot', 'r0')
    floor.step()
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
    floor.go(r0=(4, 0))
    assert floor.cells()['r0'] == (4, 0)
    assert floor.errors('r0') == {}


def test_a_dead_charger_charges_nobody_until_the_robot_is_repaired() -> None:
    floor = Floor(('quick', CHARGER), ('quick', (1, 2)))
    broken('CHARGER_FAULT', floor)
    floor.do('r0', Action('charge-1', 'startCharging'))
    assert floor.statuses('r0')['charge-1'] == (ActionStatus.FAILED, 'CHARGER_FAULT')
    floor.go(r0=(0, 1), r1=CHARGER)
    floor.do('r1', Action('charge-2', 'startCharging'))
    assert not floor.robot('r1').power_supply.charging
    floor.command('repairRobot', 'r0')
    floor.step()
    floor.do('r1', Action('charge-2', 'startCharging'))
    assert floor.robot('r1').power_supply.charging


# People


def test_a_blocked_cell_is_driven_on_by_nobody_until_it_is_unblocked() -> None:
    floor = Floor(('quick', (0, 0)))
    floor.command('blockCell', cell=(1, 0))
    floor.step()
    floor.go(r0=(1, 0))
    assert floor.cells()['r0'] == (0, 0)
    floor.command('unblockCell', cell=(1, 0))
    floor.step()
    floor.go(r0=(1, 0))
    assert floor.cells()['r0'] == (1, 0)


def test_a_pallet_for_a_cell_with_a_robot_waits_until_it_has_left() -> None:
    floor = Floor(('quick', (0, 0)))
    floor.command('blockCell', cell=(0, 0))
    floor.go(r0=(1, 0))
    floor.go(r0=(1, 0))
    assert floor.cells()['r0'] == (1, 0)
    floor.step()
    floor.go(r0=(0, 0))
    assert floor.cells()['r0'] == (1, 0)


def test_a_removed_robot_leaves_its_load_and_comes_back_to_its_home() -> None:
    floor = loaded('quick', ('quick', (4, 0)))
    floor.go(r0=(3, 1))
    floor.command('removeRobot', 'r0')
    floor.step()
    assert list(floor.cells()) == ['r1']
    floor.go(r1=STOCK)
    floor.do('r1', pick(attempt=1, source=(3, 1)))
    assert floor.robot('r1').loads
    floor.command('rejoinRobot', 'r0')
    floor.step()
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


# Restart


def report_of(state: FleetState, silent: Sequence[RobotState] = ()) -> FleetReport:
    robots = (*state.states, *silent)
    return FleetReport(
        state.step,
        tuple(RobotReport(robot.serial_number, robot, 0.0) for robot in robots),
        floor=state.floor,
    )


def test_a_fleet_that_was_killed_goes_on_where_it_was() -> None:
    floor = Floor(('carrier', STOCK), ('hauler', (0, 0)), ('quick', (5, 0)), ('quick', (5, 2)))
    floor.do('r0', pick())
    floor.step()
    floor.command('failRobot', 'r0', failure='MOTION_FAULT')
    floor.command('blockCell', cell=(3, 0))
    floor.go(r1=(1, 0))
    floor.command('removeRobot', 'r2')
    floor.step()
    heard = floor.robot('r3')
    floor.command('failRobot', 'r3', failure='COMM_LOST')
    floor.step()
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


# Whatever comes

NAMES = ('r0', 'r1', 'r2', 'r3', 'r4')
CELLS = [
    (column, row)
    for row, text in enumerate(ROWS)
    for column, mark in enumerate(text)
    if mark != '@'
]
MOVES = st.sampled_from(((1, 0), (-1, 0), (0, 1), (0, -1), (0, 0), (2, 0)))
COMMANDS = st.one_of(
    st.builds(
        lambda robot, code: {'command': 'failRobot', 'robot': robot, 'failure': code},
        st.sampled_from(NAMES),
        st.sampled_from(CODES),
    ),
    st.builds(
        lambda command, robot: {'command': command, 'robot': robot},
        st.sampled_from(('repairRobot', 'removeRobot', 'rejoinRobot')),
        st.sampled_from(NAMES),
    ),
    st.builds(
        lambda command, cell: {'command': command, 'cell': cell},
        st.sampled_from(('blockCell', 'unblockCell')),
        st.sampled_from(CELLS),
    ),
)
STEPS = st.lists(
    st.tuples(
        st.lists(MOVES, min_size=5, max_size=5),
        st.sampled_from(('', '', 'pick', 'drop', 'charge', 'restart')),
        st.lists(COMMANDS, max_size=1) | st.just([]),
    ),
    min_size=5,
    max_size=40,
)


@settings(max_examples=150)
@given(STEPS)
def test_whatever_is_ordered_and_breaks_no_robot_meets_another_and_no_load_is_two(
    steps: list[tuple[list[Cell], str, list[dict[str, Any]]]],
) -> None:
    kinds = ('carrier', 'quick', 'hauler', 'quick', 'hauler')
    floor = Floor(*zip(kinds, ((0, 0), (1, 0), (2, 0), STOCK, (5, 2)), strict=True))
    known: dict[str, RobotState] = {}
    for moves, action, commands in steps:
        known |= {state.serial_number: state for state in floor.state.states}
        before = {name: robot.cells for name, robot in floor.fleet._robots.items()}
        for command in commands:
            floor.command(**command)
        if action == 'restart':
            silent = [known[name] for name in known if name not in floor.cells()]
            floor.fleet = Fleet(floor.site, PROFILES)
            floor.fleet.restore(report_of(floor.state, silent))
        orders = [
            order_for(floor, name, move, action) for name, move in zip(NAMES, moves, strict=True)
        ]
        floor.send(*orders)
        check(floor, before)


def order_for(floor: Floor, name: str, move: Cell, action: str) -> RobotOrder:
    column, row = floor.fleet._robots[name].cell
    wanted = {
        'pick': pick('a/1', floor.update, STOCK),
        'drop': drop('a/1', floor.update),
        'charge': Action('charge', 'startCharging'),
    }.get(action)
    return floor.order(name, to=(column + move[0], row + move[1]), action=wanted)


def check(floor: Floor, before: dict[str, tuple[Cell, ...]]) -> None:
    robots = [robot for robot in floor.fleet._robots.values() if not robot.removed]
    held = [cell for robot in robots for cell in robot.cells]
    assert len(set(held)) == len(held), 'two robots hold a cell'
    assert set(held) <= set(CELLS), 'a robot is in a shelf'
    assert not set(held) & set(floor.fleet._floor.pallets), 'a robot is in a pallet'
    after = {robot.serial_number: robot.cell for robot in robots}
    moved = {name for name, cell in after.items() if cell != before[name][0]}
    for name in moved:
        (x, y), (to_x, to_y) = before[name][0], after[name]
        if after[name] != floor.site.robots[name].home:  # where a removed one comes back
            assert abs(x - to_x) + abs(y - to_y) == 1, 'a robot has jumped'
        for other in moved - {name}:
            swapped = after[other] == before[name][0] and after[name] == before[other][0]
            assert not swapped, 'two robots have changed places'
    loads = [robot.load.load_id for robot in robots if robot.load is not None]
    loads += list(floor.fleet._floor.loads)
    assert len(set(loads)) == len(loads), 'a load is in two places'
