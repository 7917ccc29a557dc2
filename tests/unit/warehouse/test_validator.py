"""The validator finds each broken rule, and nothing in a floor where none is broken."""

from typing import Any

import pytest
from support.warehouse.referee_cases import HOMES, ROWS

from ros2_kafka_warehouse.domain.claims import GRACE
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.site import Product, RobotPlace, Site
from ros2_kafka_warehouse.domain.validator import Validator
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.orders import LineStatus, OpenOrders, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    FleetState,
    Load,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Task, Tasks, TaskStatus

SITE = Site(
    'small',
    ROWS,
    stations={'packing': (5, 2)},
    products={'tea': Product('tea', ((0, 2),), 5.0, 'small')},
    robots={name: RobotPlace(name, 'carrier', home) for name, home in HOMES.items()},
)
PROFILES = ExecutionProfiles({'carrier': RobotType('carrier', max_load_kg=30, sizes=('small',))})


def state(name: str, cell: Cell, **more: Any) -> RobotState:
    return RobotState(
        header_id=1,
        serial_number=name,
        robot_type='carrier',
        last_node_id=node_id(cell),
        position=Position(*cell),
        power_supply=PowerSupply(80.0),
        **more,
    )


def task(**more: Any) -> Task:
    return Task('1/tea', '1', '1', 'tea', 5.0, (0, 2), (5, 2), 0.0, **more)


LOADED = (Load('1/tea', 'tea', 5.0),)


def test_the_validator_counts_its_steps_and_keeps_what_it_found() -> None:
    validator = Validator(SITE, PROFILES)
    assert validator.check(FleetState(1, (state('a', (0, 0)),)), 1.0).violations == ()
    bad = validator.check(FleetState(2, (state('a', (3, 0)),)), 2.0)
    good = validator.check(FleetState(3, (state('a', (4, 0)),)), 3.0)
    assert [violation.rule for violation in bad.violations] == ['teleport']
    assert good.violations == bad.violations
    assert good.checked == 3


def test_a_delivery_that_is_only_claimed_is_found() -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    validator.know(Tasks(2, (task(status=TaskStatus.DELIVERED),)))
    for step in range(2, 2 + GRACE):
        report = validator.check(FleetState(step, (state('a', (0, 2)),)), 2.0)
    assert [violation.rule for violation in report.violations] == ['claimed']


def test_a_delivery_that_a_floor_which_starts_again_undoes_was_not_only_claimed() -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(carried=True, robot='a'),)))
    loaded, empty = state('a', (5, 2), loads=LOADED), state('a', (5, 2))
    validator.check(FleetState(1, (loaded,)), 1.0)
    validator.check(FleetState(2, (empty,)), 2.0)
    validator.know(Tasks(2, (task(status=TaskStatus.DELIVERED),)))
    assert validator.check(FleetState(2, (loaded,)), 2.0).violations == ()
    assert validator.check(FleetState(3, (empty,)), 3.0).violations == ()
    assert validator.finish() == ()


def test_a_load_comes_back_with_its_robot_before_anybody_says_that_it_was_given_up() -> None:
    validator = Validator(SITE, PROFILES)
    validator.check(FleetState(1, ()), 1.0)
    back = state('a', (3, 4), loads=LOADED)
    validator.check(FleetState(2, (back,)), 2.0)
    validator.know(Tasks(2, (task(status=TaskStatus.CANCELLED, stranded=True),)))
    assert validator.check(FleetState(3, (back,)), 3.0).violations == ()


def test_a_line_that_is_only_claimed_to_be_delivered_is_found_at_the_end() -> None:
    def orders(status: LineStatus) -> OpenOrders:
        line = OrderLine('1', 'tea', 1, status)
        return OpenOrders((Order('1', 0, 'packing', (line,), 0.0),))

    validator = Validator(SITE, PROFILES)
    validator.expect(orders(LineStatus.OPEN))
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    assert validator.finish() == ()
    validator.expect(orders(LineStatus.DELIVERED))
    assert [violation.rule for violation in validator.finish()] == ['claimed']


@pytest.mark.parametrize('status', [TaskStatus.CARRIED, TaskStatus.DELIVERED, TaskStatus.BLOCKED])
def test_a_validator_that_starts_later_takes_what_is_under_way_as_it_is(
    status: TaskStatus,
) -> None:
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(7, (task(status=status, carried=True, robot='a'),)))
    loads = () if status is TaskStatus.DELIVERED else LOADED
    validator.check(FleetState(8, (state('a', (5, 2), loads=loads),)), 8.0)
    validator.check(FleetState(9, (state('a', (5, 2)),)), 9.0)
    validator.know(Tasks(9, (task(status=TaskStatus.DELIVERED),)))
    assert validator.check(FleetState(10, (state('a', (5, 2)),)), 10.0).violations == ()
    assert validator.finish() == ()


def test_a_robot_that_the_monitor_says_is_off_the_floor_leaves_its_cell_free() -> None:
    a, b = state('a', (0, 0)), state('b', (1, 0))
    validator = Validator(SITE, PROFILES)
    validator.check(FleetState(1, (a, b)), 1.0)
    validator.hear(FleetReport(1, (RobotReport('a', a, 1.0), RobotReport('b', b, 1.0))))
    validator.hear(FleetReport(2, (RobotReport('b', b, 1.0, commissioned=False),)))
    validator.check(FleetState(2, (a,)), 2.0)
    assert validator.check(FleetState(3, (state('a', (1, 0)),)), 3.0).violations == ()


def test_a_load_may_fall_only_when_the_robot_reports_it() -> None:
    fault = (Error('loadDropped', ErrorLevel.CRITICAL),)
    for errors, rules in (((), ['drop']), (fault, [])):
        validator = Validator(SITE, PROFILES)
        validator.know(Tasks(1, (task(),)))
        validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
        validator.check(FleetState(2, (state('a', (0, 2), loads=LOADED),)), 2.0)
        report = validator.check(FleetState(3, (state('a', (0, 2), errors=errors),)), 3.0)
        assert [violation.rule for violation in report.violations] == rules


def test_what_a_robot_says_to_have_dropped_is_read_from_its_actions() -> None:
    dropped = ActionState('1/tea#0:drop', 'drop', ActionStatus.FINISHED)
    validator = Validator(SITE, PROFILES)
    validator.know(Tasks(1, (task(),)))
    validator.check(FleetState(1, (state('a', (0, 2)),)), 1.0)
    for x in range(5):
        validator.check(FleetState(x + 2, (state('a', (x, 2), loads=LOADED),)), 2.0)
    validator.check(FleetState(8), 8.0)
    validator.check(FleetState(9), 9.0)
    validator.check(FleetState(10, (state('a', (5, 2), action_states=(dropped,)),)), 10.0)
    validator.know(Tasks(10, (task(status=TaskStatus.DELIVERED),)))
    assert validator.finish() == ()
