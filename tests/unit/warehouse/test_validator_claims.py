"""What is said of tasks, lines and loads, against what was ordered and what was seen."""

from typing import Any

import pytest
from msgspec.structs import replace
from support.warehouse.floors import PACKING, PROFILES, TEA, site, state, task

from ros2_kafka_warehouse.domain.claims import FORMER, GRACE, QUIET
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.domain.validator import Validator
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import LineStatus, OpenOrders, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    FleetOrders,
    FleetState,
    Load,
    OrderNode,
    RobotOrder,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Task, Tasks, TaskStatus

RETURNS: Cell = (9, 3)
SITE = replace(
    site(a=('carrier', (0, 0)), b=('carrier', (5, 0))),
    stations={'packing': PACKING, 'returns': RETURNS},
)
EMPTY = state('a', TEA)
LOADED = replace(EMPTY, loads=(Load('1/tea', 'tea', 1.0),))
TASK = task('1/tea', released_s=0.5)
CARRIED = replace(TASK, status=TaskStatus.CARRIED, carried=True, robot='a')
LONG = FORMER + 2 * QUIET


def order(update: int = 0, **more: Any) -> Order:
    line = {name: more.pop(name) for name in ('product', 'quantity', 'status') if name in more}
    lines = (OrderLine('tea', line.pop('product', 'tea'), **line),)
    return Order('1', update, **{'station': 'packing', 'lines': lines, 'released_s': 0.5, **more})


class Story:
    """What a validator hears, a step after the other."""

    def __init__(self, wanted: Order | None, *told: Task) -> None:
        self.validator = Validator(SITE, PROFILES)
        self.step = 0
        self.say(*told)
        self.want(wanted)

    def say(self, *told: Task) -> None:
        self.tasks = told
        self.validator.know(Tasks(self.step, told))

    def want(self, wanted: Order | None) -> None:
        self.validator.expect(OpenOrders(() if wanted is None else (wanted,)))

    def see(self, *robots: RobotState, steps: int = 1, said: Task | None = None) -> None:
        """Robots, for some steps, once a task was said where one is given."""
        if said is not None:
            self.say(said)
        for _ in range(steps):
            self.step += 1
            self.validator.check(FleetState(self.step, robots), float(self.step))
            self.validator.know(Tasks(self.step, self.tasks))

    def carry(self, *cells: Cell) -> None:
        for cell in cells:
            self.see(replace(LOADED, last_node_id=node_id(cell)))

    @property
    def rules(self) -> list[str]:
        """The rules that were broken so far."""
        report = self.validator.check(FleetState(self.step + 1), float(self.step))
        return [violation.rule for violation in report.violations]


def begun(steps: int = 1) -> Story:
    """What was ordered is a task, and a robot has come to it."""
    story = Story(order(), TASK)
    story.see(EMPTY, steps=steps)
    return story


# Tasks and orders


def test_a_task_as_it_was_ordered_breaks_nothing() -> None:
    story = begun(LONG)
    story.see(LOADED)
    story.see(LOADED, steps=LONG, said=CARRIED)
    assert story.rules == []


@pytest.mark.parametrize(
    ('wrong', 'rule'),
    [
        ({'delivery': RETURNS}, 'station'),
        ({'product': 'safe'}, 'product'),
        ({'quantity': 2}, 'product'),
        ({'line_id': 'rice'}, 'product'),
        ({'released_s': 0.0}, 'release'),
    ],
)
def test_a_task_that_is_not_what_was_ordered_is_found_once(
    wrong: dict[str, Any], rule: str
) -> None:
    story = Story(order(), replace(TASK, **wrong))
    story.see(EMPTY, steps=QUIET + 2)
    story.see(EMPTY, steps=QUIET + 2, said=replace(TASK, **wrong, priority=5))
    assert story.rules == [rule]


def test_a_wrong_task_that_is_delivered_and_gone_at_once_is_found() -> None:
    story = begun(2)
    story.see(EMPTY, steps=2, said=replace(TASK, delivery=RETURNS, status=TaskStatus.ASSIGNED))
    story.want(None)
    story.say()
    story.see(EMPTY, steps=QUIET + 2)
    assert story.rules == ['station']


def test_a_load_that_is_left_of_an_ended_order_need_not_be_as_it_was_ordered() -> None:
    story = begun(2)
    story.want(None)
    story.see(EMPTY, steps=2)
    story.say(replace(TASK, quantity=2, released_s=0.0))  # by an organizer that starts anew
    story.see(EMPTY, steps=QUIET + 2)
    assert story.rules == []


def test_what_the_desk_writes_into_a_line_was_not_ordered() -> None:
    story = begun()
    story.say(replace(CARRIED, quantity=2, weight_kg=2.0))
    story.want(order(quantity=2))
    story.see(replace(LOADED, loads=(Load('1/tea', 'tea', 2.0),)), steps=QUIET + 2)
    assert 'product' in story.rules


CHANGES = [
    (order(1, station='returns'), {'delivery': RETURNS}),
    (order(1, quantity=2), {'quantity': 2, 'weight_kg': 2.0}),
]


@pytest.mark.parametrize(('changed', 'new'), CHANGES)
def test_a_change_and_its_task_may_be_heard_in_any_order(
    changed: Order, new: dict[str, Any]
) -> None:
    for first in ('order', 'task'):
        story = begun(LONG)
        for said in (first, 'order' if first == 'task' else 'task'):
            if said == 'order':
                story.want(changed)
            else:
                story.say(replace(TASK, **new))
            story.see(EMPTY, steps=QUIET // 2)
        story.see(EMPTY, steps=LONG)
        assert story.rules == []


@pytest.mark.parametrize('changed', [changed for changed, _ in CHANGES])
def test_a_change_that_is_ignored_is_found_when_the_task_goes_on(changed: Order) -> None:
    story = begun(2)
    story.want(changed)
    story.see(EMPTY, steps=LONG)
    story.see(EMPTY, steps=QUIET + 2, said=replace(TASK, status=TaskStatus.ASSIGNED, robot='a'))
    assert len(story.rules) == 1


@pytest.mark.parametrize('changed', [changed for changed, _ in CHANGES])
@pytest.mark.parametrize(
    'touched', [CARRIED, replace(TASK, stranded=True), replace(TASK, attempt=1)]
)
def test_a_change_that_comes_after_the_pick_is_too_late(touched: Task, changed: Order) -> None:
    story = begun(2)
    story.see(EMPTY, steps=2, said=touched)
    story.want(changed)
    story.see(EMPTY, steps=LONG)
    story.see(EMPTY, steps=LONG, said=replace(touched, priority=7))
    assert story.rules == []


@pytest.mark.parametrize('changed', [changed for changed, _ in CHANGES])
def test_what_was_wanted_before_may_be_picked_shortly_after_a_change(changed: Order) -> None:
    story = begun(2)
    story.want(changed)
    story.see(EMPTY, steps=QUIET)
    story.see(LOADED, steps=LONG, said=CARRIED)
    assert story.rules == []


def test_a_change_may_come_while_nobody_says_anything_of_the_task() -> None:
    story = begun(2)
    story.want(order(1, station='returns'))
    for _ in range(LONG):  # the Task Organizer is away, and a robot is on its way
        story.step += 1
        story.validator.check(FleetState(story.step, (EMPTY,)), 9.0)
    story.see(LOADED, steps=LONG, said=CARRIED)
    assert story.rules == []


def test_a_validator_that_starts_later_asks_nothing_of_a_task_that_is_under_way() -> None:
    story = Story(order(3, station='returns', quantity=2), CARRIED)
    story.see(LOADED, steps=LONG)
    assert story.rules == []


def test_a_validator_that_starts_late_waits_until_somebody_speaks_of_the_task() -> None:
    story = Story(order(3, station='returns'), TASK)
    for step in range(LONG):
        story.validator.check(FleetState(step, (EMPTY,)), 9.0)
    story.step = LONG
    story.see(EMPTY, steps=LONG, said=replace(TASK, delivery=RETURNS))
    assert story.rules == []


def test_what_robots_carry_for_orders_that_are_over_is_not_compared() -> None:
    story = Story(None, replace(TASK, delivery=RETURNS))
    story.see(EMPTY, steps=LONG)
    assert story.rules == []


# Loads


@pytest.mark.parametrize(
    ('load', 'rules'),
    [
        (Load('1/tea', 'tea', 1.0), []),
        (Load('1/tea', 'tea', 1.4), []),
        (Load('1/tea', 'pallet', 0.0), []),
        (Load('1/tea', 'safe', 1.0), ['load']),
        (Load('1/tea', 'tea', 999.0), ['load']),
        (Load('1/tea', '', 0.1), ['load']),
    ],
)
def test_a_robot_shows_the_load_that_its_task_says(load: Load, rules: list[str]) -> None:
    story = begun()
    story.see(replace(EMPTY, loads=(load,)))
    story.see(replace(EMPTY, loads=(load,)), steps=QUIET + 2, said=CARRIED)
    assert story.rules == rules


def test_what_was_picked_before_a_change_is_soon_what_the_task_says() -> None:
    story = begun()
    story.want(order(1, quantity=2))
    story.see(LOADED, steps=5, said=replace(TASK, quantity=2, weight_kg=2.0))
    story.see(LOADED, steps=QUIET + 2, said=CARRIED)
    assert story.rules == []


# Ends


DROPPED = replace(
    EMPTY,
    last_node_id=node_id(PACKING),
    action_states=(ActionState('1/tea#0:drop', 'drop', ActionStatus.FINISHED),),
)
WAY = [TEA, (1, 0), *((x, 0) for x in range(2, 10))]


def delivered() -> Story:
    story = begun()
    story.see(LOADED)
    story.say(CARRIED)
    story.carry(*WAY)
    story.see(DROPPED)
    return story


@pytest.mark.parametrize('status', [TaskStatus.FAILED, TaskStatus.CANCELLED])
def test_what_was_delivered_is_not_said_to_be_given_up(status: TaskStatus) -> None:
    story = delivered()
    story.say(replace(TASK, status=status))
    assert story.rules == ['claimed']


def test_who_has_not_yet_heard_of_a_delivery_may_say_what_was_before() -> None:
    story = delivered()
    given_up = replace(TASK, status=TaskStatus.CANCELLED)
    story.validator.know(Tasks(story.step - 1, (given_up,)))
    assert story.rules == []


def test_a_delivery_that_a_new_start_of_the_floor_undid_may_fail() -> None:
    story = delivered()
    story.step += 10
    story.carry(PACKING)
    story.say(replace(TASK, status=TaskStatus.FAILED))
    assert story.rules == []


def test_a_line_is_not_said_to_be_given_up_whose_task_was_delivered() -> None:
    story = delivered()
    story.say(replace(TASK, status=TaskStatus.DELIVERED))
    story.want(order(status=LineStatus.FAILED))
    story.see(DROPPED, steps=QUIET + 2)
    assert story.rules == ['claimed']


def test_a_line_that_was_given_up_before_its_load_came_is_right() -> None:
    story = begun()
    story.say(replace(TASK, status=TaskStatus.FAILED))
    story.want(order(status=LineStatus.FAILED))
    story.see(LOADED, steps=2)
    story.say(CARRIED)
    story.carry(*WAY)
    story.see(DROPPED)
    story.see(DROPPED, steps=QUIET + 2, said=replace(TASK, status=TaskStatus.DELIVERED, attempt=1))
    assert story.rules == []


def test_a_delivery_may_be_said_before_its_step_is_seen() -> None:
    story = begun()
    story.see(LOADED)
    story.say(CARRIED)
    story.carry(*WAY)
    story.say(replace(TASK, status=TaskStatus.DELIVERED))
    story.carry(*[PACKING] * (GRACE - 2))
    story.see(DROPPED, steps=GRACE)
    assert story.rules == []


def test_a_delivery_that_is_no_longer_said_is_no_claim() -> None:
    story = begun(2)
    story.see(EMPTY, steps=2, said=replace(TASK, status=TaskStatus.DELIVERED))
    story.see(EMPTY, steps=GRACE + 2, said=TASK)
    assert story.rules == []


def test_a_delivery_counts_that_a_new_start_of_the_floor_undid_before_it_was_said() -> None:
    story = delivered()
    story.step += 10
    story.carry(PACKING)
    story.say(replace(TASK, status=TaskStatus.DELIVERED))
    story.carry(*[PACKING] * LONG)
    assert story.rules == []


# The simulated floor gives no false alarm.


def test_a_robot_off_its_plan_does_not_enter_where_a_silent_one_was_last_seen() -> None:
    fleet = Fleet(
        site(r0=('hauler', (2, 0)), r1=('carrier', (1, 0)), r2=('carrier', TEA)), PROFILES
    )

    def go(robot: str, start: Cell, end: Cell) -> None:
        nodes = (OrderNode(node_id(start), 0), OrderNode(node_id(end), 2))
        fleet.order(FleetOrders(shown.step, (RobotOrder(robot, '', 0, nodes),)))

    shown = fleet.step()
    go('r0', (2, 0), (3, 0))
    shown = fleet.step()
    assert shown.states[0].cells == ((2, 0), (3, 0))
    fleet.operate(OperatorCommand('1', 'failRobot', 'r0', failure='COMM_LOST'))
    fleet.operate(OperatorCommand('2', 'failRobot', 'r1', failure='OFF_PLAN'))
    for _ in range(3):
        shown = fleet.step()
    go('r1', (1, 0), (0, 0))
    shown = fleet.step()
    assert shown.states[0].serial_number == 'r1'
    assert shown.states[0].cells == ((0, 0),)
