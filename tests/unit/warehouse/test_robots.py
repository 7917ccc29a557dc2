"""The simulated fleet does what it is ordered, shows what is broken, and never meets itself."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.warehouse.small_fleet import (
    CHARGER,
    PROFILES,
    ROWS,
    STOCK,
    Floor,
    drop,
    loaded,
    pick,
    report_of,
)

from ros2_kafka_warehouse.domain.faults import CODES
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.robots import (
    Action,
    ActionStatus,
    ErrorLevel,
    FleetOrders,
    RobotOrder,
    RobotState,
)

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
    assert floor.cells_after(r0=(4, 1), r1=(4, 0), r2=(3, 0), r3=(3, 1)) == {
        'r0': (4, 1),
        'r1': (4, 0),
        'r2': (3, 0),
        'r3': (3, 1),
    }
    assert floor.cells_after(r3=(3, 2), r2=(3, 1))['r2'] == (3, 1)


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
    assert floor.cells_after(**orders)['r0'] == (0, 0)
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
    assert floor.cells_after(r0=(5, 0)) == {'r0': (5, 1)}
    floor.send(floor.order('r0', to=(5, 0), order_id='other'))
    assert floor.cells() == {'r0': (5, 0)}
    assert floor.errors('r0') == {}


def test_the_load_of_a_failed_robot_is_picked_from_beside_it_and_is_then_gone() -> None:
    floor = loaded('quick', ('quick', (4, 0)))
    floor.obey('failRobot', 'r0', failure='MOTION_FAULT')
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
    floor.obey('failRobot', 'r0', failure='LOW_BATTERY')
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
    assert floor.cells_after(r0=(1, 0))['r0'] == (1, 0)


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
