"""The whole warehouse in one loop: nothing is lost, nothing doubled, no rule broken."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.warehouse.floors import assert_right
from typer import Typer
from typer.testing import CliRunner

from ros2_kafka_warehouse.domain.execution_profiles import (
    ExecutionProfiles,
    read_execution_profiles,
)
from ros2_kafka_warehouse.domain.faults import FaultPlan
from ros2_kafka_warehouse.domain.order_plan import OrderPlan
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.robot_failure_profile import (
    RobotFailureProfile,
    read_failure_profile,
)
from ros2_kafka_warehouse.domain.simulation import MODULES, Simulation
from ros2_kafka_warehouse.domain.site import Site, make_site, read_site
from ros2_kafka_warehouse.domain.trace_check import validate_trace
from ros2_kafka_warehouse.messages.message import node_id
from ros2_kafka_warehouse.messages.orders import Line, OrderRequest, OrderStatus
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.simulate import simulate
from ros2_kafka_warehouse.validate import validate


@pytest.fixture(scope='module')
def profiles() -> ExecutionProfiles:
    return read_execution_profiles()


@pytest.fixture(scope='module')
def failure_profile() -> RobotFailureProfile:
    return read_failure_profile()


@pytest.fixture(scope='module')
def site() -> Site:
    return make_site(6, seed=1, shelf_rows=2, shelf_columns=2)


SITE = make_site(6, seed=1, shelf_rows=2, shelf_columns=2)
PROFILES = read_execution_profiles()
FAILURE_PROFILE = read_failure_profile()


def simulation(seed: int = 0, orders: int = 10, **more: Any) -> Simulation:
    plan = OrderPlan(per_hour=600, most=orders)
    more = {'plan': plan, **more}
    return Simulation(SITE, PROFILES, FAILURE_PROFILE, seed=seed, orders=more.pop('plan'), **more)


def trace_of(world: Simulation, steps: int) -> list[bytes]:
    lines = []
    for _ in range(steps):
        world.step()
        lines.append(world.line())
    return lines


def test_all_orders_are_delivered_once_and_no_rule_is_broken() -> None:
    result = simulation().run(4000, until_done=True)
    assert_right(result)
    assert set(result.ended.values()) == {OrderStatus.DELIVERED}
    assert (result.sent, result.kpis.delivered) == (10, 10)


def test_the_site_that_comes_along_works_through_its_orders() -> None:
    orders = OrderPlan(per_hour=600, most=15)
    world = Simulation(read_site(), PROFILES, FAILURE_PROFILE, seed=3, orders=orders)
    result = world.run(4000, until_done=True)
    assert_right(result)
    assert set(result.ended.values()) == {OrderStatus.DELIVERED}


def test_the_same_seed_gives_the_same_bytes() -> None:
    faults = FaultPlan(mean_steps=600)
    first = trace_of(simulation(5, faults=faults), 400)
    assert trace_of(simulation(5, faults=faults), 400) == first
    assert trace_of(simulation(6, faults=faults), 400) != first


def test_the_trace_can_be_judged_by_itself() -> None:
    lines = [line.decode() for line in trace_of(simulation(2), 300)]
    assert {'step', 'robots', 'events'} <= set().union(*(json.loads(line) for line in lines))
    # Some types are slower than the unit steps that are judged there: no rule speaks of that.
    assert validate_trace(SITE.rows, None, lines) == ()


def test_a_robot_that_was_carried_off_and_comes_back_is_no_jump_in_the_trace() -> None:
    world = simulation(2)
    lines = trace_of(world, 40)
    robot = world.state.states[0].serial_number
    world.command('removeRobot', robot)
    lines += trace_of(world, 20)
    world.command('rejoinRobot', robot)
    lines += trace_of(world, 20)
    assert len(world.state.states) == len(SITE.robots)
    assert validate_trace(SITE.rows, None, [line.decode() for line in lines]) == ()


@settings(max_examples=8)
@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.5]))
def test_nothing_is_lost_when_messages_come_late(seed: int, lateness: float) -> None:
    assert_right(simulation(seed, orders=6, lateness=lateness).run(5000, until_done=True))


@settings(max_examples=8)
@given(
    st.integers(0, 10_000),
    st.lists(st.tuples(st.integers(1, 500), st.sampled_from(MODULES)), min_size=1, max_size=6),
)
def test_nothing_is_lost_when_modules_are_killed(seed: int, kills: list[tuple[int, str]]) -> None:
    world = simulation(seed, orders=6)

    def kill(world: Simulation) -> None:
        for step, module in kills:
            if step == world.steps:
                world.restart(module)

    assert_right(world.run(5000, until_done=True, each=kill))


@pytest.mark.parametrize('module', MODULES)
def test_nothing_is_lost_when_a_module_is_killed_again_and_again(module: str) -> None:
    world = simulation(1, orders=6)

    def kill(world: Simulation) -> None:
        if world.steps % 25 == 0:
            world.restart(module)

    assert_right(world.run(6000, until_done=True, each=kill))


def test_an_order_that_comes_twice_is_delivered_once() -> None:
    request = OrderRequest('1', 0, 'packing-1', (Line('a', min(SITE.products)),))
    plan = OrderPlan(fixed=((1.0, request), (5.0, request)))
    world = simulation(plan=plan)
    result = world.run(2000, until_done=True)
    world.order(request)
    result = world.run(100)
    assert result.ended == {'1': OrderStatus.DELIVERED}
    assert result.kpis.lines_delivered == 1
    assert result.is_right


def updated(*, steps: int, seed: int, second: Line) -> Simulation:
    """An order, an update of it so many steps later, and all that comes of them."""
    site = make_site(2, seed=0)
    world = Simulation(site, PROFILES, FAILURE_PROFILE, seed=seed)
    station = min(site.stations)
    world.order(OrderRequest('1', 0, station, (Line('a', light_products(site)[0]),)))
    world.run(steps)
    world.order(OrderRequest('1', 1, station, (second,)))
    world.run(1)
    world.run(600, until_done=True)
    return world


def light_products(site: Site) -> list[str]:
    return [
        name
        for name, product in site.products.items()
        if product.size == 'small' and product.weight_kg < 4
    ]


def test_an_update_that_is_refused_leaves_the_end_of_its_order_as_it_is() -> None:
    result = updated(steps=3, seed=1, second=Line('a', 'unicorn')).result()
    assert result.is_right
    assert result.ended == {'1': OrderStatus.DELIVERED}


@pytest.mark.parametrize('steps', range(14, 28))
def test_another_product_is_wanted_near_the_pick_and_no_rule_is_broken(steps: int) -> None:
    wanted = light_products(make_site(2, seed=0))[1]
    world = updated(steps=steps, seed=steps, second=Line('a', wanted))
    result = world.result()
    assert result.violations == ()
    assert result.ended == {'1': OrderStatus.DELIVERED}


def test_a_load_may_be_set_down_in_the_step_in_which_its_task_leaves() -> None:
    world = simulation(10, plan=OrderPlan(), repair_s=None)
    world.order(OrderRequest('1', 0, 'packing-1', (Line('a', min(SITE.products)),)))
    while not any(robot.loads for robot in world.state.states):
        world.step()
    [robot] = [robot.serial_number for robot in world.state.states if robot.loads]
    world.command('failRobot', robot, failure='MOTION_FAULT')
    world.run(3)
    world.order(OrderRequest('1', 1, cancel=True))
    world.run(60)
    world.command('repairRobot', robot)
    world.command('rejoinRobot', robot)
    result = world.run(500)
    assert result.violations == ()
    assert result.ended == {'1': OrderStatus.CANCELLED}


def test_a_broken_rule_stops_the_fleet_and_makes_the_result_wrong() -> None:
    world = simulation()
    world.run(50)
    state = world.fleet.step

    def jump() -> FleetState:
        """One state in which the first robot is somewhere else."""
        fleet = state()
        robot = fleet.states[0]
        far = replace(robot, last_node_id=node_id(fleet.states[1].cell))
        world.fleet.step = state  # type: ignore[method-assign]
        return replace(fleet, states=(far, *fleet.states[1:]))

    world.fleet.step = jump  # type: ignore[method-assign]
    result = world.run(20)
    assert {violation.rule for violation in result.violations} >= {'collision'}
    assert not result.is_right
    assert world.report.halted
    world.run(5)  # those that were between two cells arrive
    cells = [robot.cells for robot in world.state.states]
    world.run(50)
    assert [robot.cells for robot in world.state.states] == cells


def test_random_orders_can_be_carried_by_some_robot() -> None:

    random = Random(1)  # noqa: S311 - no secret
    kinds = PROFILES.robot_types.values()
    for number in range(300):
        order = random_order(SITE, random, str(number), 0.0, PROFILES)
        assert 1 <= len(order.lines) <= 7
        for line in order.lines:
            product = SITE.products[line.product]
            kg = product.weight_kg * line.quantity
            assert any(product.size in kind.sizes and kg <= kind.max_load_kg for kind in kinds)


# The command


APP = Typer()
APP.command()(simulate)


def test_the_command_says_the_figures_and_writes_what_it_is_asked_for(tmp_path: Path) -> None:
    trace, result = tmp_path / 'trace.jsonl', tmp_path / 'result.json'
    options = ['--robots', '6', '--orders', '5', '--orders-per-hour', '900']
    done = CliRunner().invoke(
        APP, [*options, '--steps', '4000', '--trace', str(trace), '--json', str(result)]
    )
    assert done.exit_code == 0, done.output
    assert 'orders lost, doubled' in done.output
    assert 'steps a second' in done.output
    assert json.loads(result.read_text())['right'] is True
    steps = json.loads(result.read_text())['steps']
    assert len(trace.read_text().splitlines()) == steps


def test_a_trace_that_was_written_can_be_judged_by_the_command(tmp_path: Path) -> None:
    judge = Typer()
    judge.command()(validate)
    trace = tmp_path / 'trace.jsonl'
    options = ['--steps', '100', '--orders-per-hour', '900', '--trace', str(trace)]
    assert CliRunner().invoke(APP, options).exit_code == 0
    done = CliRunner().invoke(judge, [str(trace)])
    assert (done.exit_code, '0 violations' in done.output) == (0, True)
    lines = trace.read_text().splitlines()
    trace.write_text('\n'.join([*lines[:40], lines[99].replace('"step":100', '"step":41')]))
    done = CliRunner().invoke(judge, [str(trace)])
    assert (done.exit_code, 'teleport' in done.output) == (1, True)
    trace.write_text('{')
    done = CliRunner().invoke(judge, [str(trace)])
    assert (done.exit_code, 'line 1' in done.output) == (2, True)


def test_a_site_that_cannot_be_read_is_an_error_of_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(APP, ['--site', str(tmp_path / 'none.yaml')])
    assert done.exit_code == 2
    assert 'none.yaml' in done.output
    assert 'Traceback' not in done.output
